"""How far frequencies, compliances and responses are from the truth: the numbers behind ±. Never
which mesh to refine.
"""
