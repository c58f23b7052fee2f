"""Stresses recovered from those of finite elements, and the errors that they show. Needs a mesh
and displacements only, no operators.
"""
