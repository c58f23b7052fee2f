"""Checks of rails and of the carriages on them: what a rail lies on, who rides on it, and whether a
pose leaves it.
"""

import math

from headstock.geometry.machine.carriages import (
    LEAST_INTERVALS,
    count_control_points,
    find_overhangs,
    rail_span,
)
from headstock.geometry.machine.joints import JointEnd
from headstock.geometry.machine.machine import show_position
from headstock.geometry.parts.patches import OVERHANG_TOLERANCE
from headstock.geometry.parts.prismatic_bars import prismatic_bar
from headstock.geometry.parts.solids import Solid
from headstock.scene.building.components import build_interface
from headstock.scene.building.draft import Draft, is_known_end
from headstock.scene.reading.findings import Findings, KeyPath
from headstock.scene.scene import Scene
from headstock.scene.schema.components import ComponentTable, InterfaceTable, RailTable
from headstock.scene.schema.joints import JointTable
from headstock.scene.schema.scene import SceneTable

DEFAULT_INTERVALS = 2.5  # intervals of control points per carriage length: docs/guideways.md says what more or fewer give

Ends = dict[tuple[str, str], list[str]]


def _default_control_points(
    span: tuple[float, float], length: float, intervals: float = DEFAULT_INTERVALS
) -> int:
    """Control points of a rail for a carriage of a length [m].

    Args:
        span: Where the rail begins and ends [m].
        length: Of the carriage [m].
        intervals: Between control points, per length of the carriage.
    """
    return count_control_points(span[1] - span[0], length, intervals)


def _carriage_joints(scene: SceneTable) -> Ends:
    """Joints on each rail of the scene, by component and interface."""
    joints_on: Ends = {
        (name, key): []
        for name, table in scene.components.items()
        for key, entry in table.interfaces.items()
        if entry.rail
    }
    for name, joint in scene.joints.items():
        for end in joint.between:
            if (end.component or "", end.interface or "") in joints_on:
                joints_on[end.component or "", end.interface or ""].append(name)
    return joints_on


def _shortest_carriage(scene: SceneTable, joints: list[str]) -> float | None:
    """Length of the shortest carriage among joints [m]."""
    lengths = [length for name in joints if (length := scene.joints[name].length) is not None]
    return min(lengths, default=None)


def choose_control_points(scene: SceneTable, solids: dict[str, Solid]) -> dict[str, dict[str, int]]:
    """Control points of every rail by component and interface, from its length and the shortest carriage
    on it where both are known.
    """
    counts: dict[str, dict[str, int]] = {name: {} for name in scene.components}
    for (component, name), joints in _carriage_joints(scene).items():
        span = _span_of(scene.components[component].interfaces[name], solids[component])
        shortest = _shortest_carriage(scene, joints)
        if span is not None and shortest is not None:
            counts[component][name] = _default_control_points(span, shortest)
    return counts


def check_rails(draft: Draft) -> None:
    """Report what is wrong with rails and with joints on them, apart from poses."""
    scene, solids = draft.table, draft.solids
    riders = _carriage_joints(scene)
    for (component, name), joints in riders.items():
        if component in solids:
            _check_rail(component, name, scene, solids[component], joints, draft.findings)
    for name, joint in scene.joints.items():
        rails = [
            end for end in joint.between if (end.component or "", end.interface or "") in riders
        ]
        if fault := _find_joint_fault(joint, rails, scene):
            draft.add(("joints", name, *fault[0]), fault[1])


def check_carriages(scene: Scene, findings: Findings) -> None:
    """Report every carriage that hangs over the end of its rail in a pose of the scene."""
    for name, pose in scene.poses.items():
        for joint, fault in find_overhangs(scene.machine, pose).items():
            findings.add(("poses", name) if pose.positions else ("joints", joint), fault)


def _check_rail(
    component: str,
    name: str,
    scene: SceneTable,
    solid: Solid,
    joints: list[str],
    findings: Findings,
) -> None:
    part, table = scene.components[component], scene.components[component].interfaces[name]
    key: KeyPath = ("components", component, "interfaces", name, "rail")
    if table.rail is None:
        return
    if crossing := [
        patch.face
        for patch in table.patch_tables()
        if patch.face[:1] == table.rail.along and patch.face[1:] in "-+"
    ]:
        findings.add(
            key,
            f"face {crossing[0]} is square to {table.rail.along}, so no rail runs along it; write another face or along",
        )
        return
    span, shortest = _span_of(table, solid), _shortest_carriage(scene, joints)
    if span is None and part.fidelity != "elastic":
        findings.add(
            key,
            "where the rail ends is not known without a mesh; write its area as a rect with centre and size",
        )
    if span is not None and shortest is not None:
        _check_carriage_lengths(f"{component}.{name}", span, joints, scene, findings)
        _warn_of_segments(key, part, solid, shortest, findings)
        if part.fidelity == "elastic":
            _check_control_points(key, table.rail, span, shortest, findings)
    elif shortest is None and (joints or findings.concern("joints")):
        return  # the joint that lacks a length, or cannot be made, is reported
    elif table.rail.control_points is None:
        reason = (
            "no carriage rides on it"
            if shortest is None
            else "its length is known only when it is meshed"
        )
        findings.add(
            key,
            f'{reason}, so its control_points must be given; write rail = {{ along = "{table.rail.along}", control_points = 12 }}',
        )


def _check_carriage_lengths(
    rail: str,
    span: tuple[float, float],
    joints: list[str],
    scene: SceneTable,
    findings: Findings,
) -> None:
    longest = span[1] - span[0]
    for joint in joints:
        length = scene.joints[joint].length
        if length is not None and length > longest * (1.0 + OVERHANG_TOLERANCE):
            findings.add(
                ("joints", joint, "length"),
                f"the carriage ({show_position(length)}) is longer than rail {rail} ({show_position(longest)});"
                " make the rail longer or the carriage shorter",
            )


def _check_control_points(
    key: KeyPath,
    rail: RailTable,
    span: tuple[float, float],
    shortest: float,
    findings: Findings,
) -> None:
    least = _default_control_points(span, shortest, LEAST_INTERVALS)
    if rail.control_points is not None and rail.control_points < least:
        findings.add(
            (*key, "control_points"),
            f"{rail.control_points} control points on {show_position(span[1] - span[0])} are too few for a carriage of "
            f"{show_position(shortest)}, whose stiffness would vary as it passes them; write at least {least}, better "
            f"{_default_control_points(span, shortest)}, or leave control_points away",
        )


def _warn_of_segments(
    key: KeyPath, table: ComponentTable, solid: Solid, shortest: float, findings: Findings
) -> None:
    """A segment gives way at its ends only: the stiffness of a carriage shorter than a segment varies as it passes them."""
    if table.fidelity != "segmented":
        return
    try:
        length = prismatic_bar(solid, table.segments.along).length
    except ValueError:  # no bar: reported with its fidelity
        return
    if shortest < length / table.segments.count:
        findings.warn(
            key,
            f"a carriage of {show_position(shortest)} is shorter than a segment of {show_position(length / table.segments.count)}, so its stiffness "
            f"varies as it passes the ends; write segments = {{ count = {math.ceil(2.0 * length / shortest)} }}",
        )


def _find_joint_fault(
    joint: JointTable, rails: list[JointEnd], scene: SceneTable
) -> tuple[KeyPath, str] | None:
    if len(rails) == 2:
        return (
            "between",
        ), "both ends are rails; one of them must be a fixed interface, that of the carriage"
    # an interface from a file may be a rail, and so may one that did not pass the schema
    complete = all(
        is_known_end(end, scene) and not _is_from_file(end, scene) for end in joint.between
    )
    if rails and joint.length is None:
        return (), f'a carriage on rail {rails[0]} needs its length; write length = "80 mm"'
    if not rails and joint.length is not None and complete:
        return (
            ("length",),
            "only a carriage on a rail has a length; remove it, or give the interface it slides on a rail",
        )
    if rails and joint.at is None and any(end.component is None for end in joint.between):
        return (
            (),
            'ground has no place of its own; write where the joint is: at = ["0 mm", "0 mm", "0 mm"]',
        )
    return None


def _is_from_file(end: JointEnd, scene: SceneTable) -> bool:
    return (
        end.component is not None and scene.components[end.component].solid.superelement is not None
    )


def _span_of(table: InterfaceTable, solid: Solid) -> tuple[float, float] | None:
    return rail_span(solid, build_interface("", table, solid))
