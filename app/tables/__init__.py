"""Tables for terminal, report and CSV files: what several views share, and those of studies."""
