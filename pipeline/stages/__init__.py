"""One file per kind of stage, and the state that they hand on. Never the order of stages or many poses."""
