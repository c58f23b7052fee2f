"""A machine in time along a path: set points, loads, the plant along it, time steps with and
without friction, deviation. Never the controllers of drives, which are in ``control``.
"""
