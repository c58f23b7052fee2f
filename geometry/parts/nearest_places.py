"""Nearest place of a triangulated surface to a point, and whether the surface encloses it."""

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray


def find_nearest_place(
    points: FloatArray, triangles: NDArray[np.int64], place: FloatArray
) -> tuple[FloatArray, float]:
    """Find the place ``(3,)`` of a surface that is nearest to another, and its distance [m].

    Args:
        points: ``(n, 3)`` corners [m].
        triangles: ``(m, 3)`` indices of corners, at least one.
        place: ``(3,)`` [m].

    Source: Ericson (2005), Real-Time Collision Detection, section 5.1.5: the foot on the plane where it
    lies in the triangle, else the nearest place of the three edges.
    """
    corners = points[triangles]
    along = np.roll(corners, -1, axis=1) - corners
    lengths = np.einsum("ijk,ijk->ij", along, along)
    shares = np.einsum("ijk,ijk->ij", place - corners, along) / np.where(
        lengths > 0.0, lengths, 1.0
    )
    on_edges = corners + np.clip(shares, 0.0, 1.0)[..., None] * along
    normals = np.cross(along[:, 0], along[:, 1])
    sizes = np.einsum("ij,ij->i", normals, normals)
    heights = np.einsum("ij,ij->i", place - corners[:, 0], normals) / np.where(
        sizes > 0.0, sizes, 1.0
    )
    feet = place - heights[:, None] * normals
    sides = np.einsum("ijk,ik->ij", np.cross(along, feet[:, None] - corners), normals)
    inside = (sides >= 0.0).all(axis=1) & (sizes > 0.0)
    candidates = np.concatenate([on_edges.reshape(-1, 3), feet[inside]])
    distances = np.linalg.norm(candidates - place, axis=1)
    nearest = int(np.argmin(distances))
    return candidates[nearest], float(distances[nearest])


def encloses(points: FloatArray, triangles: NDArray[np.int64], place: FloatArray) -> bool:
    """Return whether a closed surface with triangles outward encloses a place ``(3,)``.

    Source: van Oosterom and Strackee (1983), IEEE Trans. Biomed. Eng. 30, 125, the solid angle of a
    triangle; their sum is 4 pi inside.
    """
    first, second, third = np.moveaxis(points[triangles] - place, 1, 0)
    sizes = [np.linalg.norm(corner, axis=1) for corner in (first, second, third)]
    volume = np.einsum("ij,ij->i", first, np.cross(second, third))
    spread = (
        sizes[0] * sizes[1] * sizes[2]
        + np.einsum("ij,ij->i", first, second) * sizes[2]
        + np.einsum("ij,ij->i", second, third) * sizes[0]
        + np.einsum("ij,ij->i", third, first) * sizes[1]
    )
    return bool(2.0 * np.arctan2(volume, spread).sum() > 2.0 * np.pi)


def describe_distance(component: str, nearest: FloatArray, distance: float) -> str:
    """Say how far a place lies outside a component, and the nearest place ``(3,)`` of its surface in
    the component frame [m].
    """
    at = ", ".join(f'"{1e3 * value + 0.0:.4g} mm"' for value in nearest)
    return f'lies {1e3 * distance:.3g} mm outside "{component}"; nearest place of its surface: at = [{at}]'
