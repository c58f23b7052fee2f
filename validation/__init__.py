"""Closed forms, published values and independent methods, and the cases that compare Headstock with
them.

Never imported by anything but app, tests and benchmarks.
"""
