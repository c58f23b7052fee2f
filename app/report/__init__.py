"""The HTML pages of runs, sweeps and comparisons, with their SVG plots, templates and 3D viewer.
Never the terminal.
"""
