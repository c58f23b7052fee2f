"""Patches on curved faces: how a shape lies on one, wherever the face comes from."""

from dataclasses import dataclass, field

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Patch
from headstock.geometry.parts.plane_shapes import (
    PlaneShape,
    flatten_patch,
    plane_axes,
    strip_direction,
)

# cosine of the steepest slope of a face towards a patch that lies on it: beyond, the patch wraps
# around it and its outline no longer says what it takes
STEEPEST = 0.17
# to which the normals of a face that is moved in itself, relative to all, stand across that motion
MOTION_TOLERANCE = 1e-3
ASTRAY = 0.5  # sine between a band and the axis it is said to run along, at most
STEEPEST_PITCH = 0.15  # advance over way of a motion that counts as a rotation
SLOWEST = 0.2  # extent over radius of a rotation: a larger circle is a straight line
FLATTEST = 0.1  # cosine between the width of a band and the axis it goes around, at least


@dataclass(frozen=True, eq=False)
class CurvedPatch:
    """A patch laid on a curved face.

    A disk or another closed shape takes what lies under it, seen along the normal in its middle, on
    that side of the face. A strip takes what lies between two parallel planes, as far as the face
    goes: around a face of revolution, where it runs that way, a band between two parallels.

    Attributes:
        patch: As it was written; its size is in the unit of ``origin``.
        origin: Middle on the face, ``(3,)``.
        normal: Unit normal of the face there, ``(3,)``.
        axes: Unit in-plane axes there, ``(2, 3)``.
        shape: In that plane; None of a strip and a band.
        across: Unit normal ``(3,)`` of the planes beside a strip or a band.
        half_width: Half the distance of those planes.
        axis: A point ``(3,)`` of the axis that a band goes around, and its unit direction ``(3,)``;
            None where no motion of the face in itself runs along the strip.
    """

    patch: Patch
    origin: FloatArray
    normal: FloatArray
    axes: FloatArray
    shape: PlaneShape | None = None
    across: FloatArray = field(default_factory=lambda: np.zeros(3))
    half_width: float = 0.0
    axis: tuple[FloatArray, FloatArray] | None = None

    def depths(self, points: FloatArray) -> FloatArray:
        """Return how far points lie within the outline, seen along the normal: ``(n,)``, negative
        outside.

        Args:
            points: Of the face, ``(n, 3)``.
        """
        offset = points - self.origin
        if self.shape is not None:
            return self.shape.depths(offset @ self.axes.T)
        return self.half_width - np.abs(offset @ self.across)

    def clip(self, corners: FloatArray) -> FloatArray:
        """Return the parts ``(k, 3, 3)`` of triangles that lie within the outline, seen along the
        normal.

        Args:
            corners: Of the face, ``(m, 3, 3)``.
        """
        if self.shape is None:
            planes = [[(sign * self.across, self.half_width) for sign in (-1.0, 1.0)]]
        else:
            planes = [_list_sides(piece, self.axes) for piece in self.shape.pieces()]
        parts = []
        for sides in planes:
            part = corners
            for direction, reach in sides:
                part = _cut_triangles(part, reach - (part - self.origin) @ direction)
            parts.append(part)
        return np.concatenate(parts)

    def facing(self, points: FloatArray, normals: FloatArray) -> FloatArray:
        """Return the cosines ``(n,)`` between normals and that in the middle; around a band each is
        turned to the middle's meridian first.

        Args:
            points: Of the face, ``(n, 3)``.
            normals: Of the face there, ``(n, 3)``.
        """
        if self.axis is None:
            return normals @ self.normal
        on_axis, direction = self.axis
        radial = _reject(np.vstack([self.origin, points]) - on_axis, direction)
        radial /= np.maximum(np.linalg.norm(radial, axis=1), 1e-300)[:, None]
        outward = np.einsum("ni,ni->n", normals, radial[1:]) * float(self.normal @ radial[0])
        return outward + (normals @ direction) * float(self.normal @ direction)

    def gentleness(self, points: FloatArray, normals: FloatArray) -> FloatArray:
        """Return the cosines ``(n,)`` of how steeply the face meets the outline; small ones at
        places where the patch begins to wrap around it.

        Args:
            points: Of the face, ``(n, 3)``.
            normals: Of the face there, ``(n, 3)``.
        """
        if self.shape is not None or self.axis is not None:
            return self.facing(points, normals)
        return np.sqrt(np.clip(1.0 - (normals @ self.across) ** 2, 0.0, 1.0))


def _list_sides(polygon: FloatArray, axes: FloatArray) -> list[tuple[FloatArray, float]]:
    """Return the outward directions ``(3,)`` of a convex polygon's sides, and how far each lies out.

    Args:
        polygon: ``(k, 2)`` along in-plane axes ``(2, 3)``, anticlockwise.
    """
    edges = np.roll(polygon, -1, axis=0) - polygon
    outward = edges[:, ::-1] / np.hypot(*edges.T)[:, None] * [1.0, -1.0]
    reaches = np.einsum("ij,ij->i", outward, polygon)
    return [(side @ axes, float(reach)) for side, reach in zip(outward, reaches, strict=True)]


def _cut_triangles(corners: FloatArray, depths: FloatArray) -> FloatArray:
    """Return the parts ``(k, 3, 3)`` of triangles ``(m, 3, 3)`` on one side of a plane.

    Args:
        depths: Of the corners below the plane, ``(m, 3)``; negative ones are cut off.
    """
    inside = depths >= 0.0
    counts = inside.sum(axis=1)
    parts = [corners[counts == 3]]
    for count in (1, 2):
        some = counts == count
        # first the corner that is alone on its side, then the others in their order
        alone = (inside[some] == (count == 1)).argmax(axis=1)
        order = (alone[:, None] + np.arange(3)) % 3
        a, b, c = np.take_along_axis(corners[some], order[:, :, None], axis=1).transpose(1, 0, 2)
        below = np.take_along_axis(depths[some], order, axis=1)
        shares = below[:, :1] / (below[:, :1] - below[:, 1:])
        ab, ac = a + shares[:, :1] * (b - a), a + shares[:, 1:] * (c - a)
        kept = [(a, ab, ac)] if count == 1 else [(ab, b, c), (ab, c, ac)]
        parts += [np.stack(triangle, axis=1) for triangle in kept]
    return np.concatenate(parts)


def lay_patch(
    patch: Patch,
    origin: FloatArray,
    normal: FloatArray,
    points: FloatArray,
    normals: FloatArray,
    *,
    tolerance: float = MOTION_TOLERANCE,
) -> CurvedPatch:
    """Lay a patch on a curved face.

    Args:
        patch: A part of the face.
        origin: Point of the face in the patch's middle, ``(3,)``.
        normal: Unit normal there, ``(3,)``.
        points: Points all over the face, ``(n, 3)``.
        normals: Its unit normals there, ``(n, 3)``.
        tolerance: To which the normals are those of a smooth face.

    Raises:
        ValueError: A strip runs along no axis in the face, a band goes around no axis of it.
    """
    axes = plane_axes(normal)
    if patch.shape == "band":
        on_axis, direction = _find_only_axis(patch, origin, points, normals, tolerance)
        middle = origin + ((np.array(patch.center) - origin) @ direction) * direction
        around = (on_axis, direction)
        return CurvedPatch(patch, middle, normal, axes, None, direction, patch.size[0] / 2, around)
    if patch.shape != "strip":
        return CurvedPatch(patch, origin, normal, axes, flatten_patch(patch, axes))
    run = strip_direction(patch, axes)
    along, width = axes[run], axes[1 - run]
    axis = _find_axis(along, origin, points, normals, tolerance)
    # the meridian of a face that turns in itself, along which the width of a band is measured
    meridian = None if axis is None else np.cross(axis[1], origin - axis[0])
    straight = CurvedPatch(patch, origin, normal, axes, None, width, patch.size[0] / 2)
    if axis is None or meridian is None:
        return straight
    slope = abs(float(axis[1] @ np.cross(normal, meridian))) / float(np.linalg.norm(meridian))
    if slope < FLATTEST:
        return straight
    half = slope * patch.size[0] / 2
    return CurvedPatch(patch, origin, normal, axes, None, axis[1], half, axis)


def _find_motions(
    origin: FloatArray, points: FloatArray, normals: FloatArray, tolerance: float
) -> tuple[FloatArray, float]:
    """Return the rigid motions ``(m, 6)`` that move a face in itself, and the length to which their
    rotations refer.

    A velocity ``v(p) = t + w x p`` that is tangential all over the face satisfies ``n t + (p x n) w
    = 0``: cylinders have two such motions, spheres and planes three, other faces of revolution one.

    Args:
        origin: Point of the face, ``(3,)``, whose velocity is ``t``.
        points: All over the face, ``(n, 3)``.
        normals: Its unit normals there, ``(n, 3)``.

    Source: Pottmann and Wallner (2001), Computational Line Geometry, section 3.4.
    """
    offsets = points - origin
    scale = float(np.abs(offsets).max())
    rows = np.hstack([normals, np.cross(offsets / scale, normals)])
    _, sizes, shapes = np.linalg.svd(rows, full_matrices=True)
    sizes = np.pad(sizes, (0, 6 - len(sizes)))
    return shapes[sizes <= tolerance * sizes[0]], scale


def _find_only_axis(
    patch: Patch, origin: FloatArray, points: FloatArray, normals: FloatArray, tolerance: float
) -> tuple[FloatArray, FloatArray]:
    """Find the point and unit direction of the one axis about which a face turns in itself.

    Args:
        patch: A band, for the message.
        origin: Point of the face, ``(3,)``.
        points: All over the face, ``(n, 3)``.
        normals: Its unit normals there, ``(n, 3)``.

    Raises:
        ValueError: There is none, or several, as of planes and spheres.
    """
    motions, scale = _find_motions(origin, points, normals, tolerance)
    if 1 <= len(motions) <= 2:
        _, sizes, axes = np.linalg.svd(motions[:, 3:])
        direction = axes[0]
        single = len(motions) == 1 or sizes[1] <= np.sqrt(tolerance) * sizes[0]
        shares, *_ = np.linalg.lstsq(motions[:, 3:].T, direction, rcond=np.sqrt(tolerance))
        velocity, rotation = np.split(shares @ motions, 2)
        screws = abs(float(velocity @ direction)) > STEEPEST_PITCH
        if single and sizes[0] > SLOWEST and not screws:
            return origin + scale * np.cross(rotation, velocity), direction
    raise ValueError(
        f"a band goes around a cylinder or cone, and face {patch.face!r} is none; write a disk, rect, ring or strip"
    )


def _find_axis(
    along: FloatArray,
    origin: FloatArray,
    points: FloatArray,
    normals: FloatArray,
    tolerance: float,
) -> tuple[FloatArray, FloatArray] | None:
    """Find the point and unit direction of the axis about which a face turns in itself, moving a
    point of it more or less in a given direction; None where there is no such rotation.

    Args:
        along: Unit direction ``(3,)``.
        origin: Point of the face, ``(3,)``.
        points: All over the face, ``(n, 3)``.
        normals: Its unit normals there, ``(n, 3)``.
    """
    motions, scale = _find_motions(origin, points, normals, tolerance)
    if not len(motions):
        return None
    # offsets begin at the point, whose velocity is therefore t; the least motion does not spin there
    shares, *_ = np.linalg.lstsq(motions[:, :3].T, along, rcond=tolerance)
    velocity, rotation = np.split(shares @ motions, 2)
    rate = float(np.linalg.norm(rotation))
    pitch = abs(float(rotation @ velocity))
    astray = float(np.linalg.norm(velocity - along))
    if astray > ASTRAY or rate < SLOWEST or pitch > STEEPEST_PITCH * rate:
        return None
    middle: FloatArray = origin + scale * np.cross(rotation, velocity).astype(float) / rate**2
    return middle, (rotation / rate).astype(float)


def _reject(vectors: FloatArray, direction: FloatArray) -> FloatArray:
    """Return what of vectors ``(..., 3)`` stands across a unit direction ``(3,)``."""
    return vectors - (vectors @ direction)[..., None] * direction
