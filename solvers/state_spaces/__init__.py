"""A reduced machine in time: state spaces, their steps, loads over time, fewer states, positions of
axes that change.
"""
