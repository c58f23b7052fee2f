"""The Tripteor and other closed loops, also in absolute coordinates. Never serial machines."""
