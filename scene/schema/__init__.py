"""Which keys there are, their variants and overrides. Never geometry or cross references."""
