"""Meshes and modes chosen for a stated accuracy, in rounds. Never the error estimates
themselves.
"""
