"""Finished meshes of other programs, their cells and patches. Never the meshing of anything."""
