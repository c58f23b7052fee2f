"""Coupled machines: monolithic models, estimates, paths, drives, identification, the axis construction kit. Never closed loops."""
