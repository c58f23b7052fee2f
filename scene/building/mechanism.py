"""The mechanism of a scene: built from its table, and what may be wrong with it."""

from collections.abc import Mapping

import numpy as np

from headstock.geometry.errors import PoseError
from headstock.geometry.mechanisms.exechon import (
    LENGTHS,
    TOOL_AXES,
    ExechonDimensions,
    MountedExechon,
    exechon_mechanism,
    solve_pose,
)
from headstock.geometry.mechanisms.mechanism import Mechanism
from headstock.scene.building.axes import find_measure_fault
from headstock.scene.building.components import build_frame
from headstock.scene.building.draft import Draft
from headstock.scene.reading.findings import Findings
from headstock.scene.reading.units import ANGLE, LENGTH
from headstock.scene.scene import LegSprings, SceneMechanism
from headstock.scene.schema.axes import MechanismTable
from headstock.scene.schema.loads import LoadTable
from headstock.scene.schema.scene import SceneTable


def build_mechanism(table: MechanismTable) -> SceneMechanism:
    """The mechanism of a scene that has passed every check."""
    limits = {name: (low.value, high.value) for name, (low, high) in table.limits.items()}
    dimensions = table.dimensions.fill(ExechonDimensions)
    mounted = MountedExechon(dimensions, build_frame(table.at, table.rotate), limits)
    return SceneMechanism(
        kind=table.kind,
        model=table.model,
        mounted=mounted,
        tool=np.array(table.tool),
        carries={
            component: marker for marker, names in table.carries.items() for component in names
        },
        springs=None if table.springs is None else table.springs.fill(LegSprings),
        screw_lead=table.screw_lead,
    )


def check_mechanism(draft: Draft) -> None:
    """Report what is wrong with a mechanism, apart from poses that it cannot take, and with what is
    required of it.
    """
    scene = draft.table
    table = scene.mechanism
    if table is None:
        return
    if "orientation" in scene.model_fields_set:
        draft.add(
            ("orientation",),
            "a mechanism is placed by its own `at` and `rotate`; move orientation there",
        )
    mechanism = exechon_mechanism(table.dimensions.fill(ExechonDimensions))
    _check_carried(table, mechanism, scene, draft.findings)
    _check_limits(table, mechanism, draft.findings)
    for name in set(scene.axes) & set(TOOL_AXES):
        draft.add(
            ("axes", name),
            f"{name} is already a coordinate of the tool of the mechanism; remove this axis",
        )


def check_reach(draft: Draft) -> None:
    """Report poses that a mechanism cannot take; one with a fault of its own takes none."""
    table = draft.table.mechanism
    if table is None or draft.findings.concern("mechanism", "poses"):
        return
    mechanism = build_mechanism(table)
    for name, positions in draft.table.poses.items():
        try:
            solve_pose(mechanism, {axis: value.value for axis, value in positions.items()})
        except PoseError as error:
            draft.add(("poses", name), f"cannot be taken: {error}")


def _check_carried(
    table: MechanismTable, mechanism: Mechanism, scene: SceneTable, findings: Findings
) -> None:
    carried: dict[str, str] = {}
    for marker, names in table.carries.items():
        findings.check_name(
            ("mechanism", "carries", marker),
            marker,
            mechanism.markers,
            "body",
            "bodies of the mechanism",
        )
        for index, name in enumerate(names):
            key = ("mechanism", "carries", marker, index)
            findings.check_name(key, name, scene.components, "component", "components")
            if name in carried:
                findings.add(key, f"{name} is carried by {carried[name]} too; keep one")
            carried[name] = marker
    if scene.is_lumped:
        for name, load in scene.loads.items():
            _check_lumped_load(name, load, carried, findings)
        for name, point in scene.points.items():
            if point.tool.component not in carried or point.work.component is not None:
                findings.add(
                    ("points", name),
                    'the lumped model has motions of carried components relative to ground only; write work = "ground"',
                )


def _check_lumped_load(
    name: str, load: LoadTable, carried: Mapping[str, str], findings: Findings
) -> None:
    """Report a displacement, which needs a joint, and a load on a body that stands still."""
    if load.kind == "displacement":
        findings.add(
            ("loads", name),
            'the lumped model has no joints that could be displaced; describe longer legs in [mechanism.errors], or write model = "components"',
        )
    elif load.kind != "pressure" and load.owner not in carried:
        findings.warn(
            ("loads", name),
            f"{load.owner[:80]} is carried by no body of the mechanism and stands still, so the load deflects nothing",
        )


def _check_limits(table: MechanismTable, mechanism: Mechanism, findings: Findings) -> None:
    movable = (*mechanism.driven, *mechanism.passive)
    for name, values in table.limits.items():
        key = ("mechanism", "limits", name)
        findings.check_name(key, name, movable, "coordinate", "coordinates")
        if name not in movable:
            continue
        wanted = LENGTH if name in LENGTHS else ANGLE
        faults = [find_measure_fault(name, value, wanted) for value in values]
        if any(faults):
            findings.add(key, max(faults))
        elif values[0].value >= values[1].value:
            findings.add(key, "the lower limit must be below the upper one")
