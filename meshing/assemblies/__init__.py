"""Assembly files: their tree, their solids and where these touch, found with gmsh in a worker
process. Never how parts are meshed.
"""
