"""Patches of a scene for the two sides of a contact, in the coordinates of their parts."""

from collections.abc import Iterable

import numpy as np

from headstock.geometry.assemblies.contacts import Contact
from headstock.geometry.assemblies.parts import Assembly
from headstock.geometry.frames import BoolArray, FloatArray
from headstock.geometry.parts.cad_faces import fit_circle
from headstock.geometry.parts.plane_shapes import Polygon, plane_axes

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

    Whole faces where the contact takes all of them; a disk, a ring, a rectangle or outlines of the
    rest; bands of cylinders. Holes that the part itself has need not be written.

    Args:
        side: 0 for the first solid, 1 for the second.
    """
    number = contact.solids[side]
    (place,) = (one for part in assembly.parts for one in part.placements if one.solid == number)
    rotation, shift = np.array(place.rotation), np.array(place.shift)
    outlines = [(outline - shift) @ rotation for outline in contact.outlines]
    if contact.kind == "plane":
        normal = np.array(contact.axis) @ rotation
        holes = [outlines[i] for i in contact.solid_holes[side]]
        shapes = _write_plane(outlines[0], holes, normal, contact.area)
    else:
        center = (np.array(contact.center) - shift) @ rotation
        width = _length(contact.length or 0.0)
        shapes = [f"band = {{ center = {_point(center)}, width = {width} }}"]
    return tuple(
        f'{{ face = "face:{face}"{shape} }}'
        for face, share in zip(contact.faces[side], contact.covered[side], strict=True)
        for shape in ([""] if share >= WHOLE else [f", {shape}" for shape in shapes])
    )


def outline_area(outline: FloatArray, normal: FloatArray) -> float:
    """Return the area within a closed outline ``(n, 3)`` on a plane with a unit normal ``(3,)``."""
    return abs(Polygon(outline @ plane_axes(normal).T).area)


def _write_plane(
    outline: FloatArray, holes: list[FloatArray], normal: FloatArray, area: float
) -> list[str]:
    """Return the shapes that make up an outline ``(n, 3)`` on a plane, without holes ``(m, 3)`` that
    the part does not have itself.
    """
    axes = plane_axes(normal)
    height = float(outline[0] @ normal) * normal
    holes = [hole for hole in holes if outline_area(hole, normal) > SMALL_HOLES * area]
    circle = _find_circle(outline @ axes.T)
    if circle is not None and len(holes) <= 1:
        center, radius = circle
        at = f"center = {_point(center @ axes + height)}, diameter = {_length(2.0 * radius)}"
        if not holes:
            return [f"disk = {{ {at} }}"]
        inner = _find_circle(holes[0] @ axes.T)
        if inner is not None and np.linalg.norm(inner[0] - center) <= ROUND * radius:
            return [f"ring = {{ {at}, inner = {_length(2.0 * inner[1])} }}"]
    pieces = _split_holes([outline @ axes.T], [hole @ axes.T for hole in holes])
    return [_write_corners(_find_corners(piece), axes, height) for piece in pieces]


def _write_corners(corners: FloatArray, axes: FloatArray, height: FloatArray) -> str:
    """Return the rectangle or the outline of corners ``(n, 2)``.

    Args:
        axes: Of the plane, ``(2, 3)``.
        height: From the origin to it, ``(3,)``.
    """
    sides = np.roll(corners, -1, axis=0) - corners
    lengths = np.linalg.norm(sides, axis=1)
    cosines = (sides * np.roll(sides, -1, axis=0)).sum(axis=1) / (lengths * np.roll(lengths, -1))
    if len(corners) != 4 or np.abs(cosines).max() > RIGHT_ANGLE:
        points = ", ".join(_point(corner @ axes + height) for corner in corners)
        return f"outline = {{ corners = [{points}] }}"
    # the side along the first axis, or nearest to it
    along = int(np.argmax(np.abs(sides[:2, 0]) / lengths[:2]))
    direction = sides[along] * np.sign(sides[along, 0])
    angle = float(np.arctan2(direction[1], direction[0]))
    turned = f', angle = "{np.degrees(angle):.6g} deg"' if abs(angle) > UPRIGHT else ""
    size = f"[{_length(lengths[along])}, {_length(lengths[1 - along])}]"
    middle = corners.mean(axis=0) @ axes + height
    return f"rect = {{ center = {_point(middle)}, size = {size}{turned} }}"


def _split_holes(outlines: list[FloatArray], holes: list[FloatArray]) -> list[FloatArray]:
    """Return outlines ``(n, 2)`` without holes that together cover what lies between outlines and
    holes: cut in two through the middle of a hole until none is left.
    """
    if not holes:
        return outlines
    middle = float(holes[0][:, 0].mean())
    pieces = []
    for sign in (1.0, -1.0):
        whole: list[list[FloatArray]] = [[], []]
        chains: list[FloatArray] = []
        for hollow, loop in [*((0, one) for one in outlines), *((1, one) for one in holes)]:
            inside = sign * (loop[:, 0] - middle) > 0.0
            if inside.all():
                whole[hollow].append(loop)
            elif inside.any():
                chains += _cut_loop(loop, inside, middle)
        pieces += _split_holes(whole[0] + _close_chains(chains), whole[1])
    return pieces


def _cut_loop(loop: FloatArray, inside: BoolArray, middle: float) -> list[FloatArray]:
    """Return the parts ``(k, 2)`` of a loop on one side of a line across the first axis, with the
    points where they end on it.
    """
    starts = np.flatnonzero(inside & ~np.roll(inside, 1))
    chains = []
    for start in starts:
        ring, within = np.roll(loop, -start, axis=0), np.roll(inside, -start)
        count = int(np.argmin(within))
        ends = []
        for point, beyond in ((ring[0], ring[-1]), (ring[count - 1], ring[count])):
            share = (middle - point[0]) / (beyond[0] - point[0])
            ends.append(point + share * (beyond - point))
        chains.append(np.vstack([ends[0], ring[:count], ends[1]]))
    return chains


def _close_chains(chains: list[FloatArray]) -> list[FloatArray]:
    """Join chains that end on a line across the first axis along every other span between their
    ends, and return the closed outlines.
    """
    ends = sorted((chain[end, 1], k, end) for k, chain in enumerate(chains) for end in (0, -1))
    partners = {}
    for one, other in zip(ends[::2], ends[1::2], strict=True):
        partners[one[1:]], partners[other[1:]] = other[1:], one[1:]
    outlines = []
    while partners:
        first = at = next(iter(partners))
        parts = []
        while at in partners:
            k, end = at
            parts.append(chains[k] if end == 0 else chains[k][::-1])
            leaving = (k, -1 - end)
            partners.pop(at)
            at = partners.pop(leaving)
        assert at == first
        outlines.append(np.concatenate(parts))
    return outlines


def _find_circle(points: FloatArray) -> tuple[FloatArray, float] | None:
    """Return centre ``(2,)`` and radius of a round outline ``(n, 2)``; None for others."""
    if len(points) < FEWEST_ROUND:
        return None
    center, radius = fit_circle(points)
    unevenness = np.abs(np.linalg.norm(points - center, axis=1) - radius).max()
    return (center, radius) if unevenness <= ROUND * radius else None


def _find_corners(points: FloatArray) -> FloatArray:
    """Return the fewest corners of a closed outline ``(n, 2)`` that keep its area."""
    limit = COARSEST * float(np.ptp(points, axis=0).max())
    area = Polygon(points).area
    while True:
        corners = _drop_points(points, limit)
        if abs(Polygon(corners).area - area) <= SAME_AREA * abs(area):
            return corners
        limit *= 0.5


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
