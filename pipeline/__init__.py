"""One run of a scene: planned, computed stage by stage, stored and summarised. Never a comparison
of runs, printing, or the reading of TOML.
"""
