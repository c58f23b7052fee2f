"""Points, supports, loads and probes of a machine: built from their tables, and what may be wrong
with them.
"""

import math

from headstock.geometry.machine.joints import JointEnd
from headstock.geometry.machine.machine import JointDisplacement, Point
from headstock.geometry.parts.components import Component, Load, Patch, Support
from headstock.scene.building.components import bounding_box, build_patch, find_patch_fault
from headstock.scene.building.draft import Draft, list_records
from headstock.scene.building.joints import KINDS
from headstock.scene.reading.findings import KeyPath
from headstock.scene.schema.axes import PointTable
from headstock.scene.schema.components import ComponentTable
from headstock.scene.schema.loads import LoadTable, SupportTable
from headstock.scene.schema.patches import PatchTable

SMALL_ROTATION = 0.02  # [rad]: beyond, 1 - cos exceeds 2e-4
OUTSIDE = 1e-9  # [m]: rounding of a place on a face
LONGEST_OFFSET = 10.0  # of a point from its interface [m]


def build_support(name: str, table: SupportTable, components: dict[str, Component]) -> Support:
    """The support a faultless table stands for.

    Args:
        components: Every component of the machine by name.
    """
    component = table.owner
    if table.edge is None:
        return Support(name, component, _build_area(table, components), tuple(table.fix))
    first, second = (
        build_patch(PatchTable(face=face.partition(".")[2]), components[component].solid)
        for face in table.edge
    )
    return Support(name, component, (first,), tuple(table.fix), (second,))


def build_load(name: str, table: LoadTable, components: dict[str, Component]) -> Load:
    """The load a faultless table stands for.

    Args:
        components: Every component of the machine by name.
    """
    if table.kind == "body":
        return Load(name, table.component or "", "body", vector=tuple(table.body or ()))
    component, _, area = (table.at or table.face or "").partition(".")
    if table.kind == "force":
        vector = (*(table.force or (0.0, 0.0, 0.0)), *(table.moment or (0.0, 0.0, 0.0)))
        return Load(name, component, "force", interface=area, vector=vector)
    patches = _build_area(table, components)
    if table.kind == "pressure":
        return Load(name, component, "pressure", patches, magnitude=table.pressure or 0.0)
    return Load(name, component, "traction", patches, vector=tuple(table.traction or ()))


def build_point(name: str, table: PointTable) -> Point:
    """The point a faultless table stands for."""
    x, y, z = table.offset
    return Point(name, table.tool, table.work, (x, y, z))


def build_displacement(name: str, table: LoadTable) -> JointDisplacement:
    """The displacement a faultless table stands for."""
    x, y, z = table.displacement or (0.0, 0.0, 0.0)
    rx, ry, rz = table.rotation or (0.0, 0.0, 0.0)
    return JointDisplacement(name, table.joint or "", (x, y, z, rx, ry, rz))


def check_points(draft: Draft) -> None:
    """Report points whose ends are unknown or the same."""
    for name, point in draft.table.points.items():
        draft.check_end(("points", name, "tool"), point.tool)
        draft.check_end(("points", name, "work"), point.work)
        if point.tool == point.work:
            draft.add(
                ("points", name),
                "tool and work are the same, so their relative motion is zero; name two different ends",
            )
        if (length := math.hypot(*point.offset)) > LONGEST_OFFSET:
            draft.add(
                ("points", name, "offset"),
                f"is {length:.4g} m long, and a rigid extension of a tool or a workpiece is {LONGEST_OFFSET:g} m at most; check the unit",
            )


def check_supports(draft: Draft) -> None:
    """Report supports on unknown areas, and on components that are not meshed."""
    for name, table in draft.table.supports.items():
        _check_area(("supports", name), table, draft)
        for number, face in enumerate(table.edge or ()):
            _check_face(
                ("supports", name, "edge", number),
                table.owner,
                PatchTable(face=face.partition(".")[2]),
                draft,
            )
        owner = table.owner
        if owner in draft.table.components and not _is_meshed(draft.table.components[owner]):
            draft.add(
                ("supports", name),
                f"{owner} is not meshed, so no points of it can be fixed; use a joint of kind rigid to ground",
            )


def check_loads(draft: Draft) -> None:
    """Report loads on unknown areas and components, and pressures without a mesh to act on."""
    for name, table in draft.table.loads.items():
        if table.joint is not None:
            _check_displacement(("loads", name), table, draft)
            continue
        if table.base is not None:
            continue
        _check_area(("loads", name), table, draft)
        if table.component is not None:
            draft.check_name(("loads", name, "component"), table.component, "components")
        component = draft.table.components.get(table.owner)
        fault = _find_load_fault(table, component)
        if draft.table.is_lumped and table.kind == "pressure":
            fault = (
                "a pressure acts on the faces of a mesh, and the bodies of the lumped model are rigid; write a traction or a force, or"
                ' model = "components" with an elastic component'
            )
        if fault:
            draft.add(("loads", name, "pressure"), fault)


def _check_displacement(key: KeyPath, table: LoadTable, draft: Draft) -> None:
    draft.check_name((*key, "joint"), table.joint or "", "joints")
    joint = draft.table.joints.get(table.joint or "")
    if joint is None:
        return
    if not (joint.stiffness or joint.stiffness_per_area or KINDS[joint.kind].fixed):
        draft.add(
            (*key, "joint"),
            f"{table.joint} neither fixes a direction nor has a stiffness, so nothing follows it; name another joint",
        )
    turning = max(map(abs, table.rotation or [0.0]))
    if turning > SMALL_ROTATION:
        draft.add(
            (*key, "rotation"),
            f"is {math.degrees(turning):.3g} deg, and deflections are linear; write at most {math.degrees(SMALL_ROTATION):.2g} deg",
        )
    if "volumetric" in draft.table.analyses.requested:
        draft.add(
            key,
            "a volumetric map takes forces, gravity and errors of guides; put the displacement in a variant without it",
        )


def check_scene_probes(draft: Draft) -> None:
    """Report probes in unmeshed components, and probes of a machine that nothing loads."""
    scene = draft.table
    for name, probe in scene.probes.items():
        draft.check_name(("probes", name, "component"), probe.component, "components")
        table = scene.components.get(probe.component)
        if table is not None and not _is_meshed(table):
            draft.add(
                ("probes", name),
                f"{probe.component} is not meshed, so there is no stress in it; make it elastic",
            )
        solid = draft.solids.get(probe.component)
        box = None if solid is None else bounding_box(solid)
        if box is not None and not all(
            low - OUTSIDE <= coordinate <= high + OUTSIDE
            for coordinate, (low, high) in zip(probe.at, box, strict=True)
        ):
            ends = ", ".join(f"{1e3 * low:g} to {1e3 * high:g} mm" for low, high in box)
            draft.add(
                ("probes", name, "at"),
                f"lies outside {probe.component}, which reaches over x, y, z from {ends} in its own frame",
            )
    if scene.probes:
        _check_probe_loads(draft)


def _check_probe_loads(draft: Draft) -> None:
    scene = draft.table
    loaded = {table.loads_probes for table in scene.analyses.requested.values()}
    if "by itself" in loaded:
        return
    if "by the scene" not in loaded:
        *first, last = [
            f"[analyses.{record.request.analysis}]"
            for record in list_records()
            if record.table.loads_probes
        ]
        draft.add(
            ("probes",),
            "probes show the response to static or harmonic loads, to loads over time and along paths and contours; add"
            f" {', '.join(first)} or {last}",
        )
    if not scene.loads and "gravity" not in scene.active:
        draft.add(("probes",), "nothing loads the machine; add [loads.NAME] or the effect gravity")


def _find_load_fault(load: LoadTable, component: ComponentTable | None) -> str:
    """Why a load cannot act on its component; empty when it can."""
    if component is not None and component.solid.point_mass is not None:
        surface = load.kind in ("pressure", "traction")
        return "a point mass has no surface; write a force at its center" if surface else ""
    if (
        component is None
        or component.solid.superelement is not None
        or load.kind != "pressure"
        or component.fidelity == "elastic"
    ):
        return ""
    return f"a pressure needs a mesh and the component is {component.fidelity}; write a traction or a force, or make it elastic"


def _build_area(
    table: SupportTable | LoadTable, components: dict[str, Component]
) -> tuple[Patch, ...]:
    """Patches of an interface, or the one that the table itself describes."""
    component, _, area = (table.at or table.face or "").partition(".")
    if table.at is not None:
        return components[component].interfaces[area].patches
    return (build_patch(_read_patch(table), components[component].solid),)


def _read_patch(table: SupportTable | LoadTable) -> PatchTable:
    face = (table.face or "").partition(".")[2]
    return PatchTable.model_validate({"face": face, **table.shapes})


def _is_meshed(table: ComponentTable) -> bool:
    return table.fidelity == "elastic" and table.solid.superelement is None


def _check_area(key: KeyPath, table: SupportTable | LoadTable, draft: Draft) -> None:
    if table.at is not None:
        component, _, interface = table.at.partition(".")
        draft.check_end((*key, "at"), JointEnd(component, interface))
    elif table.face is not None:
        owner = table.face.partition(".")[0]
        _check_face((*key, "face"), owner, _read_patch(table), draft)


def _check_face(key: KeyPath, component: str, patch: PatchTable, draft: Draft) -> None:
    draft.check_name(key, component, "components")
    if component in draft.solids and (fault := find_patch_fault(patch, draft.solids[component])):
        draft.add(key, fault)
