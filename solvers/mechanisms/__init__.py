"""Equations of motion of closed loops, their small motions and integrators. Never cutting
forces.
"""
