"""Paths of axes: how far a machine leaves a straight line while its axes accelerate, with ideal motors
or drives under control, in one pose or as it changes along the path.

Never here: contours, other analyses, and numerics that know nothing of scenes.
"""
