"""Cells as such: numbering, quality, second order, surfaces, structured hexes. Never gmsh."""
