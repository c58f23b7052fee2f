"""Surfaces with fewer triangles, for pictures that are to stay small."""

import numpy as np

from headstock.geometry.skins import IntArray, Skin

# cells along the longest side of the grid that is tried first, and by how much the next is coarser
FINEST_GRID, GRID_STEP = 256.0, 0.8


def merge_skin(skin: Skin, *, largest: int) -> tuple[Skin, IntArray]:
    """One point of a surface per cell of a grid, the finest that leaves few enough triangles.

    A corner stands for its cell before a point of a sharp edge, and that before any other: edges stay where they were.

    Args:
        skin: The surface.
        largest: How many triangles there may be.

    Returns:
        The surface, and which of its points were kept; the same surface where it is small enough.

    Source: Rossignac and Borrel (1993), vertex clustering.
    """
    if len(skin.triangles) <= largest:
        return skin, np.arange(len(skin.points))
    meetings = np.bincount(skin.edges.ravel(), minlength=len(skin.points))
    sharpest = np.argsort(-np.where(meetings == 2, 1, 2 * np.minimum(meetings, 1)), kind="stable")
    low, extent = skin.points.min(axis=0), float(np.ptp(skin.points, axis=0).max())
    cells, triangles, place = FINEST_GRID, skin.triangles, np.arange(len(skin.points))
    while len(triangles) > largest:
        grid = np.floor((skin.points[sharpest] - low) * (cells / extent)).astype(np.int64)
        _, first, inverse = np.unique(grid, axis=0, return_index=True, return_inverse=True)
        place[sharpest] = sharpest[first][inverse.ravel()]
        triangles = _distinct(place[skin.triangles])
        cells *= GRID_STEP
    kept, flat = np.unique(triangles, return_inverse=True)
    numbers = np.full(len(skin.points), -1)
    numbers[kept] = np.arange(len(kept))
    edges = numbers[_distinct(place[skin.edges])]
    nodes = None if skin.nodes is None else skin.nodes[kept]
    return Skin(skin.points[kept], flat.reshape(-1, 3), edges[(edges >= 0).all(axis=1)], skin.source, nodes), kept


def _distinct(simplices: IntArray) -> IntArray:
    """Triangles or edges without those that shrank, each once."""
    whole = np.all(simplices != np.roll(simplices, 1, axis=1), axis=1)
    _, unique = np.unique(np.sort(simplices[whole], axis=1), axis=0, return_index=True)
    return np.asarray(simplices[whole][np.sort(unique)])
