"""The screen: console, progress, exit codes, and one listing per kind of result. Never a file of
results.
"""
