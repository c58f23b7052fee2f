"""The meshing job, the isolated worker process that does it, and its limits. Never what is meshed."""
