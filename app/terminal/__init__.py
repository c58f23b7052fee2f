"""The screen: console, progress, exit codes, one listing per kind of study. Never files."""
