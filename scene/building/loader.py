"""Loads a scene file: reads, overrides, validates, checks and builds it, or says everything that is
wrong.
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from headstock.geometry.machine.joints import Axis, Joint
from headstock.geometry.machine.machine import Machine, Probe, orient_machine
from headstock.geometry.parts.components import Component, Support
from headstock.scene.building.axes import (
    build_axis,
    build_poses,
    check_axes,
    check_axis_moves,
    check_floating,
    check_poses,
)
from headstock.scene.building.components import (
    NO_MATERIAL,
    build_component,
    build_frame,
    build_material,
    build_sizes,
    build_solid,
    build_solids,
    check_components,
    check_presence,
)
from headstock.scene.building.cutting import check_cutting
from headstock.scene.building.draft import Draft, collect_interfaces, collect_sections, list_records
from headstock.scene.building.drives import build_drives, check_drives, check_effects
from headstock.scene.building.guide_errors import (
    build_axis_errors,
    build_leg_errors,
    build_rail_errors,
    check_guide_errors,
)
from headstock.scene.building.joints import build_joint, check_joints, couple_bearings
from headstock.scene.building.loads import (
    build_displacement,
    build_load,
    build_point,
    build_support,
    check_loads,
    check_points,
    check_probes,
    check_supports,
)
from headstock.scene.building.mechanism import (
    build_mechanism,
    check_mechanism,
    check_reach,
)
from headstock.scene.building.plausibility import (
    check_mode_counts,
    check_numbers,
    check_unused_interfaces,
)
from headstock.scene.building.rails import check_carriages, check_rails, choose_control_points
from headstock.scene.building.studies import (
    build_study,
    build_sweep,
    check_comparison,
    check_studies,
    check_sweep_carriages,
    check_sweeps,
    read_sweep_paths,
)
from headstock.scene.expansion.expansion import expand_scene
from headstock.scene.expansion.includes import INCLUDE, read_with_includes
from headstock.scene.expansion.overrides import (
    VARIANT_JOINER,
    apply_settings,
    apply_values,
    apply_variant,
)
from headstock.scene.reading.files import MAX_DEPTH, TomlTable, TomlValue, nesting_depth
from headstock.scene.reading.findings import Findings
from headstock.scene.scene import (
    AccuracyGoal,
    Analyses,
    CompareSettings,
    Limits,
    Scene,
    list_analyses,
)
from headstock.scene.schema.effects import (
    GRAVITY_STIFFENING,
    GUIDE_ERRORS,
    read_gravity,
    read_modal_damping,
    read_rayleigh_damping,
)
from headstock.scene.schema.scene import SceneTable
from headstock.scene.schema.validation import validate_tables

# These need entries that passed the schema, whatever else is wrong.
CHECKS_OF_ENTRIES: tuple[Callable[[Draft], None], ...] = (
    check_components,
    check_joints,
    check_rails,
    check_points,
    check_supports,
    check_loads,
    check_probes,
    check_axes,
    check_guide_errors,
    check_poses,
    check_effects,
    check_mechanism,
    check_cutting,
    check_sweeps,
    check_studies,
    check_comparison,
    check_numbers,
    check_unused_interfaces,
    check_mode_counts,
)
# These need all entries: what is not there is then missing, and not just refused.
CHECKS_OF_ALL_ENTRIES: tuple[Callable[[Draft], None], ...] = (
    check_floating,
    check_axis_moves,
    check_presence,
    check_drives,
    check_reach,
)


def load_scene(
    path: Path,
    *,
    variant: str | None = None,
    overrides: Sequence[str] = (),
    values: Mapping[str, TomlValue] | None = None,
) -> Scene:
    """Load a scene file.

    Args:
        path: A ``.toml`` file; files it refers to lie in its folder.
        variant: One of the scene's variants or several joined by ``+``, applied first.
        overrides: ``key=value`` settings with dotted keys, applied after the variant in the order
            given.
        values: Dotted key to a value as TOML parses it, applied last: a point of a study.

    Returns:
        The scene with its machine in SI units.

    Raises:
        SceneError: Anything is wrong; holds every problem with file, line, key, source line and
            what to write.
    """
    findings = Findings(str(path))
    raw = read_tables(path, findings, variant=variant, overrides=overrides, values=values)
    return build_scene(raw, findings, path=path, variant=variant)


def read_tables(
    path: Path,
    findings: Findings,
    *,
    variant: str | None = None,
    overrides: Sequence[str] = (),
    values: Mapping[str, TomlValue] | None = None,
) -> TomlTable:
    """The tables of a scene file with everything applied that changes them.

    Args:
        path: A ``.toml`` file.
        findings: Receives lines, origins and problems.
        variant: As ``load_scene`` has it.
    """
    raw = apply_variant(read_with_includes(path, findings), variant, findings)
    apply_settings(raw, overrides, findings)
    apply_values(raw, values or {}, findings)
    return raw


def build_scene(
    raw: TomlTable, findings: Findings, *, path: Path, variant: str | None = None
) -> Scene:
    """Validate, check and build the tables of a scene.

    Args:
        findings: Knows where they come from, and what was found so far.
        path: Scene file; files the scene refers to lie in its folder.

    Raises:
        SceneError: Anything is wrong.
    """
    if INCLUDE in raw:
        findings.add(
            (INCLUDE,),
            "is read with the scene's file; write it there, not in a variant, a setting or Python",
        )
    for section in [name for name, value in raw.items() if nesting_depth(value) > MAX_DEPTH]:
        findings.refuse(
            f"holds values nested more than {MAX_DEPTH} deep; a scene needs no more than ten levels",
            key=(section,),
        )
    written, raw = raw, expand_scene(raw, findings)
    table = validate_tables(raw, findings)
    if table is None:
        findings.raise_if_any()
        raise AssertionError("the schema refused a scene without saying why")
    findings.on_request = frozenset(
        name for name, request in table.analyses if request is not None and request.on_request
    )
    complete = not findings.problems
    draft = Draft(
        table=table,
        raw=raw,
        written=written,
        folder=path.parent,
        sections=collect_sections(raw),
        interfaces=collect_interfaces(raw),
        solids=build_solids(table, path.parent, findings),
        paths=read_sweep_paths(table, path.parent, findings),
        findings=findings,
    )
    for check in (*CHECKS_OF_ENTRIES, *(CHECKS_OF_ALL_ENTRIES if complete else ())):
        check(draft)
    _check_analyses(draft, complete=complete)
    findings.raise_if_any()
    scene = _build_scene(draft, path, findings, variant)
    # these need the machine in its poses
    check_carriages(scene, findings)
    requests = list_analyses(scene)
    for record in list_records():
        if record.check_scene is not None and record.request.analysis in requests:
            record.check_scene(requests[record.request.analysis], scene, findings)
    findings.raise_if_any()
    return scene


def prepare_sweep(scene: Scene, name: str, *, overrides: Sequence[str] = ()) -> Scene:
    """The scene that one of its sweeps goes through: with the sweep's variant on top of its own,
    every carriage on its rail.

    Args:
        overrides: Those with which the scene was loaded.

    Raises:
        SceneError: The variant does not fit, a carriage hangs over the end of its rail in a pose of
            the sweep, or its poses have no feed and lobes ask for it.
    """
    if variant := scene.sweeps[name].variant:
        scene = load_scene(
            scene.path,
            variant=VARIANT_JOINER.join(filter(None, [scene.variant, variant])),
            overrides=overrides,
        )
    findings = Findings(str(scene.path))
    check_sweep_carriages(scene.machine, scene.sweeps[name], findings)
    findings.raise_if_any()
    for record in list_records():
        if record.check_sweep is not None:
            record.check_sweep(scene, scene.sweeps[name])
    return scene


def _check_analyses(draft: Draft, *, complete: bool) -> None:
    """Check the tables of analyses.

    Args:
        complete: Every entry of the scene passed the schema.
    """
    for record in list_records():
        table = draft.table.analyses.get(record.table)
        if table is not None:
            record.check(table, draft)
            if complete and record.check_complete is not None:
                record.check_complete(table, draft)


def _build_scene(draft: Draft, path: Path, findings: Findings, variant: str | None) -> Scene:
    table = draft.table
    name = table.name or path.stem
    poses = build_poses(table)
    every = _build_analyses(draft)
    return Scene(
        name=name,
        path=path,
        machine=_build_machine(table, name, path.parent),
        poses=poses,
        analyses=every.drop(draft.findings.on_request),
        on_request=every.keep(draft.findings.on_request),
        effects=table.active,
        variants=tuple(table.variants),
        raw=dict(draft.raw),
        limits=Limits(table.limits.elements, table.limits.memory, table.limits.time),
        warnings=tuple(draft.findings.warnings),
        assumptions=tuple(f"{key}: {what}" for key, what in draft.findings.assumptions.items()),
        deferred={
            analysis: tuple(problems) for analysis, problems in draft.findings.deferred.items()
        },
        variant=variant,
        studies={name: build_study(name, study) for name, study in table.studies.items()},
        sweeps={name: build_sweep(name, table, draft.paths) for name in table.sweeps},
        mechanism=None
        if table.mechanism is None
        else dataclasses.replace(
            build_mechanism(table.mechanism), leg_errors=build_leg_errors(table)
        ),
        compare=CompareSettings(
            tuple(table.compare.variants or ()),
            tuple(table.compare.fidelity or ()),
            table.compare.pose,
            table.compare.reference,
        ),
        drives=build_drives(table),
        accuracy=None if table.accuracy is None else table.accuracy.fill(AccuracyGoal),
        model_errors=table.model_errors,
        interface_errors=_compares_interfaces(table),
        modal_damping=read_modal_damping(table.effects.get("damping", False)),
        findings=draft.findings,
        written=draft.written,
    )


def _compares_interfaces(table: SceneTable) -> bool:
    """Interfaces whose shapes are chosen also say what their number leaves out."""
    if "interface_errors" in table.model_fields_set:
        return table.interface_errors
    parts = table.components.values()
    return any(interface.auto for part in parts for interface in part.interfaces.values())


def _build_analyses(draft: Draft) -> Analyses:
    tables = {record: draft.table.analyses.get(record.table) for record in list_records()}
    return Analyses(
        *(record.build(table, draft) for record, table in tables.items() if table is not None)
    )


def _build_machine(scene: SceneTable, name: str, folder: Path) -> Machine:
    """Build the machine of a scene that has passed every check.

    Args:
        scene: Validated and checked tables.
        folder: Folder of the scene, for the files it refers to.

    Returns:
        The machine, set up in the orientation the scene asks for.
    """
    components = _build_components(scene, folder)
    joints = _build_joints(scene, components)
    supports = {key: build_support(key, table, components) for key, table in scene.supports.items()}
    machine = Machine(
        name=name,
        components=components,
        joints=joints,
        points={key: build_point(key, table) for key, table in scene.points.items()},
        axes={key: _build_axis(key, scene, joints, supports) for key in scene.axes},
        supports=supports,
        loads={
            key: build_load(key, table, components)
            for key, table in scene.loads.items()
            if table.joint is None
        },
        displacements={
            key: build_displacement(key, table)
            for key, table in scene.loads.items()
            if table.joint is not None
        },
        probes={
            key: Probe(key, table.component, (table.at[0], table.at[1], table.at[2]))
            for key, table in scene.probes.items()
        },
        gravity=read_gravity(scene.effects.get("gravity", True)),
        gravity_stiffening=GRAVITY_STIFFENING in scene.active,
        rayleigh=read_rayleigh_damping(scene.effects.get("damping", False)),
        mechanism=None if scene.mechanism is None else build_mechanism(scene.mechanism),
    )
    if "orientation" not in scene.model_fields_set:
        return machine
    return orient_machine(machine, build_frame(scene.orientation.at, scene.orientation.rotate))


def _build_axis(
    key: str, scene: SceneTable, joints: dict[str, Joint], supports: dict[str, Support]
) -> Axis:
    table = scene.axes[key]
    axis = build_axis(key, table, scene, joints, supports)
    if GUIDE_ERRORS not in scene.active:
        return axis
    return dataclasses.replace(axis, errors=build_axis_errors(table))


def _build_components(scene: SceneTable, folder: Path) -> dict[str, Component]:
    materials = {name: build_material(name, table) for name, table in scene.materials.items()}
    solids = {name: build_solid(table.solid, folder) for name, table in scene.components.items()}
    control_points = choose_control_points(scene, solids)
    return {
        name: build_component(
            name,
            table,
            solids[name],
            NO_MATERIAL if table.material is None else materials[table.material],
            sizes=build_sizes(table.mesh, folder),
            free=scene.free,
            control_points=control_points[name],
        )
        for name, table in scene.components.items()
    }


def _build_joints(scene: SceneTable, components: dict[str, Component]) -> dict[str, Joint]:
    """The joints of a scene, and behind each screw with two fixed bearings its shaft as a tie
    between them.
    """
    joints: dict[str, Joint] = {}
    for key, table in scene.joints.items():
        joint = build_joint(key, table)
        joints[key] = (
            dataclasses.replace(joint, errors=build_rail_errors(table))
            if GUIDE_ERRORS in scene.active
            else joint
        )
        shaft = couple_bearings(f"{key}_shaft", joints[key])
        if shaft is not None and any(
            components[end.component or ""].fidelity != "rigid" for end in shaft.ends
        ):
            joints[shaft.name] = shaft
    return joints
