"""Errors of guides and drives as preload of the joints' springs: where a rail, a screw or an axis'
error motion would move what rides on it.

A joint with stiffness ``K`` and relative motion ``rows q`` whose springs are at rest at an offset
``e`` pulls with ``K (rows q - e)``: the load of the error is ``rows^T K e``. Fixed directions take
the offset itself: ``q = B y + q_0`` with ``C q_0 = e``.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import DOF_NAMES, FloatArray, Frame, rigid_transfer, rotate_dofs
from headstock.geometry.machine.guide_errors import ProfileError
from headstock.geometry.machine.joints import Axis, Joint, JointEnd
from headstock.geometry.machine.machine import Machine
from headstock.reduction.coupling.dof_layout import (
    DofLayout,
    is_rail,
    locate_interface,
    scale_dofs,
)
from headstock.reduction.coupling.joint_springs import PlacedJoint
from headstock.reduction.coupling.matrices import CoupledParts
from headstock.solvers.errors import ModelError

GUIDE_ERRORS = "guide_errors"
CONTRADICTION = 1e-6  # of the largest offset: what fixed joints may contradict each other by
ROUNDOFF = 1e-12  # of the largest motion, or of the terms of a sum
HELD = 1e-9  # of the largest row of a joint: what moves no more is held


@dataclass(frozen=True, eq=False)
class ErrorPlaces:
    """Places at which the errors of a machine are read in ``n`` poses.

    Attributes:
        rails: Joint with errors of its own to the places ``(n,)`` of its carriage along the rail
            [m].
        signs: The same to the sign of its offset: -1 where the second end is the rail.
        positions: Axis with error motions to its positions ``(n,)`` [m, rad].
        levers: Axis and joint of it to the ``(n, 6, 6)`` joint offset per error motion, machine
            axes to joint axes.
    """

    rails: dict[str, FloatArray]
    signs: dict[str, float]
    positions: dict[str, FloatArray]
    levers: dict[tuple[str, str], FloatArray]

    def map(self, change: Callable[[FloatArray], FloatArray]) -> "ErrorPlaces":
        """Return the same with another array for each."""
        return ErrorPlaces(
            {name: change(values) for name, values in self.rails.items()},
            self.signs,
            {name: change(values) for name, values in self.positions.items()},
            {name: change(values) for name, values in self.levers.items()},
        )


@dataclass(frozen=True, eq=False)
class ErrorLoads:
    """Loads and motions by the errors of each source in a pose; all of them add up.

    Attributes:
        loads: Source, a joint or an axis, to its load ``(n,)`` in free coordinates.
        offsets: The same to a motion ``(n_all,)`` of the stacked dofs that fixed directions make,
            at zero free coordinates; no entry where there is none.
    """

    loads: dict[str, FloatArray]
    offsets: dict[str, FloatArray]

    @property
    def load(self) -> FloatArray:
        """Of all sources ``(n,)``."""
        return np.sum(list(self.loads.values()), axis=0)

    def offset(self, size: int) -> FloatArray:
        """Return the offsets of all sources ``(size,)``."""
        return np.sum([*self.offsets.values(), np.zeros(size)], axis=0)


@dataclass(frozen=True, eq=False)
class FixedRows:
    """Rows that a machine eliminated in a pose, to give fixed directions of joints another value.

    Attributes:
        springs: Every joint with rows ``(6 + m, n_all)`` of the stacked dofs.
        constraints: Rows ``(c, n_all)`` that were eliminated.
        sources: Component or joint that each of them comes from, as messages name it.
        first: Where the fixed directions of the joints begin among them, in the order of
            ``springs``.
    """

    springs: tuple[PlacedJoint, ...]
    constraints: FloatArray
    sources: tuple[str, ...]
    first: int

    def values(self, by_joint: Mapping[str, FloatArray]) -> FloatArray:
        """Return the values ``(c,)`` that constraint rows must take for joint offsets ``(6,)``."""
        wanted = np.zeros(len(self.constraints))
        first = self.first
        for spring in self.springs:
            last = first + len(spring.fixed)
            if spring.name in by_joint:
                wanted[first:last] = by_joint[spring.name][list(spring.fixed)]
            first = last
        return wanted


def has_errors(machine: Machine) -> bool:
    """Return whether any rail, screw or axis of a machine has errors."""
    return any(joint.errors is not None for joint in machine.joints.values()) or any(
        axis.errors is not None for axis in machine.axes.values()
    )


def find_places(
    machine: Machine,
    positions: Mapping[str, float],
    layout: DofLayout,
    springs: Sequence[PlacedJoint],
) -> ErrorPlaces:
    """Find where the errors of a machine are read in a pose.

    Args:
        positions: Of its axes; zero for those not named.
    """
    frames = {spring.name: spring.frame for spring in springs}
    sliding = {name: joint for name, joint in machine.joints.items() if joint.errors is not None}
    rails = {
        name: np.array([_rail_place(joint, frames[name], layout)])
        for name, joint in sliding.items()
    }
    signs = {name: _rail_sign(joint, frames[name], layout) for name, joint in sliding.items()}
    levers: dict[tuple[str, str], FloatArray] = {}
    axis_positions = {}
    for axis in machine.axes.values():
        if axis.errors is None:
            continue
        axis_positions[axis.name] = np.array([positions.get(axis.name, 0.0)])
        turn, point = _axis_frame(axis, machine, layout, frames)
        for name in axis.joints:
            second = machine.joints[name].ends[1].component in axis.moves
            back = rotate_dofs(frames[name].rotation.T)
            carried = back @ rigid_transfer(point, frames[name].origin) @ rotate_dofs(turn)
            levers[axis.name, name] = (carried if second else -carried)[None]
    return ErrorPlaces(rails, signs, axis_positions, levers)


def sample_offsets(machine: Machine, places: ErrorPlaces) -> dict[str, dict[str, FloatArray]]:
    """Return the offsets ``(n, 6)`` of the joints in joint axes, second end relative to first, by
    source and joint.

    Args:
        places: Where they are read in ``n`` poses.

    Raises:
        ModelError: A place lies outside the table of a profile.
    """
    offsets: dict[str, dict[str, FloatArray]] = {}
    for name, rail_places in places.rails.items():
        joint = machine.joints[name]
        if joint.errors is None:
            continue
        try:
            offsets[name] = {name: places.signs[name] * joint.errors.offset(rail_places)}
        except ProfileError as error:
            raise ModelError(
                f"errors of joint {name}: {error}; give the table values up to there, or keep the axis within it"
            ) from error
    for name, positions in places.positions.items():
        axis = machine.axes[name]
        if axis.errors is None:
            continue
        direction = axis.direction if axis.kind == "linear" else np.zeros(3)
        try:
            motions = axis.errors.sample(positions, direction)
        except ProfileError as error:
            raise ModelError(
                f"errors of axis {name}: {error}; give the table values up to there, or keep the axis within it"
            ) from error
        offsets[name] = {
            joint_name: (places.levers[name, joint_name] @ motions[..., None])[..., 0]
            for joint_name in axis.joints
        }
    return offsets


def find_offsets(machine: Machine, places: ErrorPlaces) -> dict[str, dict[str, FloatArray]]:
    """Find joints' offsets ``(6,)`` in one pose by source and joint: ``sample_offsets``."""
    return {
        source: {joint: offset[0] for joint, offset in offsets.items()}
        for source, offsets in sample_offsets(machine, places).items()
    }


def find_displacements(
    machine: Machine, springs: Sequence[PlacedJoint]
) -> dict[str, dict[str, FloatArray]]:
    """Find the offsets ``(6,)`` in joint axes of prescribed displacements by name and joint: what
    the second end does relative to the first.
    """
    frames = {spring.name: spring.frame for spring in springs}
    displacements = {}
    for name, given in machine.displacements.items():
        joint_motion = rotate_dofs(frames[given.joint].rotation.T) @ np.array(given.motion)
        # what is joined to a ground that moves follows it
        follows = machine.joints[given.joint].ends[1].component is not None
        displacements[name] = {given.joint: joint_motion if follows else -joint_motion}
    return displacements


def warn_of_held_displacements(machine: Machine, reduced: Sequence[PlacedJoint]) -> tuple[str, ...]:
    """Return warnings of prescribed displacements along which a joint's ends cannot move, since
    their points are held by supports.

    Args:
        reduced: Every joint with rows in free coordinates.
    """
    by_name, warnings = {spring.name: spring for spring in reduced}, []
    for name, by_joint in find_displacements(machine, reduced).items():
        for joint, wanted in by_joint.items():
            rows = by_name[joint].rows[:6]
            sizes = np.abs(rows).max(axis=1, initial=0.0)
            held = (np.abs(wanted) > 0.0) & (sizes <= HELD * sizes.max(initial=1.0))
            held[list(by_name[joint].fixed)] = False
            ends = {end.component for end in machine.joints[joint].ends}
            supports = [
                support.name for support in machine.supports.values() if support.component in ends
            ]
            if held.any() and supports:
                along = ", ".join(
                    direction for direction, is_held in zip(DOF_NAMES, held, strict=True) if is_held
                )
                warnings.append(
                    f"load {name!r} displaces joint {joint!r} along {along} of its axes, where its face shares points with support"
                    f" {', '.join(map(repr, supports))}, which holds them: nothing moves there; take that direction off the support, or"
                    " support another face"
                )
    return tuple(warnings)


def solve_error_loads(
    offsets: Mapping[str, Mapping[str, FloatArray]], parts: CoupledParts, fixed: FixedRows
) -> ErrorLoads:
    """Return the loads of offsets, and the motions that fixed directions make.

    Args:
        offsets: ``(6,)`` by source and joint, joint axes.
        parts: Of the machine in the same pose.
        fixed: What was eliminated there.

    Raises:
        ModelError: Errors of fixed joints contradict each other.
    """
    loads: dict[str, FloatArray] = {}
    particular: dict[str, FloatArray] = {}
    layout, basis = parts.layout, parts.basis
    for source, by_joint in offsets.items():
        load = np.zeros(basis.shape[1])
        for spring in parts.springs:
            if spring.name in by_joint:
                load += spring.rows[:6].T @ (spring.stiffness[:6, :6] @ by_joint[spring.name])
        wanted = fixed.values(by_joint)
        if wanted.any():
            moved = follow_fixed(fixed.constraints, wanted[:, None], layout)[:, 0]
            particular[source] = moved
            for name, dofs in layout.offsets.items():
                load -= basis[dofs].T @ (parts.matrices.stiffnesses[name] @ moved[dofs])
            for spring, free in zip(fixed.springs, parts.springs, strict=True):
                load -= free.rows.T @ (spring.stiffness @ (spring.rows @ moved))
        loads[source] = load
    error_loads = ErrorLoads(loads, particular)
    if particular:
        total = {
            spring.name: np.sum(
                [by_joint[spring.name] for by_joint in offsets.values() if spring.name in by_joint],
                axis=0,
            )
            for spring in fixed.springs
        }
        _check_fixed(total, error_loads.offset(layout.size), fixed.springs)
    return error_loads


def follow_fixed(constraints: FloatArray, wanted: FloatArray, layout: DofLayout) -> FloatArray:
    """Return the smallest motions ``(n_all, k)`` that give constraint rows their values ``(c, k)``,
    as far as they agree.
    """
    scale = scale_dofs(layout)
    scaled = np.linalg.lstsq(constraints * scale, wanted)[0]
    # no spline along a path could follow roundoff
    scaled[np.abs(scaled) < ROUNDOFF * np.abs(scaled).max(axis=0, initial=0.0)] = 0.0
    return scale[:, None] * scaled


def _check_fixed(
    total: Mapping[str, FloatArray], moved: FloatArray, springs: Sequence[PlacedJoint]
) -> None:
    fixed = [spring for spring in springs if spring.fixed and np.size(total[spring.name]) == 6]
    largest = max(float(np.abs(total[spring.name][list(spring.fixed)]).max()) for spring in fixed)
    missed = [
        spring.name
        for spring in fixed
        if np.abs((spring.rows @ moved - total[spring.name])[list(spring.fixed)]).max()
        > CONTRADICTION * largest
    ]
    if missed:
        raise contradiction_error(missed)


def contradiction_error(joints: Sequence[str]) -> ModelError:
    """Return the error of fixed joints whose errors nothing follows."""
    return ModelError(
        f"errors of rigid guides or prescribed displacements contradict each other ({', '.join(joints)}): nothing deforms to follow them all; "
        "give these joints a stiffness"
    )


def _rail_place(joint: Joint, frame: Frame, layout: DofLayout) -> float:
    """Return where a carriage stands along the axis of its joint, from the origin of what it slides
    on; a nut on a shaft by the distance from its bearing.
    """
    axis = frame.rotation[:, 0]
    if joint.screw is not None:
        bearing = joint.screw.floating_end or joint.ends[1]
        return float(abs(axis @ (frame.origin - locate_interface(layout, bearing))))
    end = _rail_side(joint, layout)
    ground = np.zeros(3) if joint.errors is None else joint.errors.origin
    origin = ground if end.component is None else layout.placements[end.component].origin
    return float(axis @ (frame.origin - origin))


def _rail_side(joint: Joint, layout: DofLayout) -> JointEnd:
    """Return the end that a joint slides along: a rail, else the second that is not ground."""
    first, second = joint.ends
    return first if first.component is None or is_rail(layout, first) else second


def _rail_sign(joint: Joint, frame: Frame, layout: DofLayout) -> float:
    """Return the sign of an offset, second end relative to first along the joint's axis, per error:
    the direction in which the position of the carriage or the nut is counted. That of a nut on a
    shaft is its distance from the bearing; where the shaft ends elsewhere, at what it carries, a
    longer one moves that on.
    """
    if joint.screw is not None:
        bearing = joint.screw.floating_end or joint.ends[1]
        beyond = frame.rotation[:, 0] @ (frame.origin - locate_interface(layout, bearing))
        away = 1.0 if beyond >= 0.0 else -1.0
        return away if joint.screw.floating_end else -away
    return 1.0 if _rail_side(joint, layout) is joint.ends[0] else -1.0


def _axis_frame(
    axis: Axis, machine: Machine, layout: DofLayout, frames: Mapping[str, Frame]
) -> tuple[FloatArray, FloatArray]:
    """Return the rotation ``(3, 3)`` of what an axis stands on since its zero position, and its
    functional point ``(3,)`` in the pose.
    """
    ends = machine.joints[axis.joints[0]].ends
    moving = next(end.component for end in ends if end.component in axis.moves)
    base = next(end.component for end in ends if end.component not in axis.moves)
    turn = np.eye(3)
    if base is not None:
        turn = layout.placements[base].rotation @ machine.components[base].placement.rotation.T
    if axis.errors is None or axis.errors.point is None:
        return turn, np.mean([frames[name].origin for name in axis.joints], axis=0)
    home, now = machine.components[str(moving)].placement, layout.placements[str(moving)]
    return turn, now.origin + now.rotation @ (home.rotation.T @ (axis.errors.point - home.origin))
