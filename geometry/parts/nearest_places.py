"""Nearest place of a triangulated surface to a point, and whether the surface encloses it."""

from collections.abc import Mapping

import numpy as np

from headstock.geometry.frames import FloatArray, Frame
from headstock.geometry.parts.skins import Skin


def find_nearest_place(skin: Skin, place: FloatArray) -> tuple[FloatArray, float]:
    """Find the place ``(3,)`` of a surface that is nearest to another, and its distance [m].

    Args:
        skin: With one triangle at least.
        place: ``(3,)`` [m].

    Source: Ericson (2005), Real-Time Collision Detection, section 5.1.5: the foot on the plane where it
    lies in the triangle, else the nearest place of the three edges.
    """
    candidates = find_nearest_in_triangles(skin.points[skin.triangles], place)
    distances = np.linalg.norm(candidates - place, axis=1)
    nearest = int(np.argmin(distances))
    return candidates[nearest], float(distances[nearest])


def find_nearest_in_triangles(corners: FloatArray, places: FloatArray) -> FloatArray:
    """Find the place ``(t, 3)`` of each triangle that is nearest to a place.

    Args:
        corners: ``(t, 3, 3)`` corner by corner [m].
        places: ``(t, 3)`` one for each triangle, or ``(3,)`` for all [m].
    """
    places = np.broadcast_to(places, (len(corners), 3))
    along = np.roll(corners, -1, axis=1) - corners
    lengths = np.einsum("ijk,ijk->ij", along, along)
    shares = np.einsum("ijk,ijk->ij", places[:, None] - corners, along) / np.where(
        lengths > 0.0, lengths, 1.0
    )
    on_edges = corners + np.clip(shares, 0.0, 1.0)[..., None] * along
    normals = np.cross(along[:, 0], along[:, 1])
    sizes = np.einsum("ij,ij->i", normals, normals)
    heights = np.einsum("ij,ij->i", places - corners[:, 0], normals) / np.where(
        sizes > 0.0, sizes, 1.0
    )
    feet = places - heights[:, None] * normals
    sides = np.einsum("ijk,ik->ij", np.cross(along, feet[:, None] - corners), normals)
    inside = (sides >= 0.0).all(axis=1) & (sizes > 0.0)
    nearest = np.argmin(np.linalg.norm(on_edges - places[:, None], axis=2), axis=1)
    return np.where(inside[:, None], feet, on_edges[np.arange(len(corners)), nearest])


def encloses(skin: Skin, place: FloatArray) -> bool:
    """Return whether a closed surface encloses a place ``(3,)`` [m].

    Source: van Oosterom and Strackee (1983), IEEE Trans. Biomed. Eng. 30, 125, the solid angle of a
    triangle; their sum is 4 pi inside.
    """
    first, second, third = np.moveaxis(skin.points[skin.triangles] - place, 1, 0)
    sizes = [np.linalg.norm(corner, axis=1) for corner in (first, second, third)]
    volume = np.einsum("ij,ij->i", first, np.cross(second, third))
    spread = (
        sizes[0] * sizes[1] * sizes[2]
        + np.einsum("ij,ij->i", first, second) * sizes[2]
        + np.einsum("ij,ij->i", second, third) * sizes[0]
        + np.einsum("ij,ij->i", third, first) * sizes[1]
    )
    return bool(2.0 * np.arctan2(volume, spread).sum() > 2.0 * np.pi)


def describe_distance(
    component: str,
    position: FloatArray,
    nearest: FloatArray,
    distance: float,
    skins: Mapping[str, Skin],
    frames: Mapping[str, Frame],
) -> str:
    """Say how far a place lies outside a component, the nearest place of its surface, and which other
    component is nearer, if one is.

    Args:
        position: ``(3,)`` in the component frame [m].
        nearest: ``(3,)``, the same.
        distance: To it [m].
        skins: Component to its surface in its frame.
        frames: Component to its frame in the machine's; all of ``skins``.
    """
    at = ", ".join(f'"{round(1e3 * float(value), 2) + 0.0:g} mm"' for value in nearest)
    text = f'lies {1e3 * distance:.3g} mm outside "{component}"; nearest place of its surface: at = [{at}]'
    place = frames[component].origin + frames[component].rotation @ position
    gaps = []
    for name in skins.keys() - {component}:
        local = frames[name].rotation.T @ (place - frames[name].origin)
        inside = encloses(skins[name], local)
        gaps.append((0.0 if inside else find_nearest_place(skins[name], local)[1], name))
    gap, name = min(gaps, default=(np.inf, ""))
    if gap < distance:
        text += f"; {name} is nearer ({1e3 * gap + 0.0:.3g} mm with all axes at zero)"
    return text
