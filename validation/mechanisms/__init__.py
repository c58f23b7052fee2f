"""The Tripteor and other loops, in absolute coordinates too. Never serial machines."""
