"""From solids and mesh files to checked second-order meshes with tagged patches; the only users of
gmsh and meshio.

Never dolfinx, nor how a material behaves.
"""
