"""Stresses recovered from those of finite elements, and the errors that they tell of. Needs a mesh
and displacements only, no operators.
"""
