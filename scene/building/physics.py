"""Checks of a scene's physics: solids and patches, joints, floating components, axes, and numbers that look wrong."""

import math
from pathlib import Path

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.joints import GROUND
from headstock.geometry.parts.components import weigh_modes
from headstock.geometry.parts.mass_properties import solid_volume
from headstock.geometry.parts.solids import Box, HollowColumn, Plate, Solid, SuperelementFile, Tube
from headstock.scene.building.components import (
    bounding_box,
    build_patch,
    build_solid,
    find_dense_patch,
    find_load_fault,
    find_mesh_faults,
    find_patch_fault,
    find_segment_faults,
)
from headstock.scene.building.joints import build_joint, connects, find_joint_faults
from headstock.scene.building.machine import Edge, find_position_fault, find_unit_fault, floating_groups, moved_components
from headstock.scene.building.names import is_known_end, sound_joints
from headstock.scene.building.rails import check_rails
from headstock.scene.reading.findings import Findings
from headstock.scene.reading.positions import KeyPath
from headstock.scene.reading.units import ANGLE, LENGTH, Quantity
from headstock.scene.schema.components import ComponentTable, PatchTable
from headstock.scene.schema.connections import AxisTable, LoadTable, SupportTable
from headstock.scene.schema.effects import STANDARD_GRAVITY, find_effect_fault
from headstock.scene.schema.scene import SceneTable
from headstock.scene.schema.types import show_direction

SOUND_SPEEDS = (500.0, 15000.0)
DENSITIES = (100.0, 25000.0)
SIZES = (1e-5, 100.0)
MASS_RATIOS = (0.05, 20.0)  # of a written mass to that of the solid
MOST_DEFLECTION = 1.0  # under the own weight on springs to ground [m]; air springs of 1 Hz have 0.25 m
MOST_MODES = 3000
PARALLEL = math.cos(math.radians(1.0))


def check_physics(scene: SceneTable, folder: Path, findings: Findings, *, complete: bool) -> None:
    """Report everything the schema cannot see.

    Args:
        scene: What passed the schema.
        folder: Folder of the scene, for the files it refers to.
        findings: Where problems and warnings go.
        complete: Every entry passed the schema, so that a missing connection means what it says.
    """
    solids = _check_solids(scene, folder, findings)
    _check_areas(scene, solids, findings)
    _check_probes(scene, findings)
    _check_joints(scene, findings)
    check_rails(scene, solids, findings)
    if complete and not scene.is_lumped:
        _check_floating(scene, findings)
    _check_axes(scene, findings, complete=complete)
    _check_poses(scene, findings)
    _check_effects(scene, findings)
    if complete:
        _check_requests(scene, findings)
    _check_plausibility(scene, solids, findings)
    _check_mounts(scene, solids, findings)
    _check_mode_counts(scene, solids, findings)


def _check_solids(scene: SceneTable, folder: Path, findings: Findings) -> dict[str, Solid]:
    solids: dict[str, Solid] = {}
    for name, table in scene.components.items():
        key: KeyPath = ("components", name)
        try:
            solids[name] = build_solid(table.solid, folder)
        except ValueError as error:
            findings.add((*key, "solid", table.solid.kind), str(error))
            continue
        _check_fidelity(key, table, solids[name], findings)
        if isinstance(solids[name], SuperelementFile):
            continue
        for interface, entry in table.interfaces.items():
            for index, patch in enumerate(entry.patch_tables()):
                place = ("patches", index) if entry.patches is not None else ()
                fault = find_patch_fault(patch, solids[name])
                if fault := fault or find_dense_patch(table, build_patch(patch, solids[name]), solids[name]):
                    findings.add((*key, "interfaces", interface, *place), fault)
    return solids


def _check_fidelity(key: KeyPath, table: ComponentTable, solid: Solid, findings: Findings) -> None:
    for place, fault in find_segment_faults(table, solid):
        findings.add((*key, *place), fault)
    for place, fault in find_mesh_faults(table, solid):
        findings.add((*key, *place), fault)
    if table.solid.superelement is not None:
        if table.fidelity != "elastic":
            findings.add((*key, "fidelity"), "a superelement file is elastic as it is; remove fidelity")
        if table.mass is not None:
            findings.add((*key, "mass"), "a superelement file brings its own mass; remove mass")


def _check_probes(scene: SceneTable, findings: Findings) -> None:
    for name, probe in scene.probes.items():
        table = scene.components.get(probe.component)
        if table is not None and (table.fidelity != "elastic" or table.solid.superelement is not None):
            findings.add(("probes", name), f"{probe.component} is not meshed, so there is no stress in it; make it elastic")
    if scene.probes and scene.analyses.static is None:
        findings.add(("probes",), "probes show the response to static loads; add [analyses.static]")
    if scene.probes and not scene.loads and not scene.effects.get("gravity"):
        findings.add(("probes",), "nothing loads the machine; add [loads.NAME] or the effect gravity")


def _check_areas(scene: SceneTable, solids: dict[str, Solid], findings: Findings) -> None:
    entries: list[tuple[KeyPath, SupportTable | LoadTable]] = [(("supports", n), s) for n, s in scene.supports.items()]
    entries += [(("loads", n), s) for n, s in scene.loads.items()]
    for key, entry in entries:
        if isinstance(entry, SupportTable):
            owner = (entry.face or entry.at or "").partition(".")[0]
            table = scene.components.get(owner)
            if table is not None and (table.fidelity != "elastic" or table.solid.superelement is not None):
                findings.add(key, f"{owner} is not meshed, so no points of it can be held; use a joint of kind rigid to ground")
        elif fault := find_load_fault(entry, scene.components.get((entry.face or entry.at or "").partition(".")[0])):
            findings.add((*key, "pressure"), fault)
        if entry.face is None:
            continue
        component, _, face = entry.face.partition(".")
        if component in solids:
            patch = PatchTable(face=face, disk=entry.disk, rect=entry.rect, strip=entry.strip)
            if fault := find_patch_fault(patch, solids[component]):
                findings.add((*key, "face"), fault)


def _check_joints(scene: SceneTable, findings: Findings) -> None:
    for name, table in scene.joints.items():
        for fault in find_joint_faults(table):
            findings.add(("joints", name, *fault.key), fault.message)


def _edges(scene: SceneTable) -> dict[str, Edge]:
    """The two sides of every joint that transmits a force and of every support, by name."""
    edges: dict[str, Edge] = {}
    for name, table in sound_joints(scene).items():
        # a joint with a fault counts as a connection: its own message is enough
        if find_joint_faults(table) or connects(build_joint(name, table)):
            first, second = (end.component or GROUND for end in table.between)
            edges[name] = (first, second)
    for name, support in scene.supports.items():
        edges[f"supports.{name}"] = ((support.face or support.at or "").partition(".")[0], GROUND)
    return edges


def _check_floating(scene: SceneTable, findings: Findings) -> None:
    known = all(is_known_end(end, scene) for table in scene.joints.values() for end in table.between)
    if scene.free or not known:
        return
    for group in floating_groups(scene.components, _edges(scene).values()):
        if any(scene.components[name].free for name in group):
            continue
        verb = "floats" if len(group) == 1 else "float together"
        findings.add(
            ("components", group[0]),
            f"{', '.join(group)} {verb}: 6 rigid motions are free, since no joint or support leads to ground; join "
            f'{"it" if len(group) == 1 else "one of them"} to "ground" or to a component that stands on it, or write free = true',
        )


def _check_axes(scene: SceneTable, findings: Findings, *, complete: bool) -> None:
    edges = _edges(scene)
    for name, axis in scene.axes.items():
        key: KeyPath = ("axes", name)
        wanted = LENGTH if axis.kind == "linear" else ANGLE
        for index, limit in enumerate(axis.limits or ()):
            if fault := find_unit_fault(limit, axis):
                findings.add((*key, "limits", index), fault)
        limits = axis.limits or ()
        if limits and all(limit.dimension == wanted for limit in limits) and limits[0].value >= limits[1].value:
            findings.add((*key, "limits"), "the lower limit must be below the upper one")
        known = all(joint in scene.joints for joint in axis.joint_names())
        if axis.direction is None and known and not _guiding_joints(scene, axis):
            findings.add((*key, "direction"), "'direction' is missing and no joint of the axis gives one; write direction = \"x\"")
        _check_guides(name, axis, scene, findings)
        if complete and all(joint in edges for joint in axis.joint_names()):
            _check_moves(key, axis, scene, edges, findings)


def _guiding_joints(scene: SceneTable, axis: AxisTable) -> dict[str, FloatArray]:
    """Unit vectors ``(3,)`` along which the guides and screws of an axis slide, or about which its bearings turn, by joint."""
    kinds = ("linear_guide", "ball_screw", "prismatic") if axis.kind == "linear" else ("revolute", "bearing")
    tables = {name: scene.joints[name] for name in axis.joint_names() if name in scene.joints}
    return {name: np.array(table.axis) for name, table in tables.items() if table.kind in kinds and table.axis is not None}


def _check_guides(name: str, axis: AxisTable, scene: SceneTable, findings: Findings) -> None:
    """Every guide, screw and bearing of an axis must let go of the motion that the axis makes."""
    guides = _guiding_joints(scene, axis)
    motion = "slides along" if axis.kind == "linear" else "turns about"
    given = None if axis.direction is None else np.array(axis.direction)
    # without a direction of its own the axis has that of most of its joints
    votes = sorted(guides.values(), key=lambda own: -sum(abs(float(own @ other)) for other in guides.values()))
    along = given if given is not None else votes[0] if votes else None
    for joint, own in guides.items():
        if along is not None and abs(own @ along) < PARALLEL:
            findings.add(
                ("joints", joint, "axis"),
                f"{motion} {show_direction(own)}, but axis {name}, which it belongs to, moves along {show_direction(along)}: it would block the "
                f"axis; write axis = {show_direction(along)}, or take it off the axis' joints",
            )


def _check_moves(key: KeyPath, axis: AxisTable, scene: SceneTable, edges: dict[str, Edge], findings: Findings) -> None:
    joints = ", ".join(axis.joint_names())
    moves = set(axis.moves or moved_components(scene.components, edges, axis.joint_names()))
    if not moves:
        findings.add(
            key,
            f"moves nothing: without {joints} every component is still connected to ground; list every joint the axis slides in, "
            'or name what it carries: moves = ["slider"]',
        )
        return
    for joint in axis.joint_names():
        sides = [side in moves for side in edges[joint]]
        if sum(sides) != 1:
            both = "both sides" if all(sides) else "no side"
            findings.add(
                key, f"joint {joint} has {both} among what the axis moves ({', '.join(sorted(moves))}); correct joints or moves"
            )


def _check_poses(scene: SceneTable, findings: Findings) -> None:
    values: list[tuple[KeyPath, str, Quantity]] = []
    for pose, positions in scene.poses.items():
        values += [(("poses", pose, axis), axis, value) for axis, value in positions.items()]
    for sweep, table in scene.sweeps.items():
        values += [(("sweeps", sweep, *key), axis, value) for key, axis, value in table.quantities()]
    for key, axis, value in values:
        if axis in scene.axes and (fault := find_position_fault(axis, value, scene)):
            findings.add(key, fault)


def _check_effects(scene: SceneTable, findings: Findings) -> None:
    for name, value in scene.effects.items():
        if fault := find_effect_fault(name, value):
            findings.add(("effects", name), fault)


def _check_requests(scene: SceneTable, findings: Findings) -> None:
    static = scene.analyses.static
    if static is not None and static.at is None and not scene.points and not scene.loads:
        example = 'tcp = { tool = "component.interface", work = "ground" }'
        findings.add(("analyses", "static"), f"there is no point to compute a compliance at; write [points] {example}")
    frf = scene.analyses.frf
    if frf is not None and frf.inputs is None and not scene.points:
        findings.add(("analyses", "frf"), 'there is no point to take a response at; write [points], or inputs = [["tcp", "x"]]')
    if not scene.components:
        findings.add(("components",), "there are no components; write [components.NAME] with a solid and a material")


def _check_plausibility(scene: SceneTable, solids: dict[str, Solid], findings: Findings) -> None:
    for name, material in scene.materials.items():
        speed = math.sqrt(material.E / material.rho)
        key: KeyPath = ("materials", name)
        low, high = SOUND_SPEEDS
        if not low <= speed <= high:
            hint = "check E and rho"
            if material.E < 1e7 or material.rho < 1e-3:
                hint = "these look like mm-t-s numbers: write MPa and t/mm^3"
            findings.warn((*key, "E"), f"sound would travel at {speed:.3g} m/s, outside {low:g} to {high:g} m/s; {hint}")
        if not DENSITIES[0] <= material.rho <= DENSITIES[1]:
            findings.warn((*key, "rho"), f"{material.rho:.3g} kg/m^3 is outside {DENSITIES[0]:g} to {DENSITIES[1]:g} kg/m^3")
    for name, solid in solids.items():
        box = bounding_box(solid)
        sizes = [high - low for low, high in box] if box else []
        if sizes and not (SIZES[0] <= min(sizes) and max(sizes) <= SIZES[1]):
            text = " x ".join(f"{size:.3g}" for size in sizes)
            findings.warn(("components", name, "solid"), f"measures {text} m; a machine part is {SIZES[0]:g} to {SIZES[1]:g} m")
        _check_weight(name, solid, scene, findings)
        if scene.components[name].mesh.order == 1 and scene.components[name].fidelity == "elastic":
            findings.warn(("components", name, "mesh"), "linear elements lock: they come out too stiff; order = 2 is the default")


def _check_weight(name: str, solid: Solid, scene: SceneTable, findings: Findings) -> None:
    """A mass that is written is about that of the solid: a slip of units is off by a thousand."""
    table = scene.components[name]
    own = _own_mass(table, solid, scene)
    if table.mass is None or own is None:
        return
    low, high = MASS_RATIOS
    if not low <= table.mass / own <= high:
        findings.warn(("components", name, "mass"), f"{table.mass:.3g} kg for a solid that weighs {own:.3g} kg; check the unit")


def _own_mass(table: ComponentTable, solid: Solid, scene: SceneTable) -> float | None:
    """Mass of a parametric solid of its material [kg]; None where the solid or the material is not known here."""
    material = scene.materials.get(table.material or "")
    if material is None or not isinstance(solid, Box | Tube | Plate | HollowColumn):
        return None
    return material.rho * solid_volume(solid)


def _check_mounts(scene: SceneTable, solids: dict[str, Solid], findings: Findings) -> None:
    """Springs to ground carry the weight of what is known of the machine without a deflection of metres."""
    grounded = {name: table for name, table in sound_joints(scene).items() if any(end.component is None for end in table.between)}
    joints = [build_joint(name, table) for name, table in grounded.items() if not find_joint_faults(table)]
    if not joints or scene.supports or len(joints) < len(grounded) or any(joint.held for joint in joints):
        return
    tables = scene.components
    known = [tables[name].mass or _own_mass(tables[name], solid, scene) or 0.0 for name, solid in solids.items()]
    stiffness = sum(joint.rotation @ joint.stiffness[:3, :3] @ joint.rotation.T for joint in joints)
    stiffest = float(np.linalg.eigvalsh(stiffness)[-1])
    deflection = math.inf if stiffest <= 0.0 else sum(known) * STANDARD_GRAVITY / stiffest
    if deflection > MOST_DEFLECTION:
        names = ", ".join(grounded)
        findings.warn(
            ("joints", next(iter(grounded)), "stiffness"),
            f"{names}: {sum(known):.3g} kg on {stiffest:.3g} N/m in the stiffest direction would sink by {deflection:.3g} m under their "
            "weight; check the unit",
        )


def _check_mode_counts(scene: SceneTable, solids: dict[str, Solid], findings: Findings) -> None:
    """How high an analysis looks: nobody can use the modes of a solid by the thousands.

    Source: Weyl (1911): the number of natural frequencies below ``f`` of a volume ``V`` grows like ``4 pi/3 V f^3 (1/c_p^3 + 2/c_s^3)``.
    """
    analyses = scene.analyses
    asked: dict[KeyPath, float | None] = {
        ("analyses", "modal", "up_to"): None if analyses.modal is None else analyses.modal.up_to,
        ("analyses", "frf", "to"): None if analyses.frf is None else analyses.frf.to,
        ("analyses", "control", "up_to"): None if analyses.control is None else analyses.control.up_to,
    }
    limits = {name: _highest_frequency(scene.components[name], solid, scene) for name, solid in solids.items()}
    elastic = {name: limit for name, limit in limits.items() if limit is not None and scene.components[name].fidelity == "elastic"}
    for name, limit in elastic.items():
        own = scene.components[name].reduction.modes_to
        if own is not None and own > limit:
            findings.add(("components", name, "reduction", "modes_to"), _too_high(own, name, limit))
    # a component with a cut-off or a number of modes of its own does not follow the analyses
    tables = scene.components
    following = {
        name: limit for name, limit in elastic.items() if tables[name].reduction.modes_to is tables[name].reduction.modes is None
    }
    lowest = min(following, key=lambda name: following[name], default=None)
    for place, wanted in asked.items():
        if lowest is not None and wanted is not None and wanted > following[lowest]:
            findings.add(place, _too_high(wanted, lowest, following[lowest]))


def _too_high(wanted: float, component: str, limit: float) -> str:
    return f"{wanted:.3g} Hz: {component} alone has more than {MOST_MODES} natural frequencies up to there; write {limit:.2g} Hz at most"


def _highest_frequency(table: ComponentTable, solid: Solid, scene: SceneTable) -> float | None:
    """Frequency [Hz] up to which a solid has ``MOST_MODES`` natural frequencies; None where its volume is not known here."""
    material = scene.materials.get(table.material or "")
    if material is None or not isinstance(solid, Box | Tube | Plate | HollowColumn) or not -1.0 < material.nu < 0.5:
        return None
    if not SOUND_SPEEDS[0] <= math.sqrt(material.E / material.rho) <= SOUND_SPEEDS[1]:
        return None  # a slip of units, warned of elsewhere
    return float((MOST_MODES / (solid_volume(solid) * weigh_modes(material.E, material.nu, material.rho))) ** (1.0 / 3.0))
