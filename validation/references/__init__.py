"""Reference values with their source, closed forms, and the rows of the table. Never a computation
by Headstock.
"""
