"""The screen: console, progress, exit codes, and one listing per kind of result, as a table of it or as
the rows that a file takes. Never the writing of files.
"""
