"""Loads a scene file: reads, overrides, validates, checks and builds it, or says everything that is wrong."""

import dataclasses
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

from headstock.geometry.frames import DIRECTIONS
from headstock.scene.building.drives import build_control, build_drives, build_path_cut, check_drives
from headstock.scene.building.machine import build_machine, build_poses
from headstock.scene.building.mechanism import build_contouring, build_map, build_mechanism, check_mechanism
from headstock.scene.building.names import check_references
from headstock.scene.building.path import build_path, check_path, check_path_carriages
from headstock.scene.building.physics import check_physics
from headstock.scene.building.rails import check_carriages
from headstock.scene.building.studies import (
    axis_units,
    build_study,
    build_sweep,
    check_sweep_carriages,
    check_sweeps,
    read_sweep_paths,
)
from headstock.scene.reading.axis_paths import AxisPath
from headstock.scene.reading.files import read_scene
from headstock.scene.reading.findings import Findings
from headstock.scene.requests import Analyses, FrfRequest, ModalRequest, PathRequest, StaticRequest
from headstock.scene.scene import AccuracyGoal, CompareSettings, Limits, Scene
from headstock.scene.schema.effects import read_modal_damping
from headstock.scene.schema.overrides import VARIANT_JOINER, apply_settings, apply_values, apply_variant
from headstock.scene.schema.path import PathTable
from headstock.scene.schema.scene import SceneTable
from headstock.scene.schema.validation import validate_tables
from headstock.solvers.paths.response import LowPass
from headstock.solvers.paths.set_points import Ramp, SetPoint
from headstock.solvers.second_order import Port

DEFAULT_MODES = 6


def load_scene(
    path: Path, *, variant: str | None = None, overrides: Sequence[str] = (), values: Mapping[str, Any] | None = None
) -> Scene:
    """Load a scene file.

    Args:
        path: A ``.toml`` file; files it refers to lie in its folder.
        variant: One of the scene's variants or several joined by ``+``, applied first.
        overrides: ``key=value`` settings with dotted keys, applied after the variant in the order given.
        values: Dotted key to a value as TOML parses it, applied last: a point of a study.

    Returns:
        The scene with its machine in SI units.

    Raises:
        SceneError: Anything is wrong; holds every problem with file, line, key, source line and what to write.
    """
    findings = Findings(str(path))
    raw = apply_variant(read_scene(path, findings), variant, findings)
    apply_settings(raw, overrides, findings)
    apply_values(raw, values or {}, findings)
    table = validate_tables(raw, findings)
    paths: dict[str, AxisPath] = {}
    if table is not None:
        findings.on_request = frozenset(name for name, request in table.analyses if request is not None and request.on_request)
        complete = not findings.problems
        check_references(table, raw, findings)
        check_physics(table, path.parent, findings, complete=complete)
        if complete:
            check_drives(table, findings)
        check_mechanism(table, path.parent, findings, complete=complete)
        paths = read_sweep_paths(table, axis_units(table), path.parent, findings)
        check_sweeps(table, paths, findings)
        check_path(table, findings)
    findings.raise_if_any()
    if table is None:
        raise AssertionError("the schema refused a scene without saying why")
    scene = dataclasses.replace(
        _build_scene(table, raw, path, findings, variant),
        sweeps={name: build_sweep(name, table, paths) for name in table.sweeps},
    )
    check_carriages(scene.machine, scene.poses, findings)
    check_path_carriages(scene, findings)
    findings.raise_if_any()
    return scene


def prepare_sweep(scene: Scene, name: str, *, overrides: Sequence[str] = ()) -> Scene:
    """The scene that one of its sweeps goes through: with the sweep's variant on top of its own, every carriage on its rail.

    Args:
        scene: As loaded.
        name: Of the sweep.
        overrides: Those with which the scene was loaded.

    Raises:
        SceneError: The variant does not fit, or a carriage hangs over the end of its rail in a pose of the sweep.
    """
    if variant := scene.sweeps[name].variant:
        scene = load_scene(scene.path, variant=VARIANT_JOINER.join(filter(None, [scene.variant, variant])), overrides=overrides)
    findings = Findings(str(scene.path))
    check_sweep_carriages(scene.machine, scene.sweeps[name], findings)
    findings.raise_if_any()
    return scene


def _build_scene(table: SceneTable, raw: dict[str, Any], path: Path, findings: Findings, variant: str | None) -> Scene:
    name = table.name or path.stem
    poses = build_poses(table)
    analyses, on_request = _split_requests(findings.on_request, _build_analyses(table, tuple(poses), path.parent))
    return Scene(
        name=name,
        path=path,
        machine=build_machine(table, name, path.parent),
        poses=poses,
        analyses=analyses,
        on_request=on_request,
        effects=frozenset(effect for effect, value in table.effects.items() if value is not False),
        variants=tuple(table.variants),
        raw=raw,
        limits=Limits(table.limits.elements, table.limits.memory, table.limits.time),
        warnings=tuple(findings.warnings),
        deferred={analysis: tuple(problems) for analysis, problems in findings.deferred.items()},
        variant=variant,
        studies={name: build_study(name, study) for name, study in table.studies.items()},
        mechanism=None if table.mechanism is None else build_mechanism(table.mechanism),
        compare=CompareSettings(
            tuple(table.compare.variants or ()), tuple(table.compare.fidelity or ()), table.compare.pose, table.compare.reference
        ),
        drives=build_drives(table),
        accuracy=None if table.accuracy is None else AccuracyGoal(table.accuracy.to, table.accuracy.fidelity),
        modal_damping=read_modal_damping(table.effects.get("damping", False)),
    )


def _build_analyses(table: SceneTable, poses: tuple[str, ...], folder: Path) -> Analyses:
    static, modal = table.analyses.static, table.analyses.modal
    static_request = modal_request = None
    if static is not None:
        static_request = StaticRequest(tuple(static.at or table.points), tuple(static.poses or poses))
    if modal is not None:
        count = DEFAULT_MODES if modal.count is None and modal.up_to is None else modal.count
        modal_request = ModalRequest(count, modal.up_to, tuple(modal.poses or poses), modal.spread)
    contouring = build_contouring(table, folder, read_modal_damping(table.effects.get("damping", False)))
    return Analyses(
        static=static_request,
        modal=modal_request,
        frf=_build_frf(table, poses),
        map=build_map(table),
        contouring=contouring,
        path=_build_path(table),
        control=build_control(table, poses),
    )


def _split_requests(named: Collection[str], analyses: Analyses) -> tuple[Analyses, Analyses]:
    """What is always run, and what only when it is named."""
    found = {field.name: getattr(analyses, field.name) for field in dataclasses.fields(Analyses)}
    return (
        Analyses(**{name: request for name, request in found.items() if name not in named}),
        Analyses(**{name: request for name, request in found.items() if name in named}),
    )


def _build_frf(table: SceneTable, poses: tuple[str, ...]) -> FrfRequest | None:
    frf = table.analyses.frf
    if frf is None:
        return None
    inputs = _expand_ports(frf.inputs or [(name, "") for name in table.points])
    return FrfRequest(
        inputs=inputs,
        outputs=_expand_ports(frf.outputs) if frf.outputs else inputs,
        to_hz=frf.to,
        from_hz=frf.start,
        points=frf.points,
        spacing=frf.spacing,
        adaptive=frf.adaptive,
        motion=frf.motion,
        poses=tuple(frf.poses or poses),
    )


def _build_path(table: SceneTable) -> PathRequest | None:
    path = table.analyses.path
    if path is None:
        return None
    line = build_path(table, path)
    ramp = Ramp(path.ramp, path.time_constant, path.jerk_time or 0.0)
    return PathRequest(
        path=line,
        moves=tuple(SetPoint(line.length, feed, ramp) for feed in path.feeds),
        outputs=_expand_ports(path.outputs or [(name, "") for name in table.points]),
        sampling_hz=path.sampling,
        low_pass=None if path.lowpass is None else LowPass(path.lowpass, path.filter),
        ring_down=path.ring_down,
        cut=build_path_cut(table),
        follows_pose=_follows_pose(table, path),
    )


def _follows_pose(table: SceneTable, path: PathTable) -> bool:
    """A loop under control is closed in the pose of the middle, unless something else is written."""
    return not build_drives(table) if path.pose_changes is None else path.pose_changes == "followed"


def _expand_ports(ports: Sequence[tuple[str, str]]) -> tuple[Port, ...]:
    """Every port once, with its direction."""
    found = [(name, dof) for name, given in ports for dof in ([given] if given else DIRECTIONS)]
    return tuple(dict.fromkeys(found))
