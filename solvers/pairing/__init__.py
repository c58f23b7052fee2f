"""Natural modes and peaks of responses of one model found again in another, in a measurement, or along a
path, and how well they agree. Never how they are computed.
"""
