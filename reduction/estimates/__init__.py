"""Errors of frequencies, compliances and responses: the numbers behind ±. Never which mesh to
refine.
"""
