"""Springs of joints: the relative motions they resist, ball screws with the nut anywhere, and
groups of like stiffness.
"""

import dataclasses
import functools
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import DOF_NAMES, FloatArray, Frame, frame_axes, rotate_dofs
from headstock.geometry.machine.joints import GROUND, Joint, JointEnd, ScrewShaft, connected_groups
from headstock.geometry.machine.machine import Machine
from headstock.meshing.scipy_library import scipy
from headstock.reduction.coupling.coupled_shapes import place_layer
from headstock.reduction.coupling.dof_layout import (
    DOFS_OF_A_BODY,
    DofLayout,
    free_deformations,
    is_rail,
    locate_interface,
    motion_rows,
    scale_dofs,
    turn_dofs,
)
from headstock.reduction.coupling.elimination import CouplingMemo, Elimination
from headstock.reduction.superelement import Superelement
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.symmetric_matrices import is_symmetric

ROUNDOFF = 4.0 * float(np.finfo(float).eps)
GRADING_RATIO = 1e4  # stiffer than this times the most compliant spring: a coordinate of its own
GRADING_STEP = 1e3  # springs within this factor share a group
STIFF_RATIO = 1e9
ABSURD_RATIO = 1e12
# of a component to the most compliant spring: its rounding costs the spring all but nine or ten
# digits
STIFF_COMPONENT_RATIO = 3e6


@dataclass(frozen=True, eq=False)
class _ScrewSpring:
    """Spring of a ball screw at one place of its nut.

    Attributes:
        stiffness: ``(6, 6)`` between nut and bearings in joint axes, x along the screw.
        far_share: Part of the nut's axial force that goes to the far bearing, 0..1.
    """

    stiffness: FloatArray
    far_share: float


def _place_screw(joint: Joint, shaft: ScrewShaft, distance: float) -> _ScrewSpring:
    """Place nut, shaft, bearings and coupling in series; both sides of a shaft with two fixed
    bearings in parallel.

    With the motor locked, an axial force F on the nut twists the shaft by F p a / (G J), p = lead /
    (2 pi), a the distance, which deforms by p times that; and the nut may turn about the shaft as
    it moves along the thread. The compliance along the thread is

        1 / k_nut + 1 / (k_near + k_far) + p^2 (a / (G J) + 1 / k_coupling)

    with ``1 / k_near = 1 / k_bearing + a / (E A)`` and the same for the rest of the shaft.

    Args:
        joint: Its stiffness holds the nut's: axial, and about the axis if it has one.
        distance: From the fixed bearing to the nut [m].

    Raises:
        ModelError: The nut stands at or beyond a bearing.

    Source: ISO 3408-4 (2006), static axial rigidity; Altintas, Verl, Brecher, Uriarte and Pritschow
    (2011), section 2.2, for the twist.
    """
    if not 0.0 < distance < shaft.length:
        where = (
            "at its bearing"
            if distance <= 0.0
            else f"{1e3 * distance:.6g} mm from it, beyond the far one"
        )
        raise ModelError(
            f"joint {joint.name!r}: the nut stands {where}; name the nut's interface first and the bearing's second, and keep the axis "
            "between the bearings"
        )
    near = 1.0 / (1.0 / shaft.bearing + distance / shaft.axial)
    far = (
        0.0
        if shaft.second_end is None
        else 1.0 / (1.0 / shaft.second_bearing + (shaft.length - distance) / shaft.axial)
    )
    pitch = shaft.lead / (2.0 * np.pi)
    twist = distance / shaft.torsional
    compliance = (
        1.0 / joint.stiffness[0, 0] + 1.0 / (near + far) + pitch**2 * (twist + 1.0 / shaft.coupling)
    )
    thread = np.array([1.0, 0.0, 0.0, -pitch, 0.0, 0.0])
    stiffness = np.array(joint.stiffness, dtype=float)
    stiffness[0, 0] = 0.0
    if stiffness[3, 3] != 0.0:
        stiffness[3, 3] = 1.0 / (1.0 / stiffness[3, 3] + twist)
    return _ScrewSpring(stiffness + np.outer(thread, thread) / compliance, far / (near + far))


@dataclass(frozen=True, eq=False)
class PlacedJoint:
    """A joint as placed in a pose.

    Attributes:
        rows: ``(6 + m, n)`` motion of its second end relative to its first, in joint axes, at the
            joint point, and of a contact layer the relative deformation by ``m`` shapes: of all
            stacked dofs as placed, of the free coordinates in a ``CoupledMachine``.
        stiffness: ``(6 + m, 6 + m)`` in joint axes.
        damping: ``(6 + m, 6 + m)`` in joint axes.
        fixed: Joint dofs without relative motion; a rigid joint has all six, and no stiffness.
        frame: Joint point and joint axes in the machine frame.
        soft: It is meant to deflect visibly, as air springs do.
    """

    name: str
    rows: FloatArray
    stiffness: FloatArray
    damping: FloatArray
    fixed: tuple[int, ...]
    frame: Frame
    soft: bool = False


@dataclass(frozen=True, eq=False)
class _SpringDirection:
    """One principal direction of a joint's stiffness.

    Attributes:
        dof: The joint dof it acts on most.
        direction: ``(6 + m,)`` combination of the joint's rows.
        stiffness: [N/m or N m/rad] along it.
        level: The same as a translational stiffness [N/m]: rotational ones over the characteristic
            length squared.
    """

    joint: str
    dof: str
    direction: FloatArray
    stiffness: float
    level: float


def place_joint(joint: Joint, machine: Machine, layout: DofLayout) -> PlacedJoint:
    """Return the joint point, joint axes and relative-motion rows of a joint in a pose.

    Args:
        joint: Its ends, 6x6 stiffness [N/m, N/rad, N m/rad] and damping (the same times s) in joint
            axes.
        machine: With the placements and axes that the joint's frame depends on.
        layout: Places of the components' dofs among the ``n_all`` stacked ones.

    Returns:
        The spring with rows ``(6 + m, n_all)``: motion of the second end less that of the first,
        joint axes, and shapes of a contact layer.

    Raises:
        ModelError: Both ends are ground, or a matrix is not 6x6 and finite.
    """
    for matrix, what in ((joint.stiffness, "stiffness"), (joint.damping, "damping")):
        if np.shape(matrix) != (6, 6) or not np.isfinite(matrix).all():
            raise ModelError(
                f"joint {joint.name!r}: its {what} must be a 6x6 matrix of finite numbers"
            )
    frame = _joint_frame(joint, machine, layout)
    try:
        first, second = (motion_rows(layout, end, frame.origin, joint.length) for end in joint.ends)
    except ModelError as error:
        raise ModelError(f"joint {joint.name!r}: {error}") from error
    rows = rotate_dofs(frame.rotation).T @ (second - first)
    spring = PlacedJoint(
        joint.name, rows, joint.stiffness, joint.damping, tuple(joint.fixed), frame, joint.soft
    )
    if joint.layer is not None:
        more, stiffness = place_layer(joint, joint.layer, layout, frame)
        stiffness[:6, :6] += joint.stiffness
        damping = scipy.linalg.block_diag(joint.damping, np.zeros((len(more), len(more))))
        rows = np.vstack([rows, more])
        spring = dataclasses.replace(spring, rows=rows, stiffness=stiffness, damping=damping)
    elif joint.screw is not None:
        spring = _place_shaft(joint, joint.screw, spring, layout)
    beta = machine.rayleigh.beta
    if beta:
        return dataclasses.replace(spring, damping=spring.damping + beta * spring.stiffness)
    return spring


def _place_shaft(
    joint: Joint, shaft: ScrewShaft, spring: PlacedJoint, layout: DofLayout
) -> PlacedJoint:
    """Return a ball screw at the distance its nut has in the pose; a far bearing takes its share of
    the axial motion.
    """
    axis = spring.frame.rotation[:, 0]
    bearing = joint.ends[1] if shaft.floating_end is None else shaft.floating_end
    distance = float(abs((spring.frame.origin - locate_interface(layout, bearing)) @ axis))
    placed = _place_screw(joint, shaft, distance)
    rows = spring.rows
    if shaft.second_end is not None:
        near, far = (
            axis @ motion_rows(layout, end, spring.frame.origin)[:3]
            for end in (joint.ends[1], shaft.second_end)
        )
        rows = rows.copy()
        rows[0] += placed.far_share * (far - near)
    return dataclasses.replace(spring, rows=rows, stiffness=placed.stiffness)


def _principal_springs(spring: PlacedJoint, length: float) -> tuple[_SpringDirection, ...]:
    """Return the independent springs that together make up a joint's stiffness; directions without
    stiffness are left out.

    Args:
        spring: Its stiffness must be symmetric.
        length: Characteristic length that makes rotations comparable to translations [m].
    """
    scale = np.ones(len(spring.stiffness))
    scale[3:DOFS_OF_A_BODY] = 1.0 / length
    scaled = spring.stiffness * scale * scale[:, None]
    if np.count_nonzero(scaled - np.diag(scaled.diagonal())) == 0:
        levels, vectors = scaled.diagonal(), np.eye(len(scaled))
    else:
        levels, vectors = np.linalg.eigh(0.5 * (scaled + scaled.T))
        levels = np.where(
            np.abs(levels) > 16.0 * np.finfo(float).eps * np.abs(levels).max(), levels, 0.0
        )
    result = []
    for level, vector in zip(levels, vectors.T, strict=True):
        if level != 0.0:
            main = int(np.argmax(np.abs(vector)))
            # delta^T k delta = sum level (vector . delta / scale)^2
            direction = vector * (scale[main] / scale)
            name = (
                DOF_NAMES[main] if main < DOFS_OF_A_BODY else f"shape {main - DOFS_OF_A_BODY + 1}"
            )
            result.append(
                _SpringDirection(spring.name, name, direction, level / scale[main] ** 2, level)
            )
    return tuple(result)


def express_in_free_coordinates(spring: PlacedJoint, elimination: Elimination) -> PlacedJoint:
    """Return the same joint with its rows in free coordinates; fixed rows, and what is roundoff,
    exactly zero.
    """
    # a joint sees the dofs of two bodies only
    columns = np.flatnonzero(spring.rows.any(axis=0))
    spring_rows, basis = spring.rows[:, columns], elimination.basis[columns]
    rows = spring_rows @ basis
    rows[np.abs(rows) <= ROUNDOFF * (np.abs(spring_rows) @ np.abs(basis))] = 0.0
    rows[list(spring.fixed)] = 0.0
    return dataclasses.replace(spring, rows=rows)


def place_joints(machine: Machine, layout: DofLayout) -> tuple[PlacedJoint, ...]:
    """Return every joint of a machine in a pose."""
    return tuple(place_joint(joint, machine, layout) for joint in machine.joints.values())


def find_floating_groups(
    machine: Machine, fixed: Mapping[str, bool]
) -> tuple[tuple[str, ...], ...]:
    """Return the groups of components that hang together by joints but not with ground.

    Args:
        machine: Its joints that hold or spring at least one dof connect.
        fixed: Whether each component is itself supported.
    """
    links = [(name, GROUND) for name, is_fixed in fixed.items() if is_fixed]
    links += [
        (joint.ends[0].component or GROUND, joint.ends[1].component or GROUND)
        for joint in machine.joints.values()
        if joint.connects
    ]
    groups = connected_groups((GROUND, *machine.components), links)
    return tuple(tuple(group) for group in groups if GROUND not in group)


def _joint_frame(joint: Joint, machine: Machine, layout: DofLayout) -> Frame:
    """Return the joint frame, carried along by the component of its first end that is neither
    ground nor a rail.

    Of a universal joint the first axis stays with the first end and the second with the second end,
    as those of a cross do.
    """
    end = leading_end(joint, layout)
    point = joint.point
    if end.component is None:
        if point is None:
            raise ModelError(
                f"joint {joint.name!r}: ground has no place of its own; say where the joint is"
            )
        return Frame(point, joint.rotation)
    if end.component not in layout.placements or end.component not in machine.components:
        raise ModelError(
            f"joint {joint.name!r}: there is no component {end.component!r}; components: {sorted(machine.components)}"
        )
    home, now = machine.components[end.component].placement, layout.placements[end.component]
    turn = _turn_of(end, machine, layout)
    origin = (
        locate_interface(layout, end)
        if point is None
        else now.origin + turn @ (point - home.origin)
    )
    if joint.second_axis is None:
        return Frame(origin, turn @ joint.rotation)
    first, second = (_turn_of(joint_end, machine, layout) for joint_end in joint.ends)
    try:
        return Frame(origin, frame_axes(first @ joint.rotation[:, 0], second @ joint.second_axis))
    except ValueError as error:
        raise ModelError(
            f"joint {joint.name!r}: its two axes are parallel in this pose, and it can turn about one only"
        ) from error


def _turn_of(end: JointEnd, machine: Machine, layout: DofLayout) -> FloatArray:
    """Return the rotation ``(3, 3)`` of the body behind an end since its axes and points were
    given; of a carried body all of it.
    """
    if end.component is None:
        return np.eye(3)
    home, now = machine.components[end.component].placement, layout.placements[end.component]
    return (
        np.eye(3) if np.array_equal(now.rotation, home.rotation) else now.rotation @ home.rotation.T
    )


def leading_end(joint: Joint, layout: DofLayout) -> JointEnd:
    """Return the end whose body carries the joint point: on a rail it is the carriage that does,
    not the rail.

    Raises:
        ModelError: Both ends are ground, or there is not one carriage on one rail.
    """
    ends = [end for end in joint.ends if end.component is not None]
    if not ends:
        raise ModelError(
            f"joint {joint.name!r}: both of its ends are ground; name an interface of a component"
        )
    carriages = [end for end in joint.ends if not is_rail(layout, end)]
    if joint.length is None:
        if len(carriages) < len(joint.ends):
            raise ModelError(f"joint {joint.name!r}: a carriage on a rail needs its length")
        return ends[0]
    if len(carriages) != 1:
        raise ModelError(
            f"joint {joint.name!r}: a carriage needs one rail and one other end, not {len(carriages)} other ends"
        )
    return carriages[0]


@dataclass(frozen=True, eq=False)
class SpringGrading:
    """Groups of the springs of a machine by stiffness.

    Attributes:
        groups: Stiff springs, the stiffest group first; empty where all springs are alike.
        soft: The other springs, where there are groups.
        warnings: About ratios no machine has.
        deformations: Rows ``(m, n_all)`` of the deformations of components that are far stiffer
            still than the most compliant spring, in one block; none where there are no such
            components.
    """

    groups: tuple[tuple[_SpringDirection, ...], ...]
    soft: tuple[_SpringDirection, ...]
    warnings: tuple[str, ...]
    deformations: tuple[FloatArray, ...] = ()

    def group_rows(self, springs: Sequence[PlacedJoint]) -> list[FloatArray]:
        """Return the rows ``(m_g, n_all)`` of each group, deformations of components first."""
        rows = {spring.name: spring.rows for spring in springs}
        return [
            *self.deformations,
            *(
                np.array([part.direction @ rows[part.joint] for part in group])
                for group in self.groups
            ),
        ]


def grade_springs(
    springs: Sequence[PlacedJoint],
    layout: DofLayout,
    stiffnesses: Mapping[str, FloatArray],
    memo: CouplingMemo,
) -> SpringGrading:
    """Sort the springs of all joints by stiffness, rotational ones over the square of a length of
    the machine.

    Args:
        layout: Components and the characteristic length of the machine.
        stiffnesses: ``(n, n)`` of each component in machine axes.
        memo: Keeps deformations of components for the next pose.
    """
    if not all(is_symmetric(spring.stiffness) for spring in springs):
        return SpringGrading((), (), ())
    length = layout.length
    parts = [
        part
        for spring in springs
        for part in _principal_springs(spring, length)
        # a spring across a single rigid body is stretched by no motion
        if np.any(part.direction @ spring.rows)
    ]
    parts.sort(key=lambda part: -abs(part.level))
    if not parts:
        return SpringGrading((), (), ())
    most_compliant = parts[-1]
    deformations = _stiff_deformations(layout, stiffnesses, abs(most_compliant.level), memo)
    if abs(parts[0].level) <= GRADING_RATIO * abs(most_compliant.level):
        return SpringGrading((), (), (), deformations)
    groups: list[list[_SpringDirection]] = []
    for part in parts:
        if abs(part.level) <= GRADING_RATIO * abs(most_compliant.level):
            break
        if not groups or abs(part.level) * GRADING_STEP < abs(groups[-1][0].level):
            groups.append([])
        groups[-1].append(part)
    soft = tuple(parts[sum(len(group) for group in groups) :])
    return SpringGrading(
        tuple(tuple(group) for group in groups),
        soft,
        tuple(_ratio_warnings(parts, {spring.name for spring in springs if spring.soft})),
        deformations,
    )


def _stiff_deformations(
    layout: DofLayout,
    stiffnesses: Mapping[str, FloatArray],
    most_compliant: float,
    memo: CouplingMemo,
) -> tuple[FloatArray, ...]:
    """Return the rows of the boundary dofs of far stiffer components, less the rigid motion of the
    first node of each.

    The soft springs of a body must not be what is left of the difference of its own large
    stiffnesses.
    """
    squares, blocks = scale_dofs(layout) ** 2, []
    for name, element in layout.superelements.items():
        dofs = layout.offsets[name]
        boundary = element.boundary_size
        level = float(
            np.abs(stiffnesses[name].diagonal() * squares[dofs])[:boundary].max(initial=0.0)
        )
        if (
            element.supported
            or boundary <= DOFS_OF_A_BODY
            or not level > STIFF_COMPONENT_RATIO * most_compliant
        ):
            continue
        rows = np.zeros((boundary - DOFS_OF_A_BODY, layout.size))
        placement = layout.placements[name]
        rows[:, dofs] = memo.recall(
            f"deformations {name}",
            (element, placement.rotation),
            functools.partial(_turned_deformations, element, placement),
        )[: len(rows)]
        blocks.append(rows)
    return (np.vstack(blocks),) if blocks else ()


def _turned_deformations(element: Superelement, placement: Frame) -> FloatArray:
    """Return the rows ``(n - 6, n)`` of a component in machine axes."""
    return free_deformations(element) @ turn_dofs(element, placement)


def _ratio_warnings(parts: Sequence[_SpringDirection], soft: Collection[str]) -> list[str]:
    """Return a warning per joint that is far stiffer than the most compliant one, with its stiffest
    direction; a contact layer has one direction per deformation shape.

    Args:
        parts: Of all joints, the stiffest first.
        soft: Names of joints that are meant to be soft: nothing is compared with these.
    """
    most_compliant = next((part for part in reversed(parts) if part.joint not in soft), parts[0])
    stiff: dict[str, list[_SpringDirection]] = {}
    for part in parts:
        if abs(part.level / most_compliant.level) <= STIFF_RATIO:
            break
        stiff.setdefault(part.joint, []).append(part)
    warnings = []
    for joint, directions in stiff.items():
        first, ratio = directions[0], abs(directions[0].level / most_compliant.level)
        more = f" (and {len(directions) - 1} more of its directions)" if len(directions) > 1 else ""
        remedy = (
            "check the units of both"
            if ratio > ABSURD_RATIO
            else "it acts as rigid; hold the dof instead if that is meant"
        )
        warnings.append(
            f"joint {joint}, {first.dof}{more}: {first.stiffness:.3g} is {ratio:.2g} times as stiff as "
            f"joint {most_compliant.joint}, {most_compliant.dof} ({most_compliant.stiffness:.3g}); {remedy}"
        )
    return warnings
