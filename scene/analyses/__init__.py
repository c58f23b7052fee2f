"""One file per analysis: its table, its request, what may be wrong with it and what it builds. Never
another topic of the machine.
"""
