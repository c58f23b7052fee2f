"""How often ± covers the truth, over parts drawn by seed. Never how ± is computed."""
