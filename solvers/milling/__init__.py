"""Cutting forces, tool paths, stability, regeneration and contouring. Never how the structure under
them is modelled.
"""
