"""A measured machine beside its model: which modes are the same by shape, how far apart they are, and which
channels and responses disagree. Never a file of testers, and never a fit.
"""
