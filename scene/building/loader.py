"""Loads a scene file: reads, overrides, validates, checks and builds it, or says everything that is
wrong.
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from headstock.geometry.machine.joints import Joint
from headstock.geometry.machine.machine import Machine, Probe, orient_machine
from headstock.geometry.parts.components import Component
from headstock.scene.building import (
    axes,
    components,
    cutting,
    drives,
    exports,
    guide_errors,
    joints,
    loads,
    mechanism,
    plausibility,
    rails,
    sensors,
    studies,
)
from headstock.scene.building.draft import Draft, collect_interfaces, collect_sections, list_records
from headstock.scene.expansion.expansion import expand_scene
from headstock.scene.expansion.includes import INCLUDE, read_with_includes
from headstock.scene.expansion.outline_files import read_outlines
from headstock.scene.expansion.overrides import (
    VARIANT_JOINER,
    apply_settings,
    apply_values,
    apply_variant,
    split_variant,
)
from headstock.scene.reading.files import MAX_DEPTH, TomlTable, TomlValue, nesting_depth
from headstock.scene.reading.findings import Findings
from headstock.scene.reading.keys import find_keys, split_key
from headstock.scene.reading.open_values import close_values, refuse_open
from headstock.scene.scene import (
    AccuracyGoal,
    Analyses,
    CompareSettings,
    FitSpread,
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
from headstock.scene.schema.scene import FitTable, SceneTable
from headstock.scene.schema.validation import validate_tables

# These need entries that passed the schema, whatever else is wrong.
CHECKS_OF_ENTRIES: tuple[Callable[[Draft], None], ...] = (
    components.check_components,
    joints.check_joints,
    rails.check_rails,
    loads.check_points,
    loads.check_supports,
    loads.check_loads,
    loads.check_scene_probes,
    sensors.check_sensors,
    axes.check_axes,
    guide_errors.check_guide_errors,
    axes.check_poses,
    drives.check_effects,
    mechanism.check_mechanism,
    cutting.check_cutting,
    studies.check_sweeps,
    studies.check_studies,
    studies.check_comparison,
    exports.check_exports,
    plausibility.check_numbers,
    plausibility.check_unused_interfaces,
    plausibility.check_mode_counts,
)
# These need all entries: what is not there is then missing, and not just refused.
CHECKS_OF_ALL_ENTRIES: tuple[Callable[[Draft], None], ...] = (
    axes.check_floating,
    axes.check_axis_moves,
    components.check_presence,
    drives.check_drives,
    mechanism.check_reach,
)


def load_scene(
    path: Path,
    *,
    variant: str | None = None,
    overrides: Sequence[str] = (),
    values: Mapping[str, TomlValue] | None = None,
    source: str = "study",
) -> Scene:
    """Load a scene file.

    Args:
        path: A ``.toml`` file; files it refers to lie in its folder.
        variant: One of the scene's variants or several joined by ``+``, applied first.
        overrides: ``key=value`` settings with dotted keys, applied after the variant in the order
            given.
        values: Dotted key to a value as TOML parses it, applied last: a point of a study.
        source: What has these values, in messages.

    Returns:
        The scene with its machine in SI units.

    Raises:
        SceneError: Anything is wrong; holds every problem with file, line, key, source line and
            what to write.
    """
    findings = Findings(str(path))
    raw = read_tables(
        path, findings, variant=variant, overrides=overrides, values=values, source=source
    )
    scene = build_scene(raw, findings, path=path, variant=variant)
    return dataclasses.replace(scene, fit=_read_fit(scene, tuple(overrides), values or {}))


def _read_fit(
    scene: Scene, overrides: tuple[str, ...], values: Mapping[str, TomlValue]
) -> FitSpread | None:
    """Return what the fits of the scene's variants leave open; None without any."""
    known = scene.raw.get("fits")
    if not isinstance(known, dict):
        return None
    names = [name for name in split_variant(scene.variant) if name in known]
    if not names:
        return None
    tables = [FitTable.model_validate(known[name]) for name in names]
    moves = [
        {key: value for key, value in move.items() if find_keys(scene.raw, split_key(key))}
        for table in tables
        for move in table.moves
    ]
    return FitSpread(
        moves=tuple(moves),
        open=tuple(name for table in tables for name in table.open),
        scatter={kind: share for table in tables for kind, share in table.scatter.items()},
        overrides=overrides,
        values=values,
    )


def read_tables(
    path: Path,
    findings: Findings,
    *,
    variant: str | None = None,
    overrides: Sequence[str] = (),
    values: Mapping[str, TomlValue] | None = None,
    source: str = "study",
) -> TomlTable:
    """The tables of a scene file with everything applied that changes them.

    Args:
        path: A ``.toml`` file.
        findings: Receives lines, origins and problems.
        variant: As ``load_scene`` has it.
    """
    raw = apply_variant(read_with_includes(path, findings), variant, findings)
    apply_settings(raw, overrides, findings)
    apply_values(raw, values or {}, findings, source)
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
    written, questions = close_values(raw, findings)
    raw = read_outlines(expand_scene(written, findings), path.parent, findings)
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
        solids=components.build_solids(table, path.parent, findings),
        paths=studies.read_sweep_paths(table, path.parent, findings),
        sensors=sensors.build_sensors(table, path.parent, findings),
        findings=findings,
    )
    for check in (*CHECKS_OF_ENTRIES, *(CHECKS_OF_ALL_ENTRIES if complete else ())):
        check(draft)
    _check_analyses(draft, complete=complete)
    findings.raise_if_any()
    if questions and not table.accept_defaults:
        refuse_open(questions, findings)
    scene = dataclasses.replace(_build_scene(draft, path, variant), questions=questions)
    # these need the machine in its poses
    rails.check_carriages(scene, findings)
    exports.check_spaces(scene, findings)
    requests = list_analyses(scene)
    for record in list_records(requests):
        if record.check_scene is not None:
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
    studies.check_sweep_carriages(scene.machine, scene.sweeps[name], findings)
    findings.raise_if_any()
    for record in list_records(scene.analyses.names):
        if record.check_sweep is not None:
            record.check_sweep(scene, scene.sweeps[name])
    return scene


def _check_analyses(draft: Draft, *, complete: bool) -> None:
    """Check the tables of analyses.

    Args:
        complete: Every entry of the scene passed the schema.
    """
    requested = draft.table.analyses.requested
    for record in list_records(requested):
        table = requested[record.request.analysis]
        poses = getattr(table, "poses", None)
        draft.check_poses(("analyses", record.request.analysis, "poses"), poses)
        for check in (record.check, record.check_complete if complete else None):
            if check is not None:
                check(table, draft)


def _build_scene(draft: Draft, path: Path, variant: str | None) -> Scene:
    table = draft.table
    name = table.name or path.stem
    requested = table.analyses.requested
    every = Analyses(
        *(
            record.build(requested[record.request.analysis], draft)
            for record in list_records(requested)
        )
    )
    loaded = [place for request in every.requests for place in request.loaded_places]
    return Scene(
        name=name,
        path=path,
        machine=sensors.load_places(_build_machine(draft, name, path.parent), loaded),
        poses=axes.build_poses(table),
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
        studies={name: studies.build_study(name, study) for name, study in table.studies.items()},
        sweeps={name: studies.build_sweep(name, table, draft.paths) for name in table.sweeps},
        mechanism=None
        if table.mechanism is None
        else dataclasses.replace(
            mechanism.build_mechanism(table.mechanism),
            leg_errors=guide_errors.build_leg_errors(table),
        ),
        compare=table.compare.fill(CompareSettings, fidelities=tuple(table.compare.fidelity or ())),
        drives=drives.build_drives(table),
        exports=exports.build_exports(table),
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


def _build_machine(draft: Draft, name: str, folder: Path) -> Machine:
    """Build the machine of a scene that has passed every check.

    Args:
        draft: Validated and checked tables.
        folder: Folder of the scene, for the files it refers to.

    Returns:
        The machine, set up in the orientation the scene asks for.
    """
    scene = draft.table
    parts = _build_components(scene, folder)
    links = _build_joints(scene, parts)
    supports = {
        key: loads.build_support(key, table, parts) for key, table in scene.supports.items()
    }
    machine = Machine(
        name=name,
        components=parts,
        joints=links,
        points={key: loads.build_point(key, table) for key, table in scene.points.items()},
        axes={
            key: axes.build_axis(key, table, scene, links, supports)
            for key, table in scene.axes.items()
        },
        supports=supports,
        loads={
            key: loads.build_load(key, table, parts)
            for key, table in scene.loads.items()
            if table.joint is None and table.base is None
        },
        base_motions={
            key: (table.base[0], table.base[1], table.base[2])
            for key, table in scene.loads.items()
            if table.base is not None
        },
        displacements={
            key: loads.build_displacement(key, table)
            for key, table in scene.loads.items()
            if table.joint is not None
        },
        probes={
            key: Probe(key, table.component, (table.at[0], table.at[1], table.at[2]))
            for key, table in scene.probes.items()
        },
        sensors=dict(draft.sensors),
        gravity=read_gravity(scene.effects.get("gravity", True)),
        gravity_stiffening=GRAVITY_STIFFENING in scene.active,
        rayleigh=read_rayleigh_damping(scene.effects.get("damping", False)),
        mechanism=None if scene.mechanism is None else mechanism.build_mechanism(scene.mechanism),
    )
    if "orientation" not in scene.model_fields_set:
        return machine
    return orient_machine(
        machine, components.build_frame(scene.orientation.at, scene.orientation.rotate)
    )


def _build_components(scene: SceneTable, folder: Path) -> dict[str, Component]:
    materials = {
        name: components.build_material(name, table) for name, table in scene.materials.items()
    }
    solids = {
        name: components.build_solid(table.solid, folder)
        for name, table in scene.components.items()
    }
    control_points = rails.choose_control_points(scene, solids)
    return {
        name: components.build_component(
            name,
            table,
            solids[name],
            components.NO_MATERIAL if table.material is None else materials[table.material],
            sizes=components.build_sizes(table.mesh, folder),
            free=scene.free,
            control_points=control_points[name],
        )
        for name, table in scene.components.items()
    }


def _build_joints(scene: SceneTable, parts: dict[str, Component]) -> dict[str, Joint]:
    """The joints of a scene; behind each screw with two fixed bearings its shaft as a tie."""
    built: dict[str, Joint] = {}
    for key, table in scene.joints.items():
        joint = joints.build_joint(key, table)
        built[key] = (
            dataclasses.replace(joint, errors=guide_errors.build_rail_errors(table))
            if GUIDE_ERRORS in scene.active
            else joint
        )
        shaft = joints.couple_bearings(f"{key}_shaft", built[key])
        if shaft is not None and any(
            parts[end.component or ""].fidelity != "rigid" for end in shaft.ends
        ):
            built[shaft.name] = shaft
    return built
