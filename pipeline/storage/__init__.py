"""Files that appear whole or not at all: store, keys, records, outputs, JSON. Never what a result
means.
"""
