"""Bodies on axes that turn along a path: how each moves as a rigid one."""

from collections.abc import Mapping

import numpy as np

from headstock.geometry.frames import FloatArray, Frame
from headstock.geometry.machine.machine import (
    Machine,
    MachinePath,
    Pose,
    free_axes,
    place_components,
)
from headstock.pipeline.contours.ways import RigidWay, body_channels, load_bodies
from headstock.reduction.superelement import Superelement

STEP = 0.01  # of the fastest body, between frames from which its motion is differenced [rad]
# central differences of fourth order
FIRST = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / 12.0
SECOND = np.array([-1.0, 16.0, -30.0, 16.0, -1.0]) / 12.0


def turning_speeds(machine: Machine, path: MachinePath) -> dict[str, float]:
    """How fast each body on the rotary axes of a path turns at most, per speed along it."""
    shares = {
        axis: abs(path.end.positions.get(axis, 0.0) - path.start.positions.get(axis, 0.0))
        / path.length
        for axis in path.turning
    }
    names = dict.fromkeys(name for axis in shares for name in machine.axes[axis].moves)
    return {
        name: sum(share for axis, share in shares.items() if name in machine.axes[axis].moves)
        for name in names
    }


def turning_way(
    machine: Machine,
    superelements: Mapping[str, Superelement],
    path: MachinePath,
    speed: float,
    acceleration: float,
) -> RigidWay:
    """Axes that move along a path at a constant speed and acceleration, over its positions.

    A body at ``c(p)`` with the turn ``R(p)`` is accelerated by ``c'' v^2 + c' a`` and turned by
    ``alpha = w' v^2 + w a``, ``[w] = R' R^T``: tangential (Euler), centripetal and Coriolis terms of
    all axes together; its Euler moment ``w x I w v^2`` is as if it were turned faster.

    Args:
        machine: With the axes.
        superelements: By component.
        path: Of the axes.
        speed: Along it [m/s, rad/s].
        acceleration: Along it [m/s^2, rad/s^2].
    """
    speeds = turning_speeds(machine, path)
    step = STEP / max(speeds.values())
    moved = {name for axis in path.axes for name in machine.axes[axis].moves}
    names = tuple(name for name in superelements if name in moved)
    free = free_axes(machine)

    def place(position: float) -> dict[str, Frame]:
        first, share = path.start.positions, position / path.length
        places = {
            axis: first.get(axis, 0.0)
            + share * (path.end.positions.get(axis, 0.0) - first.get(axis, 0.0))
            for axis in {**first, **path.end.positions}
        }
        return place_components(free, Pose("on the path", places))

    def amounts(positions: FloatArray) -> FloatArray:
        found = []
        for position in positions:
            around = [place(float(position) + step * side) for side in range(-2, 3)]
            found.append(
                np.concatenate(
                    [
                        _move_body(
                            superelements[name],
                            [frames[name] for frames in around],
                            step,
                            speed,
                            acceleration,
                        )
                        for name in names
                    ]
                )
            )
        return np.array(found)

    return RigidWay(
        path.pose_at,
        lambda model: load_bodies(model, names),
        amounts,
        body_channels(names),
        turning=tuple(name for name in names if name in speeds),
    )


def _move_body(
    body: Superelement, frames: list[Frame], step: float, speed: float, acceleration: float
) -> FloatArray:
    """Acceleration ``(6,)`` of a body in the middle of five frames of its path, of its centre of mass
    and about it.
    """
    turns = np.array([frame.rotation for frame in frames])
    centers = np.array([frame.origin + frame.rotation @ body.center_of_mass for frame in frames])
    turn, turned = turns[2], np.tensordot(FIRST, turns, 1) / step
    twice = np.tensordot(SECOND, turns, 1) / step**2
    omega = _axial(turned @ turn.T)
    alpha = _axial(twice @ turn.T) * speed**2 + omega * acceleration
    inertia = turn @ body.inertia @ turn.T
    moment = np.cross(omega, inertia @ omega) * speed**2
    # a point mass without inertia takes no moment
    spin = alpha + np.linalg.lstsq(inertia, moment)[0]
    center = (SECOND @ centers) / step**2 * speed**2 + (FIRST @ centers) / step * acceleration
    return np.concatenate([center, spin])


def _axial(matrix: FloatArray) -> FloatArray:
    """Vector of the antisymmetric part of a matrix."""
    odd = 0.5 * (matrix - matrix.T)
    return np.array([odd[2, 1], odd[0, 2], odd[1, 0]])
