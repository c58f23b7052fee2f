"""Cutting forces, tool paths, stability, regeneration, contouring. Never the structure that they act on."""
