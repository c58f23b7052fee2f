"""Meshes and modes chosen for a stated accuracy, round by round. Never the error estimates
themselves.
"""
