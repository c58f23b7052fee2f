"""A tool that leaves its path while axes accelerate: set points, response, systems that vary along
the way, control. Never scenes.
"""
