"""Cutting forces, tool paths, stability, regeneration and contouring by a mechanism. Never finite
elements or superelements.
"""
