"""Settings searched for a stated accuracy. Never printing."""
