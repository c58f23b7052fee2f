"""Faults on purpose: damaged files, full disks, kills, a disturbed Slurm; and the sample files
other tests damage too. Never numbers.
"""
