"""A tool that leaves its path while axes accelerate: set points, response, systems that vary along
the way. Never the loops of drives themselves, which are in ``control``.
"""
