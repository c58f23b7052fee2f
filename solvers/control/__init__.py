"""Drives closed around a system: loops, dead time, margins, stability, friction in time. Never
paths.
"""
