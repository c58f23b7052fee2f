"""Natural modes and peaks of responses of one model found again in another, or along a path. Never how
they are computed.
"""
