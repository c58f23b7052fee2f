"""Numbers of a run with their ±: kinds, tables, estimates. Never an answer or a solver."""
