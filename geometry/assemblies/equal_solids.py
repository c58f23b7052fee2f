"""Which solids of an assembly have one shape, and the rigid motions between them, from points that
every copy of a shape has: its corners, and the centroids of its edges and faces.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from headstock.geometry.assemblies.parts import Placement
from headstock.geometry.frames import FloatArray, rotation_about
from headstock.geometry.parts.cad_faces import Vector
from headstock.geometry.parts.skins import IntArray

SAME_SIZE = 1e-5  # relative: volumes, areas and lengths of copies
# copies in files differ by up to 2e-8 m; a hole that is 1e-5 m elsewhere is another part
SAME_PLACE = 2e-6
FAR = 10.0 * SAME_PLACE  # what three points leave for all to be fitted
STRAIGHT = 1e-3  # of the extent: points as close to a line do not fix the rotation about it
MOST_CANDIDATES = (
    4096  # of one triad: shapes with more symmetries than that are not searched further
)


@dataclass(frozen=True, eq=False)
class SolidPoints:
    """Labelled points of a solid.

    Attributes:
        volume: [m^3].
        center: Of mass ``(3,)`` [m].
        points: ``(n, 3)`` [m].
        dimensions: ``(n,)`` 0 a corner, 1 an edge, 2 a face.
        sizes: ``(n,)`` length of the edge [m], area of the face [m^2]; 0 of corners.
        product: Number of its product in the file; None where it has none.
        rotation: From its product to the file ``(3, 3)``, NaN where it is not known.
    """

    volume: float
    center: FloatArray
    points: FloatArray
    dimensions: IntArray
    sizes: FloatArray
    product: int | None = None
    rotation: FloatArray = field(default_factory=lambda: np.full((3, 3), np.nan))

    @cached_property
    def arms(self) -> FloatArray:
        """Points from the centre of mass ``(n, 3)`` [m]."""
        return self.points - self.center

    @cached_property
    def counts(self) -> tuple[int, ...]:
        """Number of corners, edges and faces."""
        return tuple(int(count) for count in np.bincount(self.dimensions, minlength=3))


@dataclass(frozen=True, eq=False)
class Motion:
    """Rigid motion ``x' = rotation @ x + shift`` between two solids, and the largest distance of
    labelled points after it [m].
    """

    rotation: FloatArray
    shift: FloatArray
    residual: float

    def placement(self, solid: int) -> Placement:
        """Return it as the placement of a solid."""
        x, y, z = (_vector(row) for row in self.rotation)
        return Placement(solid, (x, y, z), _vector(self.shift), self.residual)


IDENTITY = Motion(np.eye(3), np.zeros(3), 0.0)


def group_equal(solids: Sequence[SolidPoints]) -> list[list[tuple[int, Motion]]]:
    """Group solids of one shape.

    Returns:
        Per shape the indices of its solids, the smallest first, each with its motion from the first.
    """
    groups: list[list[tuple[int, Motion]]] = []
    for index, solid in enumerate(solids):
        for group in groups:
            motion = find_motion(solids[group[0][0]], solid)
            if motion is not None:
                group.append((index, motion))
                break
        else:
            groups.append([(index, IDENTITY)])
    return groups


def find_motion(first: SolidPoints, second: SolidPoints) -> Motion | None:
    """Find the rigid motion that moves one solid to another: that of their product's tree where it
    fits, else of those that do the one that rotates least; None where their shapes differ. A mirrored
    solid differs unless it is its own mirror image.
    """
    if first.counts != second.counts:
        return None
    if abs(first.volume - second.volume) > SAME_SIZE * first.volume:
        return None
    labels = _label_together(first, second)
    if labels is None:
        return None
    stated = second.rotation @ first.rotation.T
    if first.product == second.product and np.isfinite(stated).all():
        motion = _fit_motion(first, second, labels, stated)
        if motion is not None:
            return motion
    motions = (
        _fit_motion(first, second, labels, rotation) for rotation in _propose(first, second, labels)
    )
    fitting = [motion for motion in motions if motion is not None]
    return max(fitting, key=lambda motion: round(float(np.trace(motion.rotation)), 6), default=None)


def _label_together(first: SolidPoints, second: SolidPoints) -> tuple[IntArray, IntArray] | None:
    """Return equal numbers for points that may be one another's copies: of equal dimension, size and
    distance from the centre of mass; None where the solids have other numbers of any.
    """
    both = (first, second)
    split = len(first.points)
    labels = np.concatenate([one.dimensions for one in both])
    sizes = np.concatenate([one.sizes for one in both])
    radii = np.concatenate([np.linalg.norm(one.arms, axis=1) for one in both])
    labels = _refine_labels(labels, sizes, SAME_SIZE * np.maximum(sizes, 1e-12))
    labels = _refine_labels(labels, radii, np.full(len(radii), SAME_PLACE))
    halves = (labels[:split], labels[split:])
    one, other = (np.bincount(half, minlength=labels.max() + 1) for half in halves)
    return halves if np.array_equal(one, other) else None


def _refine_labels(labels: IntArray, values: FloatArray, tolerances: FloatArray) -> IntArray:
    """Split labels ``(n,)`` where sorted values ``(n,)`` of one label have a gap."""
    order = np.lexsort((values, labels))
    ordered, sorted_labels = values[order], labels[order]
    new = (np.diff(sorted_labels) != 0) | (np.diff(ordered) > tolerances[order][1:])
    refined = np.empty_like(labels)
    refined[order] = np.concatenate([[0], np.cumsum(new)])
    return refined


def _propose(
    first: SolidPoints, second: SolidPoints, labels: tuple[IntArray, IntArray]
) -> list[FloatArray]:
    """Return the rotations ``(3, 3)`` that move a triad of the first solid, its centre of mass and two
    points of rare labels, to one of the second.
    """
    extent = float(np.abs(first.arms).max(initial=0.0))
    counts = np.bincount(labels[0])[labels[0]]
    radii = np.linalg.norm(first.arms, axis=1)
    away = np.flatnonzero(radii > STRAIGHT * extent)
    if not len(away):
        return [np.eye(3)]
    a = int(away[np.lexsort((-radii[away], counts[away]))[0]])
    heights = np.linalg.norm(np.cross(first.arms, first.arms[a] / radii[a]), axis=1)
    aside = np.flatnonzero(heights > STRAIGHT * extent)
    starts = np.flatnonzero(labels[1] == labels[0][a])
    if not len(aside):
        return [_turn_onto(first.arms[a], second.arms[start]) for start in starts]
    b = int(aside[np.lexsort((-heights[aside], counts[aside]))[0]])
    ends = np.flatnonzero(labels[1] == labels[0][b])
    distance = float(np.linalg.norm(first.arms[b] - first.arms[a]))
    apart = np.linalg.norm(second.arms[ends][None] - second.arms[starts][:, None], axis=2)
    pairs = np.argwhere(np.abs(apart - distance) < 4.0 * SAME_PLACE)[:MOST_CANDIDATES]
    frame = point_frame(first.arms[a], first.arms[b])
    return [point_frame(second.arms[starts[i]], second.arms[ends[j]]) @ frame.T for i, j in pairs]


def _fit_motion(
    first: SolidPoints, second: SolidPoints, labels: tuple[IntArray, IntArray], rotation: FloatArray
) -> Motion | None:
    """Return the motion that fits all points best, from a rotation that fits three of them; None
    where points have no partner.
    """
    partners, distance = _match(first.arms @ rotation.T, second.arms, labels)
    if distance > FAR:
        return None
    # Kabsch (1976), about the centres of mass; points on a line leave the rotation as it was
    moved = first.arms @ rotation.T
    u, _, vt = np.linalg.svd(second.arms[partners].T @ moved + 1e-9 * np.eye(3))
    correction = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    better = np.linalg.norm(moved @ correction.T - second.arms[partners], axis=1).max(initial=0.0)
    if better < distance:
        rotation, distance = correction @ rotation, float(better)
    if distance > SAME_PLACE:
        return None
    return Motion(rotation, second.center - rotation @ first.center, distance)


def _match(
    moved: FloatArray, target: FloatArray, labels: tuple[IntArray, IntArray]
) -> tuple[IntArray, float]:
    """Return for each moved point ``(n, 3)`` the nearest target ``(n, 3)`` of its label, and the
    largest distance of any point from a partner.
    """
    partners = np.zeros(len(moved), dtype=np.int64)
    largest = 0.0
    for label in range(labels[0].max() + 1):
        mine, theirs = (np.flatnonzero(part == label) for part in labels)
        apart = np.linalg.norm(moved[mine][:, None] - target[theirs][None], axis=2)
        partners[mine] = theirs[apart.argmin(axis=1)]
        largest = max(largest, *(float(apart.min(axis=axis).max()) for axis in (0, 1)))
        if largest > FAR:
            break
    return partners, largest


def point_frame(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the frame ``(3, 3)``, axes in columns, along an arm ``(3,)`` and in the plane of it and
    another ``(3,)``.
    """
    x = a / np.linalg.norm(a)
    z = np.cross(x, b)
    z /= np.linalg.norm(z)
    return np.column_stack([x, np.cross(z, x), z])


def _turn_onto(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the smallest rotation ``(3, 3)`` of one direction onto another."""
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    axis: FloatArray = np.cross(a, b).astype(float)
    sine = float(np.linalg.norm(axis))
    if sine < 1e-12:
        if a @ b > 0.0:
            return np.eye(3)
        axis = np.cross(a, np.eye(3)[np.abs(a).argmin()]).astype(float)
    return rotation_about(axis, float(np.arctan2(sine, a @ b)))


def _vector(values: FloatArray) -> Vector:
    x, y, z = (float(value) for value in values)
    return x, y, z
