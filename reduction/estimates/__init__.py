"""How far frequencies, compliances and responses are off: the ±. Never what to refine."""
