"""Numbers of a run with their ±: kinds, tables, estimates; no answer and no solver."""
