"""Drives closed around a system: loops, dead time, margins, stability. Never motion in time."""
