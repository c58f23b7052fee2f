"""A run as a whole: its answers together in ``summary.json``, ``results.h5``, tables, views and mode
files. Never how it is computed.
"""
