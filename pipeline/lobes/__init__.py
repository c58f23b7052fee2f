"""Stability lobes of a machine in a pose: where it cuts, limits and their checks, what chatters, and ± of
the lowest limits.

Never here: other analyses, many poses at once, and numerics that know nothing of scenes.
"""
