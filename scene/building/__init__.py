"""Per topic: what is wrong with its tables, and what they build; ``loader`` is the one door. Never
running anything.
"""
