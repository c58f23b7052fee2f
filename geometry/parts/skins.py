"""The visible surface of a component: triangles and the sharp edges between them, for pictures."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray

IntArray = NDArray[np.int64]

SHARP_COSINE = float(np.cos(np.radians(40.0)))


@dataclass(frozen=True, eq=False)
class Skin:
    """A triangulated surface in the component frame.

    Attributes:
        points: ``(n, 3)`` [m].
        triangles: ``(m, 3)`` outward, indices into ``points``.
        edges: ``(k, 2)`` sharp edges, indices into ``points``.
        source: What it was made of: the mesh, the solid, or, where neither is at hand, a box of
            equal inertia.
        nodes: ``(n, k)`` mesh points around each point; None where there is no mesh.
        weights: ``(n, k)`` their shares in what moves it, of sum one.
        thinned_from: How many triangles it had before some were taken out; None where none were.
        kept_whole: Why none were taken out though there are very many; None where that is not so.
    """

    points: FloatArray
    triangles: IntArray
    edges: IntArray
    source: str
    nodes: IntArray | None = None
    weights: FloatArray | None = None
    thinned_from: int | None = None
    kept_whole: str | None = None


def sharp_edges(points: FloatArray, triangles: IntArray) -> IntArray:
    """Return the edges ``(k, 2)`` where two triangles meet at more than 40 degrees, or that belong
    to one or more than two triangles.
    """
    if not len(triangles):
        return np.zeros((0, 2), dtype=np.int64)
    corners = points[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    normals /= np.where(lengths > 0.0, lengths, 1.0)
    every = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    owners = np.repeat(np.arange(len(triangles)), 3)
    edges, inverse, counts = np.unique(every, axis=0, return_inverse=True, return_counts=True)
    order = np.argsort(inverse.ravel(), kind="stable")
    first = np.concatenate([[0], np.cumsum(counts)[:-1]])
    left = owners[order[first]]
    right = owners[order[first + np.minimum(counts, 2) - 1]]
    cosine = np.einsum("ij,ij->i", normals[left], normals[right])
    return np.asarray(edges[(counts != 2) | (cosine < SHARP_COSINE)])


def split_skin(skin: Skin) -> Skin:
    """Return the same surface with every triangle cut into four and every edge into two at their
    middles.
    """
    every = np.sort(
        np.vstack(
            [
                skin.triangles[:, [0, 1]],
                skin.triangles[:, [1, 2]],
                skin.triangles[:, [2, 0]],
                skin.edges,
            ]
        ),
        axis=1,
    )
    pairs, inverse = np.unique(every, axis=0, return_inverse=True)
    middles = len(skin.points) + inverse.ravel()
    count = len(skin.triangles)
    a, b, c = skin.triangles.T
    ab, bc, ca = middles[:count], middles[count : 2 * count], middles[2 * count : 3 * count]
    halves = middles[3 * count :]
    return Skin(
        np.vstack([skin.points, skin.points[pairs].mean(axis=1)]),
        np.vstack(
            [
                np.column_stack(corners)
                for corners in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
            ]
        ),
        np.vstack(
            [
                np.column_stack([skin.edges[:, 0], halves]),
                np.column_stack([halves, skin.edges[:, 1]]),
            ]
        ),
        skin.source,
    )


def join_skins(skins: list[Skin]) -> Skin:
    """Return several surfaces as one."""
    starts = np.cumsum([0, *(len(skin.points) for skin in skins)])[:-1]
    return Skin(
        np.vstack([skin.points for skin in skins]),
        np.vstack([skin.triangles + start for skin, start in zip(skins, starts, strict=True)]),
        np.vstack([skin.edges + start for skin, start in zip(skins, starts, strict=True)]),
        skins[0].source,
    )
