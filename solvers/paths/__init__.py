"""A tool that leaves its line: set points, response, systems that vary along the way, under control. Never scenes."""
