"""What each analysis found: the types, and their parts of ``summary.json`` and ``results.h5``. Never
how it is computed.
"""
