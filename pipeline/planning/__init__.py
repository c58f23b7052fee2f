"""The plan of a run, what it costs beforehand and what the machine has. Never the work itself."""
