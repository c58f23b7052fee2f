"""The command line, and every way in which results are shown: tables, charts, pictures, reports.
Never a number that is not in a result.
"""
