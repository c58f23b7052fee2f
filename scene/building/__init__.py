"""Per topic: what is wrong with its tables, and what they build; ``loader`` is the door for whole
scenes. Never running anything.
"""
