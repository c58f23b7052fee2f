"""A machine in time along a path: set points, loads, the plant along it, steps with and without
friction, deviation. Never the loops of drives themselves, which are in ``control``.
"""
