"""What a run found: the types, ``summary.json``, ``results.h5``, views and mode files. Never how it
is computed.
"""
