"""Text to values that know their place: units, TOML positions, findings, keys, files. Never what a
key means.
"""
