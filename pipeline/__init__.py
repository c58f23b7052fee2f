"""Scenes, units, planning, running, the store of superelements and the result files."""
