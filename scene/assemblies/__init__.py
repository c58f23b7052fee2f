"""The scene of an assembly of CAD solids: its components, joints, axes and points, with open values where
geometry leaves a choice. Never files that are read.
"""
