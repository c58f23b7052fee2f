"""Drawings of results in SVG, as reports have them. Never a table, never a page."""
