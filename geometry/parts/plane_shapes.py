"""Shapes of patches in their plane: disks, rings and polygons, each with its area, its rim and what lies
within. ``SHAPES`` has them by name.

Coordinates are those along two in-plane axes, from the centre of the patch.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Patch

STRAIGHT_SIDES = 32  # of the polygon that is drawn for a circle
IN_FACE = 0.5  # cosine between the axis a strip runs along and its direction on the face, at least
CONVEX = 1e-12  # of the largest turn of an outline: how far a corner of a convex one may turn back


@dataclass(frozen=True, eq=False)
class Circle:
    """A disk, or a ring.

    Attributes:
        radius: Outer one.
        hole: Radius of the hole of a ring; 0 for a disk.
    """

    radius: float
    hole: float = 0.0

    @property
    def area(self) -> float:
        """Without its hole."""
        return math.pi * (self.radius**2 - self.hole**2)

    @property
    def perimeter(self) -> float:
        """Length of all its rims."""
        return 2.0 * math.pi * (self.radius + self.hole)

    @property
    def width(self) -> float:
        """Where it is narrowest."""
        return self.radius - self.hole if self.hole else 2.0 * self.radius

    @property
    def centroid(self) -> FloatArray:
        """``(2,)``."""
        return np.zeros(2)

    @property
    def bounds(self) -> FloatArray:
        """Lower and upper corner ``(2, 2)`` of the rectangle around it."""
        return np.array([[-self.radius] * 2, [self.radius] * 2])

    def farthest(self, point: FloatArray) -> float:
        """Return how far it reaches from a point ``(2,)``."""
        return float(np.hypot(*point)) + self.radius

    def depths(self, points: FloatArray) -> FloatArray:
        """Return how far points ``(n, 2)`` lie within, ``(n,)``; negative outside."""
        distances = np.hypot(points[:, 0], points[:, 1])
        inside = self.radius - distances
        return np.minimum(inside, distances - self.hole) if self.hole else inside

    def rim(self, count: int, inset: float) -> FloatArray:
        """Return points ``(count, 2)`` on the outer rim, moved inwards."""
        angles = 2.0 * math.pi * (np.arange(count) + 0.5) / count
        return (self.radius - inset) * np.column_stack([np.cos(angles), np.sin(angles)])

    def pieces(self) -> list[FloatArray]:
        """Return convex polygons ``(k, 2)`` that make it up, anticlockwise, for drawings."""
        angles = 2.0 * math.pi * (np.arange(STRAIGHT_SIDES) + 0.5) / STRAIGHT_SIDES
        around = np.column_stack([np.cos(angles), np.sin(angles)])
        around /= math.cos(math.pi / STRAIGHT_SIDES)
        outer, inner = self.radius * around, self.hole * around
        if not self.hole:
            return [outer]
        return [
            np.array([inner[i - 1], outer[i - 1], outer[i], inner[i]])
            for i in range(STRAIGHT_SIDES)
        ]

    def kinks(self, direction: int) -> list[float]:
        """Return where along an axis its chords change abruptly."""
        return [-self.hole, self.hole] if self.hole else []

    def chords(self, direction: int, positions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return middles and half lengths ``(n, k)`` of the chords across an axis at positions ``(n,)``."""
        outer = np.sqrt(np.maximum(0.0, self.radius**2 - positions**2))
        if not self.hole:
            return np.zeros((len(positions), 1)), outer[:, None]
        inner = np.sqrt(np.maximum(0.0, self.hole**2 - positions**2))
        middles, halves = 0.5 * (outer + inner), 0.5 * (outer - inner)
        return np.column_stack([-middles, middles]), np.column_stack([halves, halves])


@dataclass(frozen=True, eq=False)
class Polygon:
    """What lies inside a closed outline.

    Attributes:
        corners: ``(n, 2)``, anticlockwise.
    """

    corners: FloatArray

    @property
    def _edges(self) -> FloatArray:
        """From each corner to the next, ``(n, 2)``."""
        return np.roll(self.corners, -1, axis=0) - self.corners

    @property
    def area(self) -> float:
        """Of the inside."""
        return 0.5 * float(_cross(self.corners, np.roll(self.corners, -1, axis=0)).sum())

    @property
    def perimeter(self) -> float:
        """Length of the outline."""
        return float(np.hypot(*self._edges.T).sum())

    @property
    def width(self) -> float:
        """Where it is narrowest: across one of its sides, or as thin as area and outline say."""
        normals = self._edges[:, ::-1] / np.hypot(*self._edges.T)[:, None] * [1.0, -1.0]
        calipers = np.ptp(self.corners @ normals.T, axis=0)
        return float(min(calipers.min(), 4.0 * self.area / self.perimeter))

    @property
    def centroid(self) -> FloatArray:
        """``(2,)``."""
        after = np.roll(self.corners, -1, axis=0)
        weights = _cross(self.corners, after)
        return np.asarray(weights @ (self.corners + after) / (3.0 * weights.sum()))

    @property
    def bounds(self) -> FloatArray:
        """Lower and upper corner ``(2, 2)`` of the rectangle around it."""
        return np.array([self.corners.min(axis=0), self.corners.max(axis=0)])

    def farthest(self, point: FloatArray) -> float:
        """Return how far it reaches from a point ``(2,)``."""
        return float(np.hypot(*(self.corners - point).T).max())

    def depths(self, points: FloatArray) -> FloatArray:
        """Return how far points ``(n, 2)`` lie within, ``(n,)``; negative outside."""
        edges, offsets = self._edges, points[:, None] - self.corners
        shares = np.einsum("nij,ij->ni", offsets, edges) / (edges**2).sum(axis=1)
        away = offsets - np.clip(shares, 0.0, 1.0)[..., None] * edges
        distances = np.hypot(away[..., 0], away[..., 1]).min(axis=1)
        # a ray along the first axis leaves the outline once more often than it enters
        above = offsets[..., 1] >= 0.0
        crossed = (above != np.roll(above, -1, axis=1)) & (
            (_cross(edges, offsets) > 0.0) == (edges[:, 1] > 0.0)
        )
        return np.where(crossed.sum(axis=1) % 2 == 1, distances, -distances)

    def rim(self, count: int, inset: float) -> FloatArray:
        """Return points ``(m, 2)`` along the outline, at least one a side, moved inwards."""
        lengths = np.hypot(*self._edges.T)
        places = []
        for corner, edge, length in zip(self.corners, self._edges, lengths, strict=True):
            steps = max(1, math.ceil(count * length / lengths.sum()))
            shares = (np.arange(steps) + 0.5) / steps
            inwards = np.array([-edge[1], edge[0]]) / length
            places.append(corner + shares[:, None] * edge + inset * inwards)
        return np.vstack(places)

    def pieces(self) -> list[FloatArray]:
        """Return convex polygons ``(k, 2)`` that make it up, anticlockwise: itself, or its ears.

        Source: Meisters (1975), Polygons have ears.
        """
        left, pieces = list(range(len(self.corners))), []
        while not _is_convex(self.corners[left]):
            ear = next(i for i in range(len(left)) if self._is_ear(left, i))
            pieces.append(self.corners[[left[ear - 1], left[ear], left[(ear + 1) % len(left)]]])
            del left[ear]
        return [*pieces, self.corners[left]]

    def _is_ear(self, left: list[int], i: int) -> bool:
        """Return whether a corner of those that are left can be cut off: no other lies within."""
        triangle = self.corners[[left[i - 1], left[i], left[(i + 1) % len(left)]]]
        others = [corner for corner in left if not (triangle == self.corners[corner]).all(1).any()]
        if not _is_convex(triangle):
            return False
        return not others or bool((Polygon(triangle).depths(self.corners[others]) < 0.0).all())

    def kinks(self, direction: int) -> list[float]:
        """Return where along an axis its chords change abruptly."""
        return sorted({float(corner) for corner in self.corners[:, direction]})

    def chords(self, direction: int, positions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return middles and half lengths ``(n, k)`` of the chords across an axis at positions ``(n,)``."""
        start, stop = self.corners, np.roll(self.corners, -1, axis=0)
        low, high = start[:, direction], stop[:, direction]
        rows = []
        for position in positions:
            cut = (low <= position) != (high <= position)
            shares = (position - low[cut]) / (high - low)[cut]
            across = 1 - direction
            ends = np.sort(start[cut, across] + shares * (stop - start)[cut, across])
            rows.append(ends.reshape(-1, 2))
        most = max((len(row) for row in rows), default=0)
        pairs = np.array([np.pad(row, ((0, most - len(row)), (0, 0))) for row in rows])
        return pairs.mean(axis=2), 0.5 * (pairs[..., 1] - pairs[..., 0])


PlaneShape = Circle | Polygon


def find_outline_fault(corners: FloatArray, *, flatness: float) -> str:
    """Say why corners ``(n, 3)`` are no outline in a plane; empty where they are one.

    Args:
        flatness: How far corners may lie beside one plane, over the extent of all.
    """
    offsets = corners - corners.mean(axis=0)
    extent = float(np.abs(offsets).max())
    _, _, axes = np.linalg.svd(offsets)
    if not extent or np.abs(offsets @ axes[2]).max() > flatness * extent:
        return "its corners lie in no plane; write those of a plane face"
    flat = offsets @ axes[:2].T
    count = len(flat)
    for i in range(count):
        if np.hypot(*(flat[i - 1] - flat[i])) <= flatness * extent:
            return f"two of its corners in a row, up to number {i + 1}, are the same; leave one out"
        for j in range(i + 1, count):
            near = (j - i) % count in (1, count - 1)
            if not near and _meet(flat[i - 1], flat[i], flat[j - 1], flat[j]):
                return f"its sides to corners {i + 1} and {j + 1} cross; write the corners in their order"
    if abs(Polygon(flat).area) <= flatness * extent**2:
        return "it encloses no area; write at least three corners that lie on no line"
    return ""


def _meet(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> bool:
    """Return whether two sides cross."""
    first, second = _cross(b - a, np.array([c, d]) - a), _cross(d - c, np.array([a, b]) - c)
    return bool(np.prod(first) < 0.0 and np.prod(second) < 0.0)


def _cross(first: FloatArray, second: FloatArray) -> FloatArray:
    return np.asarray(first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0])


def _is_convex(corners: FloatArray) -> bool:
    edges = np.roll(corners, -1, axis=0) - corners
    turns = _cross(edges, np.roll(edges, -1, axis=0))
    return bool(turns.min() >= -CONVEX * np.abs(turns).max())


def plane_axes(normal: FloatArray) -> FloatArray:
    """Return the two global axes that lie most in a plane, in the order x y z, made orthonormal
    within it: ``(2, 3)``.

    Args:
        normal: Unit normal of the plane, ``(3,)``.
    """
    first, second = (axis for axis in range(3) if axis != int(np.argmax(np.abs(normal))))
    a, b = (np.eye(3)[axis] - normal[axis] * normal for axis in (first, second))
    a /= np.linalg.norm(a)
    b -= (b @ a) * a
    return np.array([a, b / np.linalg.norm(b)])


def strip_direction(patch: Patch, axes: FloatArray) -> int:
    """Return which of two in-plane axes ``(2, 3)`` a strip runs along: 0 or 1.

    Raises:
        ValueError: It runs along no axis that lies in the plane.
    """
    shares = np.abs(axes @ np.array([float(patch.along == axis) for axis in "xyz"]))
    if shares.max() < IN_FACE:
        raise ValueError(
            f"a strip on face {patch.face!r} needs 'along' set to an axis in that face, not {patch.along!r}"
        )
    return 0 if shares[0] >= shares[1] else 1


def _turn_rect(patch: Patch, axes: FloatArray, reach: float) -> Polygon:
    half = 0.5 * np.array(patch.size)
    return _make_rectangle(half, patch.angle)


def _lay_strip(patch: Patch, axes: FloatArray, reach: float) -> Polygon:
    half = np.full(2, 0.5 * patch.size[0])
    half[strip_direction(patch, axes)] = reach
    return _make_rectangle(half)


def _make_rectangle(half: FloatArray, angle: float = 0.0) -> Polygon:
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half
    if not angle:
        return Polygon(corners)
    cosine, sine = math.cos(angle), math.sin(angle)
    return Polygon(corners @ np.array([[cosine, sine], [-sine, cosine]]))


def _flatten(patch: Patch, axes: FloatArray, reach: float) -> Polygon:
    shape = Polygon((np.array(patch.corners) - patch.center) @ axes.T)
    return shape if shape.area > 0.0 else Polygon(shape.corners[::-1])


# what each is in a plane with in-plane axes ``(2, 3)``; a strip goes as far as it is said to reach
SHAPES: dict[str, Callable[[Patch, FloatArray, float], PlaneShape]] = {
    "disk": lambda patch, axes, reach: Circle(0.5 * patch.size[0]),
    "ring": lambda patch, axes, reach: Circle(0.5 * patch.size[0], 0.5 * patch.size[1]),
    "rect": _turn_rect,
    "strip": _lay_strip,
    "outline": _flatten,
}


def flatten_patch(patch: Patch, axes: FloatArray, reach: float = math.inf) -> PlaneShape:
    """Return the shape of a patch in a plane.

    Args:
        axes: In-plane axes, ``(2, 3)``.
        reach: How far a strip goes to either side.

    Raises:
        ValueError: It has none: a strip runs along no axis in the plane, a band goes around a cylinder.
    """
    if patch.shape not in SHAPES:
        raise ValueError(
            f"a {patch.shape} goes around a cylinder, and face {patch.face!r} is none; write one of {', '.join(SHAPES)}"
        )
    return SHAPES[patch.shape](patch, axes, reach)


def patch_width(patch: Patch) -> float:
    """Return how wide a patch is where it is narrowest [m]; strips and bands go on across it."""
    if patch.corners:
        offsets = np.array(patch.corners) - patch.center
        _, _, axes = np.linalg.svd(offsets)
        return _flatten(patch, axes[:2], 0.0).width
    if patch.shape == "ring":
        return 0.5 * (patch.size[0] - patch.size[1])
    return min(patch.size)
