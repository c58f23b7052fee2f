"""Patches on curved faces: how a disk, a rect or a strip lies on one, wherever the face comes from."""

from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Patch

# cosine of the steepest slope of a face towards a patch that lies on it: beyond, the patch wraps
# around it and its outline no longer says what it takes
STEEPEST = 0.17
IN_FACE = 0.5  # cosine between the axis a strip runs along and its direction on the face, at least
# to which the normals of a face that is moved in itself, relative to all, stand across that motion
MOTION_TOLERANCE = 1e-3
ASTRAY = 0.5  # sine between a band and the axis it is said to run along, at most
STEEPEST_PITCH = 0.15  # advance over way of a motion that counts as a rotation
SLOWEST = 0.2  # extent over radius of a rotation: a larger circle is a straight line
DISK_SIDES = 32  # of the polygon that is drawn for a disk
FLATTEST = 0.1  # cosine between the width of a band and the axis it goes around, at least


@dataclass(frozen=True, eq=False)
class CurvedPatch:
    """A patch laid on a curved face.

    A disk or a rect takes what lies under its outline, seen along the normal in its middle, on that
    side of the face. A strip takes what lies between two parallel planes, as far as the face goes:
    around a face of revolution, where it runs that way, a band between two parallels.

    Attributes:
        patch: As it was written; its size is in the unit of ``origin``.
        origin: Middle on the face, ``(3,)``.
        normal: Unit normal of the face there, ``(3,)``.
        first: Unit in-plane axis ``(3,)`` there, that of the first size of a rect.
        second: The other one, ``(3,)``.
        across: Unit normal ``(3,)`` of the planes beside a strip; None of a disk or a rect.
        half_width: Half the distance of those planes.
        axis: A point ``(3,)`` of the axis that a band goes around, and its unit direction ``(3,)``;
            None where no motion of the face in itself runs along the strip.
    """

    patch: Patch
    origin: FloatArray
    normal: FloatArray
    first: FloatArray
    second: FloatArray
    across: FloatArray | None = None
    half_width: float = 0.0
    axis: tuple[FloatArray, FloatArray] | None = None

    def depths(self, points: FloatArray) -> FloatArray:
        """Return how far points lie within the outline, seen along the normal: ``(n,)``, negative
        outside.

        Args:
            points: Of the face, ``(n, 3)``.
        """
        offset = points - self.origin
        if self.across is not None:
            return self.half_width - np.abs(offset @ self.across)
        a, b = offset @ self.first, offset @ self.second
        if self.patch.shape == "disk":
            return self.patch.size[0] / 2 - np.hypot(a, b)
        return np.minimum(self.patch.size[0] / 2 - np.abs(a), self.patch.size[1] / 2 - np.abs(b))

    def clip(self, corners: FloatArray) -> FloatArray:
        """Return the parts ``(k, 3, 3)`` of triangles that lie within the outline, seen along the
        normal.

        Args:
            corners: Of the face, ``(m, 3, 3)``.
        """
        if self.across is not None:
            sides = [(sign * self.across, self.half_width) for sign in (-1.0, 1.0)]
        elif self.patch.shape == "disk":
            angles = 2.0 * np.pi * np.arange(DISK_SIDES) / DISK_SIDES
            around = np.column_stack([np.cos(angles), np.sin(angles)])
            outward = around @ np.array([self.first, self.second])
            sides = [(direction, self.patch.size[0] / 2) for direction in outward]
        else:
            sides = [
                (sign * direction, size / 2)
                for direction, size in zip((self.first, self.second), self.patch.size, strict=True)
                for sign in (-1.0, 1.0)
            ]
        for direction, reach in sides:
            corners = _cut_triangles(corners, reach - (corners - self.origin) @ direction)
        return corners

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
        if self.across is None or self.axis is not None:
            return self.facing(points, normals)
        return np.sqrt(np.clip(1.0 - (normals @ self.across) ** 2, 0.0, 1.0))


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


def plane_axes(normal: FloatArray) -> FloatArray:
    """Return the two global axes that lie most in a plane, in the order x y z, made orthonormal
    within it: ``(2, 3)``.

    Args:
        normal: Unit normal of the plane, ``(3,)``.
    """
    first, second = (axis for axis in range(3) if axis != int(np.argmax(np.abs(normal))))
    a = _reject(np.eye(3)[first], normal)
    a /= np.linalg.norm(a)
    b = _reject(np.eye(3)[second], normal)
    b -= (b @ a) * a
    return np.array([a, b / np.linalg.norm(b)])


def strip_axes(patch: Patch, normal: FloatArray) -> FloatArray:
    """Return the unit directions along and across a strip in a plane, ``(2, 3)``.

    Args:
        normal: Unit normal of the plane, ``(3,)``.

    Raises:
        ValueError: It runs along no axis that lies in the plane.
    """
    axes = plane_axes(normal)
    shares = np.abs(axes @ np.array([float(patch.along == axis) for axis in "xyz"]))
    if shares.max() < IN_FACE:
        raise ValueError(
            f"a strip on face {patch.face!r} needs 'along' set to an axis in that face, not {patch.along!r}"
        )
    return axes if shares[0] >= shares[1] else axes[::-1]


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
        patch: A disk, rect or strip.
        origin: Point of the face in the patch's middle, ``(3,)``.
        normal: Unit normal there, ``(3,)``.
        points: Points all over the face, ``(n, 3)``.
        normals: Its unit normals there, ``(n, 3)``.
        tolerance: To which the normals are those of a smooth face.

    Raises:
        ValueError: A strip runs along no axis in the face.
    """
    first, second = plane_axes(normal)
    if patch.shape != "strip":
        return CurvedPatch(patch, origin, normal, first, second)
    along, width = strip_axes(patch, normal)
    axis = _find_axis(along, origin, points, normals, tolerance)
    # the meridian of a face that turns in itself, along which the width of a band is measured
    meridian = None if axis is None else np.cross(axis[1], origin - axis[0])
    if axis is None or meridian is None:
        return CurvedPatch(patch, origin, normal, first, second, width, patch.size[0] / 2)
    slope = abs(float(axis[1] @ np.cross(normal, meridian))) / float(np.linalg.norm(meridian))
    if slope < FLATTEST:
        return CurvedPatch(patch, origin, normal, first, second, width, patch.size[0] / 2)
    half = slope * patch.size[0] / 2
    return CurvedPatch(patch, origin, normal, first, second, axis[1], half, axis)


def _find_axis(
    along: FloatArray,
    origin: FloatArray,
    points: FloatArray,
    normals: FloatArray,
    tolerance: float,
) -> tuple[FloatArray, FloatArray] | None:
    """Find the point and unit direction of the axis about which a face turns in itself, moving a
    point of it more or less in a given direction; None where there is no such rotation.

    A velocity ``v(p) = t + w x p`` that is tangential all over the face satisfies ``n t + (p x n) w
    = 0``: cylinders have two such motions, spheres three, other faces of revolution one.

    Args:
        along: Unit direction ``(3,)``.
        origin: Point of the face, ``(3,)``.
        points: All over the face, ``(n, 3)``.
        normals: Its unit normals there, ``(n, 3)``.

    Source: Pottmann and Wallner (2001), Computational Line Geometry, section 3.4.
    """
    offsets = points - origin
    scale = float(np.abs(offsets).max())
    rows = np.hstack([normals, np.cross(offsets / scale, normals)])
    _, sizes, shapes = np.linalg.svd(rows, full_matrices=True)
    sizes = np.pad(sizes, (0, 6 - len(sizes)))
    motions = shapes[sizes <= tolerance * sizes[0]]
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
    return origin + scale * np.cross(rotation, velocity) / rate**2, rotation / rate


def _reject(vectors: FloatArray, direction: FloatArray) -> FloatArray:
    """Return what of vectors ``(..., 3)`` stands across a unit direction ``(3,)``."""
    return vectors - (vectors @ direction)[..., None] * direction
