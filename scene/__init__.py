"""What a user writes, until it is a checked ``Scene``. Never meshing, reduction or a run."""
