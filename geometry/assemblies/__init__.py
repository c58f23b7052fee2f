"""Assemblies of CAD solids: which are equal, where they touch, how pairs can move and what fastens
them. Never files or gmsh.
"""
