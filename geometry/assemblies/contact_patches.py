"""Patches of a scene for the two sides of a contact, in the coordinates of their parts."""

from collections.abc import Iterable

import numpy as np

from headstock.geometry.assemblies.contacts import Contact
from headstock.geometry.assemblies.parts import Assembly
from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.curved_patches import plane_axes

WHOLE = 0.99  # share of a face that counts as all of it
SMALL_HOLES = 0.01  # area of holes over that of a contact: what a patch may cover beyond it
ROUND = 1e-3  # of an outline, over its radius
FEWEST_ROUND = 24  # points of an outline that can be round
RIGHT_ANGLE = 1e-3  # cosine between sides of a rectangle
COARSEST = 0.02  # of an outline's extent: how far its corners may be from its curved edges
SAME_AREA = 0.01  # of an outline: what fewer corners may change
UPRIGHT = 1e-6  # angle of a rectangle that is not written [rad]


def write_contact_patches(assembly: Assembly, contact: Contact, side: int) -> tuple[str, ...]:
    """Return the patches of a contact on one of its solids as inline tables of a scene, in the
    coordinates of the first solid of its part.

    Whole faces where the contact takes all of them; a disk, a ring, a rectangle or an outline of
    the rest; bands of cylinders. Holes that the part itself has need not be written.

    Args:
        side: 0 for the first solid, 1 for the second.
    """
    number = contact.solids[side]
    (place,) = (one for part in assembly.parts for one in part.placements if one.solid == number)
    rotation, shift = np.array(place.rotation), np.array(place.shift)
    outlines = [(outline - shift) @ rotation for outline in contact.outlines]
    shape = ""
    if contact.kind == "plane":
        normal = np.array(contact.axis) @ rotation
        holes = [outlines[i] for i in contact.solid_holes[side]]
        shape = _write_plane(outlines[0], holes, normal, contact.area)
    else:
        center = (np.array(contact.center) - shift) @ rotation
        shape = f"band = {{ center = {_point(center)}, width = {_length(contact.length or 0.0)} }}"
    return tuple(
        f'{{ face = "face:{face}" }}' if share >= WHOLE else f'{{ face = "face:{face}", {shape} }}'
        for face, share in zip(contact.faces[side], contact.covered[side], strict=True)
    )


def outline_area(outline: FloatArray, normal: FloatArray) -> float:
    """Return the area within a closed outline ``(n, 3)`` on a plane with a unit normal ``(3,)``."""
    return _area(outline @ plane_axes(normal).T)


def _area(points: FloatArray) -> float:
    """Return the area within a closed outline ``(n, 2)``."""
    following = np.roll(points, -1, axis=0)
    return 0.5 * abs(float(points[:, 0] @ following[:, 1] - points[:, 1] @ following[:, 0]))


def _write_plane(
    outline: FloatArray, holes: list[FloatArray], normal: FloatArray, area: float
) -> str:
    """Return the shape of an outline ``(n, 3)`` on a plane, without holes ``(m, 3)`` that the part
    does not have itself.
    """
    axes = plane_axes(normal)
    height = float(outline[0] @ normal) * normal
    holes = [hole for hole in holes if outline_area(hole, normal) > SMALL_HOLES * area]
    circle = _fit_circle(outline @ axes.T)
    if circle is not None and len(holes) <= 1:
        center, radius = circle
        at = f"center = {_point(center @ axes + height)}, diameter = {_length(2.0 * radius)}"
        if not holes:
            return f"disk = {{ {at} }}"
        inner = _fit_circle(holes[0] @ axes.T)
        if inner is not None and np.linalg.norm(inner[0] - center) <= ROUND * radius:
            return f"ring = {{ {at}, inner = {_length(2.0 * inner[1])} }}"
    corners = _find_corners(outline @ axes.T)
    sides = np.roll(corners, -1, axis=0) - corners
    lengths = np.linalg.norm(sides, axis=1)
    cosines = (sides * np.roll(sides, -1, axis=0)).sum(axis=1) / (lengths * np.roll(lengths, -1))
    if len(corners) == 4 and np.abs(cosines).max() <= RIGHT_ANGLE:
        # the side along the first axis, or nearest to it
        along = int(np.argmax(np.abs(sides[:2, 0]) / lengths[:2]))
        direction = sides[along] * np.sign(sides[along, 0])
        angle = float(np.arctan2(direction[1], direction[0]))
        turned = f', angle = "{np.degrees(angle):.6g} deg"' if abs(angle) > UPRIGHT else ""
        size = f"[{_length(lengths[along])}, {_length(lengths[1 - along])}]"
        middle = corners.mean(axis=0) @ axes + height
        return f"rect = {{ center = {_point(middle)}, size = {size}{turned} }}"
    points = ", ".join(_point(corner @ axes + height) for corner in corners)
    return f"outline = {{ corners = [{points}] }}"


def _fit_circle(points: FloatArray) -> tuple[FloatArray, float] | None:
    """Return centre ``(2,)`` and radius of a round outline ``(n, 2)``; None for others."""
    if len(points) < FEWEST_ROUND:
        return None
    middle = points.mean(axis=0)
    arms = points - middle
    # circle through points, by least squares (Kasa 1976), as in `fit_cylinder`
    rows = np.column_stack([2.0 * arms, np.ones(len(arms))])
    *offset, rest = np.linalg.lstsq(rows, (arms**2).sum(axis=1), rcond=None)[0]
    center = middle + np.array(offset)
    radius = float(np.sqrt(rest + np.dot(offset, offset)))
    lengths = np.linalg.norm(points - center, axis=1)
    return (center, radius) if np.abs(lengths - radius).max() <= ROUND * radius else None


def _find_corners(points: FloatArray) -> FloatArray:
    """Return the fewest corners of a closed outline ``(n, 2)`` that keep its area."""
    limit = COARSEST * float(np.ptp(points, axis=0).max())
    corners = _drop_points(points, limit)
    while len(corners) < len(points) and not np.isclose(
        _area(corners), _area(points), rtol=SAME_AREA
    ):
        limit *= 0.5
        corners = _drop_points(points, limit)
    return corners


def _drop_points(points: FloatArray, limit: float) -> FloatArray:
    """Return a closed outline ``(n, 2)`` without the points that lie as near as a limit to the line
    between others.

    Source: Douglas and Peucker (1973).
    """
    # from the farthest two points, which are corners
    start = int(np.linalg.norm(points - points.mean(axis=0), axis=1).argmax())
    ring = np.roll(points, -start, axis=0)
    middle = int(np.linalg.norm(ring - ring[0], axis=1).argmax())
    kept = {0, middle}
    waiting = [(0, middle), (middle, len(ring))]
    while waiting:
        low, high = waiting.pop()
        chord = ring[high % len(ring)] - ring[low]
        arms = ring[low + 1 : high] - ring[low]
        depths = np.abs(arms[:, 0] * chord[1] - arms[:, 1] * chord[0]) / np.linalg.norm(chord)
        if len(depths) and depths.max() > limit:
            between = low + 1 + int(depths.argmax())
            kept.add(between)
            waiting += [(low, between), (between, high)]
    return ring[sorted(kept)]


def _length(value: float) -> str:
    return f'"{round(1e3 * value, 4) + 0.0:.10g} mm"'


def _point(values: Iterable[float]) -> str:
    return f"[{', '.join(map(_length, values))}]"
