"""Finite elements and their large sparse systems; all imports of dolfinx, PETSc and UFL. Never
small dense systems.
"""
