"""Signatures and help texts of the commands; heavy modules are imported inside them. Never the work
itself.
"""
