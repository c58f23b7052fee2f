"""Closed kinematic loops: chains, loop closures, the Exechon. Never springs,
masses or forces.
"""
