"""Equations of motion of closed loops, and their small motions. Never cutting
forces.
"""
