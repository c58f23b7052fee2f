"""Files that appear whole or not at all: store, keys, records, outputs, JSON, and what the store knows
of part files. Never what a result means.
"""
