"""One file per kind of stage, the state that stages hand on, and what warns or estimates beside
them.

Never the order of stages, nor many poses at once.
"""
