"""The meshing job, the guarded child process that does it, and its limits. Never what is meshed."""
