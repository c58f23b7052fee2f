"""Superelements and joints in a pose to one system, and its slopes. Never how a superelement was made."""
