"""The HTML pages of runs, sweeps and comparisons, with their templates and 3D viewer. Never the
terminal.
"""
