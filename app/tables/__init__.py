"""Rows of what a run found, for terminal, report and CSV files: a file per answer."""
