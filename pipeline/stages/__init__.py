"""One file per topic of stages, the state that stages hand on, and what warns or estimates beside
them.

Never the order of stages, nor many poses at once (but for ``map``, which is such a stage).
"""
