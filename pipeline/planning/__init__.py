"""The plan of a run, its cost in dofs, memory and time, and what the machine has of them. Never the
work itself.
"""
