"""Axes and poses: what axes move, what they stand on, where they may stand, and what may be wrong
with them.
"""

import math
from collections.abc import Collection, Iterable, Mapping

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.joints import GROUND, Axis, Joint, connected_groups
from headstock.geometry.machine.machine import Pose, find_limit_fault
from headstock.geometry.mechanisms.exechon import TOOL_AXES, TOOL_POINT
from headstock.geometry.parts.components import Support
from headstock.scene.building.draft import Draft, is_known_end
from headstock.scene.building.guide_errors import build_axis_errors
from headstock.scene.building.joints import build_joint, find_joint_faults, sound_joints
from headstock.scene.reading.findings import Findings, KeyPath
from headstock.scene.reading.units import ANGLE, LENGTH, Dimension, Quantity
from headstock.scene.schema.axes import AxisTable
from headstock.scene.schema.effects import GUIDE_ERRORS
from headstock.scene.schema.scene import SceneTable
from headstock.scene.schema.types import show_direction

Edge = tuple[str, str]
PARALLEL = math.cos(math.radians(1.0))


def build_poses(scene: SceneTable) -> dict[str, Pose]:
    """Poses by name; ``reference`` with every axis at zero when the scene names none."""
    poses = {
        name: Pose(name, {axis: value.value for axis, value in table.items()})
        for name, table in scene.poses.items()
    }
    return poses or {"reference": Pose("reference")}


def build_axis(
    name: str,
    table: AxisTable,
    scene: SceneTable,
    joints: dict[str, Joint],
    supports: dict[str, Support],
) -> Axis:
    """The axis a faultless table stands for.

    Args:
        scene: With the tables of its components and joints.
        joints: Every joint of the machine by name.
        supports: Every support of the machine by name.
    """
    edges: dict[str, Edge] = {
        f"supports.{key}": (support.component, GROUND) for key, support in supports.items()
    }
    for key, joint in joints.items():
        if joint.connects:
            first, second = (end.component or GROUND for end in joint.ends)
            edges[key] = (first, second)
    moves = tuple(table.moves or _moved_components(scene.components, edges, table.joint_names()))
    low, high = (
        (-np.inf, np.inf) if table.limits is None else (limit.value for limit in table.limits)
    )
    return Axis(
        name=name,
        joints=table.joint_names(),
        moves=moves,
        direction=_axis_direction(table, scene),
        kind=table.kind,
        center=np.array(table.center),
        limits=(low, high),
        errors=build_axis_errors(table) if GUIDE_ERRORS in scene.active else None,
    )


def _axis_direction(table: AxisTable, scene: SceneTable) -> FloatArray:
    """Direction ``(3,)`` of an axis: as written, or the first guiding joint's."""
    if table.direction is not None:
        return np.array(table.direction)
    guides = _guiding_joints(scene, table)
    if not guides:
        raise ValueError("an axis needs a direction")
    return next(iter(guides.values()))


def _floating_groups(components: Collection[str], edges: Iterable[Edge]) -> list[list[str]]:
    """Groups of connected components without a chain to ground, in the order of the scene."""
    names = set(components)
    groups = connected_groups((GROUND, *components), edges)
    # a support may name what is no component
    return [
        [name for name in group if name in names]
        for group in groups
        if GROUND not in group and names & set(group)
    ]


def _moved_components(
    components: Iterable[str], edges: Mapping[str, Edge], joints: Iterable[str]
) -> tuple[str, ...]:
    """Components that are cut off from ground when an axis' joints are taken away.

    Args:
        components: Component names in the order of the scene.
        edges: The two sides of every joint (and support) by name.

    Returns:
        Names in the order of the scene; those that reach ground in no case are left out.
    """
    removed = set(joints)
    before, *_ = connected_groups((GROUND,), edges.values())
    after, *_ = connected_groups(
        (GROUND,), (edge for name, edge in edges.items() if name not in removed)
    )
    return tuple(name for name in components if name in before and name not in after)


def check_axes(draft: Draft) -> None:
    """Report what is wrong with axes, apart from what they move: names, limits, directions and
    guides.
    """
    for name, axis in draft.table.axes.items():
        key: KeyPath = ("axes", name)
        for index, joint in enumerate(axis.joint_names()):
            draft.check_name(
                (*key, "joints", index) if axis.joints else (*key, "joint"), joint, "joints"
            )
        for index, component in enumerate(axis.moves or ()):
            draft.check_name((*key, "moves", index), component, "components")
        limits = axis.limits or ()
        faults = [_find_unit_fault(limit, axis) for limit in limits]
        for index, fault in enumerate(faults):
            if fault:
                draft.add((*key, "limits", index), fault)
        if limits and not any(faults) and limits[0].value >= limits[1].value:
            draft.add((*key, "limits"), "the lower limit must be below the upper one")
        _check_guides(name, axis, draft)


def check_axis_moves(draft: Draft) -> None:
    """Report axes that move nothing, and joints of theirs that are not between what moves and what
    stands.
    """
    scene, edges = draft.table, _edges(draft.table)
    for name, axis in scene.axes.items():
        if all(joint in edges for joint in axis.joint_names()):
            _check_moves(("axes", name), axis, scene, edges, draft.findings)


def check_poses(draft: Draft) -> None:
    """Report poses, and positions in sweeps, of unknown axes, with a wrong unit or outside
    limits.
    """
    scene = draft.table
    values: list[tuple[KeyPath, str, Quantity]] = []
    for pose, positions in scene.poses.items():
        values += [(("poses", pose, axis), axis, value) for axis, value in positions.items()]
    for sweep, table in scene.sweeps.items():
        values += [
            (("sweeps", sweep, *key), axis, value) for key, axis, value in table.quantities()
        ]
    for key, axis, value in values:
        # the two ends of a span are written under their axis
        draft.check_name(key[:4] if key[2] == "axes" else key, axis, "axes", "axis")
        fault = ""
        if axis in scene.axes:
            fault = find_position_fault(axis, value, scene)
        elif axis in TOOL_AXES and scene.mechanism is not None:
            fault = find_measure_fault(axis, value, LENGTH if axis in TOOL_POINT else ANGLE)
        if fault:
            draft.add(key, fault)


def check_floating(draft: Draft) -> None:
    """Report components without a chain of joints and supports to ground; a lumped mechanism has no
    joints.
    """
    scene = draft.table
    complete = all(
        is_known_end(end, scene) for table in scene.joints.values() for end in table.between
    )
    if scene.free or scene.is_lumped or not complete:
        return
    for group in _floating_groups(scene.components, _edges(scene).values()):
        if any(
            scene.components[name].free or scene.components[name].solid.supported for name in group
        ):
            continue
        verb = "floats" if len(group) == 1 else "float together"
        draft.add(
            ("components", group[0]),
            f"{', '.join(group)} {verb}: 6 rigid-body motions are free, since no joint or support leads to ground; connect "
            f'{"it" if len(group) == 1 else "one of them"} to "ground" or to a grounded component, or write free = true',
        )


def find_position_fault(axis: str, value: Quantity, scene: SceneTable) -> str:
    """Say why an axis of the scene cannot stand at a position; empty where it can.

    Args:
        value: Length or angle as written.
    """
    table = scene.axes[axis]
    if fault := _find_unit_fault(value, table):
        return fault
    if table.limits is None or value.dimension != table.limits[0].dimension:
        return ""
    low, high = (limit.value for limit in table.limits)
    return find_limit_fault(axis, value.value, low=low, high=high, unit=value.dimension.unit)


def find_measure_fault(name: str, value: Quantity, wanted: Dimension) -> str:
    """Say that a coordinate is measured in another dimension; empty where it is not."""
    if value.dimension == wanted:
        return ""
    return f'{name} is measured as {wanted.name}; write for example "{wanted.example}"'


def _find_unit_fault(value: Quantity, axis: AxisTable) -> str:
    """Why a quantity is no position of an axis: an angle where it is linear, or a length; empty
    where it is one.
    """
    wanted = LENGTH if axis.kind == "linear" else ANGLE
    if value.dimension == wanted:
        return ""
    article = "an" if value.dimension == ANGLE else "a"
    return f'is {article} {value.dimension.name}, but the axis is {axis.kind}; write for example "{wanted.example}"'


def _edges(scene: SceneTable) -> dict[str, Edge]:
    """The two sides of every joint that transmits a force and of every support, by name."""
    edges: dict[str, Edge] = {}
    for name, table in sound_joints(scene).items():
        # a joint with a fault counts as a connection: its own message is enough
        if find_joint_faults(table) or build_joint(name, table).connects:
            first, second = (end.component or GROUND for end in table.between)
            edges[name] = (first, second)
    for name, support in scene.supports.items():
        edges[f"supports.{name}"] = (support.owner, GROUND)
    return edges


def _guiding_joints(scene: SceneTable, axis: AxisTable) -> dict[str, FloatArray]:
    """Unit vectors ``(3,)`` along which the guides and screws of an axis slide, or about which its
    bearings turn, by joint.
    """
    kinds = (
        ("linear_guide", "ball_screw", "prismatic")
        if axis.kind == "linear"
        else ("revolute", "bearing")
    )
    tables = {name: scene.joints[name] for name in axis.joint_names() if name in scene.joints}
    return {
        name: np.array(table.axis)
        for name, table in tables.items()
        if table.kind in kinds and table.axis is not None
    }


def _check_guides(name: str, axis: AxisTable, draft: Draft) -> None:
    """Every guide, screw and bearing of an axis must let go of the motion that the axis makes."""
    guides = _guiding_joints(draft.table, axis)
    along = None if axis.direction is None else np.array(axis.direction)
    if along is None and guides:
        # without a direction of its own the axis has that of most of its joints
        along = max(
            guides.values(),
            key=lambda guide: sum(abs(float(guide @ other)) for other in guides.values()),
        )
    elif along is None and all(joint in draft.table.joints for joint in axis.joint_names()):
        draft.add(
            ("axes", name, "direction"),
            "'direction' is missing and no joint of the axis gives one; write direction = \"x\"",
        )
    motion = "slides along" if axis.kind == "linear" else "turns about"
    for joint, guide in guides.items():
        if along is not None and abs(guide @ along) < PARALLEL:
            shown = show_direction(along)
            draft.add(
                ("joints", joint, "axis"),
                f"{motion} {show_direction(guide)}, but axis {name}, which it belongs to, moves along {shown}: it would block the "
                f"axis; write axis = {shown}, or remove it from the joints of the axis",
            )


def _check_moves(
    key: KeyPath, axis: AxisTable, scene: SceneTable, edges: dict[str, Edge], findings: Findings
) -> None:
    joints = ", ".join(axis.joint_names())
    moves = set(axis.moves or _moved_components(scene.components, edges, axis.joint_names()))
    if not moves:
        findings.add(
            key,
            f"moves nothing: without {joints} every component is still connected to ground; list every joint of the axis, "
            'or name the components that move: moves = ["slider"]',
        )
        return
    for joint in axis.joint_names():
        sides = [side in moves for side in edges[joint]]
        if sum(sides) != 1:
            both = "both ends" if all(sides) else "no end"
            findings.add(
                key,
                f"joint {joint} has {both} on components that the axis moves ({', '.join(sorted(moves))}); correct joints or moves",
            )
