"""Coupled serial machines against monolithic models, estimates, other integrators and measurements.
Never closed loops.
"""
