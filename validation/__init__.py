"""Closed forms, reference values and the cases that hold the numbers to them."""
