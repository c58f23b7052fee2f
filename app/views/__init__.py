"""What is shown of each analysis, as one record: tables for files, the terminal, a section of the
report. Never what belongs to a whole run.
"""
