"""Figures of results by matplotlib, as PNG or SVG files. Never a number that is not in a result."""
