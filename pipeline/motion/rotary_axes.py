"""Bodies on axes that turn along a path: how each moves as a rigid one."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from types import MappingProxyType

import numpy as np

from headstock.geometry.frames import DOF_NAMES, FloatArray, Frame
from headstock.geometry.machine.machine import (
    Machine,
    MachinePath,
    Pose,
    free_axes,
    place_components,
)
from headstock.pipeline.motion.motors import MovedMachine, TrajectoryMotors
from headstock.pipeline.motion.trajectory import (
    RigidTrajectory,
    body_channels,
    load_bodies,
    travel_bodies,
)
from headstock.pipeline.stages.run_state import MachineParts
from headstock.reduction.superelement import Superelement
from headstock.solvers.second_order import Channel

STEP = 0.01  # of the fastest body, between frames from which its motion is differenced [rad]
# central differences of fourth order
FIRST = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / 12.0
SECOND = np.array([-1.0, 16.0, -30.0, 16.0, -1.0]) / 12.0


def rotation_speeds(machine: Machine, path: MachinePath) -> dict[str, float]:
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


def rotary_trajectory(
    machine: Machine,
    superelements: Mapping[str, Superelement],
    path: MachinePath,
    speed: float,
    acceleration: float,
) -> RigidTrajectory:
    """Axes that move along a path at a constant speed and acceleration, over its positions.

    A body at ``c(p)`` with the turn ``R(p)`` is accelerated by ``c'' v^2 + c' a`` and turned by
    ``alpha = w' v^2 + w a``, ``[w] = R' R^T``: tangential (Euler), centripetal and Coriolis terms of
    all axes together; its Euler moment ``w x I w v^2`` is as if it were turned faster.

    Args:
        speed: Along it [m/s, rad/s].
        acceleration: Along it [m/s^2, rad/s^2].
    """
    speeds = rotation_speeds(machine, path)
    step = STEP / max(speeds.values())
    names = _moving_bodies(machine, superelements)
    place = _place_along(machine, path)

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

    return RigidTrajectory(
        path.pose_at,
        lambda model: load_bodies(model, names),
        amounts,
        body_channels(names),
        turning=tuple(name for name in names if name in speeds),
        travels=lambda coupled: travel_bodies(coupled, names),
    )


def find_feed(
    machine: Machine,
    superelements: Mapping[str, Superelement],
    path: MachinePath,
    point: str,
    up: FloatArray,
) -> Callable[[FloatArray], tuple[FloatArray, FloatArray]]:
    """Travel ``(n, 3)`` of a tool against its work per travel along a path, and the direction ``(n, 3)`` of
    its axis, machine axes, at positions.

    Args:
        up: ``(3,)`` of its axis with all axes at zero.
    """
    place = _place_along(machine, path)
    named = machine.points[point]
    tool, work, held = named.tool, named.work, named.carrier
    step = STEP / max(rotation_speeds(machine, path).values())
    still = Frame(np.zeros(3), np.eye(3))
    home = machine.components[tool.component].placement if tool.component else still
    local: FloatArray = np.asarray(named.offset)
    if held.component and held.interface:
        local = superelements[held.component].interface_position(held.interface) + local

    def at(position: float) -> tuple[FloatArray, FloatArray]:
        around = [place(position + step * side) for side in range(-2, 3)]
        tools, works = (
            [still if end.component is None else frames[end.component] for frames in around]
            for end in (tool, work)
        )
        carriers = tools if tool.component else [works[2]] * len(works)
        # where the tool is in the axes of its work
        places = np.array(
            [
                base.rotation.T @ (carrier.origin + carrier.rotation @ local - base.origin)
                for carrier, base in zip(carriers, works, strict=True)
            ]
        )
        travel = works[2].rotation @ (FIRST @ places) / step
        return travel, tools[2].rotation @ home.rotation.T @ up

    def feed(positions: FloatArray) -> tuple[FloatArray, FloatArray]:
        travels, ups = zip(*(at(float(position)) for position in positions), strict=True)
        return np.array(travels), np.array(ups)

    return feed


def _moving_bodies(machine: Machine, names: Iterable[str]) -> tuple[str, ...]:
    """Those of the bodies that any axis moves."""
    moved = {name for axis in machine.axes.values() for name in axis.moves}
    return tuple(name for name in names if name in moved)


def rotary_path_motors(
    parts: MachineParts,
    path: MachinePath,
    trajectory: RigidTrajectory,
    outputs: Sequence[Channel],
    *,
    speed: float,
    acceleration: float,
) -> TrajectoryMotors | None:
    """Motors of the linear axes on a path on which others turn, over its positions; those of rotary axes
    are ideal. None without control.

    Args:
        trajectory: Of its bodies at the same speed and acceleration.
        outputs: Where motion is wanted, points or interfaces.
        speed: Along it [m/s, rad/s].
        acceleration: Along it [m/s^2, rad/s^2].
    """
    machine, drives = parts.scene.machine, tuple(parts.scene.drives.values())
    if not drives:
        return None
    names, place = _moving_bodies(machine, parts.superelements), _place_along(machine, path)
    masses = np.array([parts.superelements[name].mass_kg for name in names])
    gravity = np.zeros(3) if parts.plan.gravity is None else np.asarray(parts.plan.gravity)
    first, last = (
        np.array([end.positions.get(drive.axis, 0.0) for drive in drives])
        for end in (path.start, path.end)
    )
    shares = (last - first) / path.length

    def travel(position: float) -> dict[str, FloatArray]:
        """Motion ``(3, d)`` of every component per travel of each motor."""
        here = place(position)
        ahead = [place(position, {drive.axis: 1.0}) for drive in drives]
        return {
            name: np.column_stack([frames[name].origin - frame.origin for frames in ahead])
            for name, frame in here.items()
        }

    def read(moved: Mapping[str, FloatArray], channel: Channel) -> FloatArray:
        point, dof = machine.points.get(channel[0]), DOF_NAMES.index(channel[1])
        ends = [(channel[0].partition(".")[0], 1.0)]
        if point is not None:
            ends = [(point.tool.component or "", 1.0), (point.work.component or "", -1.0)]
        still = np.zeros((3, len(drives)))
        total = np.sum([sign * moved.get(name, still) for name, sign in ends], axis=0)
        return np.asarray(total[dof] if dof < 3 else still[0])

    def at(positions: FloatArray) -> MovedMachine:
        steps = [travel(float(position)) for position in positions]
        # (n, b, 3, d)
        bodies = np.array([[step[name] for name in names] for step in steps])
        pulled = trajectory.amounts(positions).reshape(len(positions), len(names), 6)[..., :3]
        weighed = masses[:, None, None] * bodies
        return MovedMachine(
            positions=first + positions[:, None] * shares,
            speeds=np.broadcast_to(speed * shares, (len(positions), len(drives))),
            accelerations=np.broadcast_to(acceleration * shares, (len(positions), len(drives))),
            bodies=np.concatenate([bodies, np.zeros_like(bodies)], axis=2).reshape(
                len(positions), -1, len(drives)
            ),
            mass=np.einsum("nbkd,nbke->nde", weighed, bodies),
            outputs=np.array([[read(step, channel) for channel in outputs] for step in steps]),
            weight=np.einsum("nbkd,k->nd", weighed, gravity),
            inertia=np.einsum("nbkd,nbk->nd", weighed, pulled),
        )

    return TrajectoryMotors(drives, at, body_channels(names), tuple(outputs))


def _place_along(machine: Machine, path: MachinePath) -> Callable[..., dict[str, Frame]]:
    """Frames of all components at a position of a path, its ends no limits; with axes further on by
    some travel.
    """
    free = free_axes(machine)

    def place(
        position: float, further: Mapping[str, float] = MappingProxyType({})
    ) -> dict[str, Frame]:
        first, share = path.start.positions, position / path.length
        places = {
            axis: first.get(axis, 0.0)
            + share * (path.end.positions.get(axis, 0.0) - first.get(axis, 0.0))
            + further.get(axis, 0.0)
            for axis in {**first, **path.end.positions, **further}
        }
        return place_components(free, Pose("on the path", places))

    return place


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
