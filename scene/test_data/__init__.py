"""Measured data: what a test of a real machine says, as data, read from and written to the files of testers."""
