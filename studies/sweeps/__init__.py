"""Poses: runs, journals, results, files, Slurm. Never other parameters."""
