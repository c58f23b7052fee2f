"""Superelements and joints in a pose to one system, and its derivatives by parameters. Never how a
superelement was made.
"""
