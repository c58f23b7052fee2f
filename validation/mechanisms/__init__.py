"""The Tripteor and other closed loops, also in absolute coordinates, and their motion as the full DAE.
Never serial machines.
"""
