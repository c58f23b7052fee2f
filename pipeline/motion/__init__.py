"""Machines that move in time: along a path, along a milled contour, or under loads over time.
Trajectories, the machine along them, its motors, guide errors, loads of joints, motions of probes,
and the three analyses.

Never here: analyses of a machine at rest, and numerics that know nothing of scenes.
"""
