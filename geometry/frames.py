"""Right-handed Cartesian frames and the rigid-body maps between them."""

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

ORTHONORMALITY_TOLERANCE = 1e-9
DIRECTIONS = ("x", "y", "z")
DOF_NAMES = (*DIRECTIONS, "rx", "ry", "rz")


@dataclass(frozen=True, eq=False)
class Frame:
    """A position and an orientation.

    Attributes:
        origin: ``(3,)`` position of the origin in the parent frame [m].
        rotation: ``(3, 3)`` columns are the frame's axes in the parent frame.

    Raises:
        ValueError: The rotation is not a proper orthonormal matrix or a value is not finite.
    """

    origin: FloatArray = field(default_factory=lambda: np.zeros(3))
    rotation: FloatArray = field(default_factory=lambda: np.eye(3))

    def __post_init__(self) -> None:
        origin = np.array(self.origin, dtype=float)
        rotation = np.array(self.rotation, dtype=float)
        if origin.shape != (3,) or rotation.shape != (3, 3):
            raise ValueError(
                f"a frame needs an origin (3,) and a rotation (3, 3), got {origin.shape} and {rotation.shape}"
            )
        if not (np.isfinite(origin).all() and np.isfinite(rotation).all()):
            raise ValueError("a frame needs finite numbers")
        error = np.abs(rotation.T @ rotation - np.eye(3)).max()
        if error > ORTHONORMALITY_TOLERANCE or np.linalg.det(rotation) < 0.0:
            raise ValueError(
                f"a frame's axes must be orthonormal and right-handed; R^T R differs from 1 by {error:.2g}"
            )
        object.__setattr__(self, "origin", origin)
        object.__setattr__(self, "rotation", rotation)


def find_axis(direction: Iterable[float], tolerance: float = 1e-9) -> tuple[str, float] | None:
    """Return letter and sign of a unit vector along an axis; None for others.

    Args:
        tolerance: Of the cosine between both.
    """
    vector = np.array([*direction], dtype=float)
    axis = int(np.argmax(np.abs(vector)))
    along = float(vector[axis])
    return (DIRECTIONS[axis], float(np.sign(along))) if abs(along) > 1.0 - tolerance else None


def compose_frames(parent: Frame, child: Frame) -> Frame:
    """Return the child frame, given in the parent frame, expressed where the parent lives."""
    return Frame(parent.origin + parent.rotation @ child.origin, parent.rotation @ child.rotation)


def rotation_about(axis: FloatArray, angle: float) -> FloatArray:
    """Return the rotation matrix ``(3, 3)`` about an axis ``(3,)`` of any length by an angle [rad].

    Raises:
        ValueError: The axis has no length.

    Source: Rodrigues (1840).
    """
    axis = np.asarray(axis, dtype=float)
    length = float(np.linalg.norm(axis))
    if not length > 0.0 or not np.isfinite(length):
        raise ValueError("a rotation axis needs a finite length above zero")
    cross = skew(np.asarray(axis / length, dtype=float))
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross)


def axis_and_angle(rotation: FloatArray) -> tuple[FloatArray, float]:
    """Return the unit axis ``(3,)`` and the angle [rad], -pi to pi, of a rotation ``(3, 3)``."""
    axis = np.linalg.svd(rotation - np.eye(3))[2][2]
    odd = rotation - rotation.T
    sine = 0.5 * float(axis @ [odd[2, 1], odd[0, 2], odd[1, 0]])
    return axis, float(np.arctan2(sine, 0.5 * (np.trace(rotation) - 1.0)))


def frame_axes(primary: FloatArray, secondary: FloatArray | None = None) -> FloatArray:
    """Return the rotation ``(3, 3)`` whose x axis is ``primary`` and whose z axis lies closest to
    ``secondary``.

    Args:
        primary: Direction ``(3,)`` of the new x axis, any length.
        secondary: Direction ``(3,)`` for the new z axis; without it the global axis least aligned
            with ``primary`` is taken, z before y before x.

    Raises:
        ValueError: A direction has no length or both are parallel.
    """
    x = _unit(primary)
    if secondary is None:
        candidates = np.eye(3)[[2, 1, 0]]
        secondary = candidates[int(np.argmin(np.round(np.abs(candidates @ x), 6)))]
    z = np.asarray(secondary, dtype=float) - (np.asarray(secondary, dtype=float) @ x) * x
    if np.linalg.norm(z) < 1e-6 * np.linalg.norm(secondary):
        raise ValueError("the two directions of a joint frame are parallel")
    z = _unit(z)
    return np.column_stack([x, np.cross(z, x), z])


def skew(vector: FloatArray) -> FloatArray:
    """Return the matrix ``(3, 3)`` with ``skew(a) @ b == cross(a, b)``."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def rigid_map(points: FloatArray, origin: FloatArray) -> FloatArray:
    """Return the displacements of points under the six rigid motions about an origin.

    Args:
        points: ``(n, 3)`` positions [m].
        origin: ``(3,)`` reference point [m].

    Returns:
        ``(3 n, 6)``: rows x y z of each point, columns x y z rx ry rz, small rotations.
    """
    points = np.atleast_2d(np.asarray(points, dtype=float))
    arms = points - np.asarray(origin, dtype=float)
    result = np.zeros((len(points), 3, 6))
    result[:, :, :3] = np.eye(3)
    result[:, 0, 4], result[:, 0, 5] = arms[:, 2], -arms[:, 1]
    result[:, 1, 3], result[:, 1, 5] = -arms[:, 2], arms[:, 0]
    result[:, 2, 3], result[:, 2, 4] = arms[:, 1], -arms[:, 0]
    return result.reshape(-1, 6)


def rigid_transfer(source: FloatArray, target: FloatArray) -> FloatArray:
    """Return the matrix ``(6, 6)`` that carries the 6 motions of a rigid body at ``source`` to
    those at ``target`` (same axes).
    """
    transfer = np.eye(6)
    transfer[:3, 3:] = -skew(np.asarray(target, dtype=float) - np.asarray(source, dtype=float))
    return transfer


def rotate_dofs(rotation: FloatArray) -> FloatArray:
    """Return the matrix ``(6, 6)`` with a rotation ``(3, 3)`` for the translations and again for
    the rotations.
    """
    result = np.zeros((6, 6))
    result[:3, :3] = result[3:, 3:] = rotation
    return result


def _unit(vector: FloatArray) -> FloatArray:
    vector = np.asarray(vector, dtype=float)
    length = float(np.linalg.norm(vector))
    if not length > 0.0 or not np.isfinite(length):
        raise ValueError("a direction needs a finite length above zero")
    return np.asarray(vector / length)
