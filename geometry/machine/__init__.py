"""Coupled bodies: joints, axes, poses, carriages on rails, drives. Never how any of it is
solved.
"""
