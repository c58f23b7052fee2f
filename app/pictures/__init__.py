"""The machine and its parts drawn to PNG, by VTK or by a painter without it, in a child process.
Never charts.
"""
