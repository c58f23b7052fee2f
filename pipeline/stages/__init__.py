"""One file per kind of stage, and the state that stages hand on. Never the order of stages, nor many poses at once."""
