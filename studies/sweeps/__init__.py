"""The sweeps of a scene, many poses of one machine: runs, journals, results, files, array jobs of
Slurm. Never a change of the machine itself.
"""
