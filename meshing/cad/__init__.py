"""Gmsh and OpenCASCADE: shapes, imprints, sizes, slivers, faces, in a child process. Never imported
outside the worker.
"""
