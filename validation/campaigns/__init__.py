"""Faults on purpose: damaged files, full disks, kills, Slurm. Never numbers."""
