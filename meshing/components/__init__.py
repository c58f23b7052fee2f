"""One component in, one checked `ComponentMesh` out; skins and the survey of STEP files. Never gmsh
itself.
"""
