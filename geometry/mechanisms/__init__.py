"""Closed kinematic loops: chains, loop closures, the Exechon and other platforms. Never springs,
masses or forces.
"""
