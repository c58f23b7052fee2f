"""What a user writes, until it is a `Scene`. Never meshing, reduction or a run."""
