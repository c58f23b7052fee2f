"""Gmsh and OpenCASCADE: shapes, imprints, sizes, slivers, faces, in a worker process. Never imported
outside the worker.
"""
