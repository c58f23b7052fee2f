"""What a scene may leave to be filled in: parameters, catalogue parts, chains, included files, variants and
overrides, written out before its tables are checked.
"""
