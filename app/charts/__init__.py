"""Figures of results by matplotlib. Never a number that is not in a result."""
