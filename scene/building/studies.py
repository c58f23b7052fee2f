"""Sweeps, studies and comparisons of a scene: built from their tables, and what may be wrong with
them.
"""

import dataclasses
import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from headstock.geometry.errors import PoseError
from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.carriages import find_overhangs
from headstock.geometry.machine.machine import Machine, find_limit_fault, position_units
from headstock.meshing.process.strangers import WAYPOINTS
from headstock.scene.building.draft import Draft
from headstock.scene.expansion.overrides import AS_WRITTEN, path_exists
from headstock.scene.reading.csv_files import AxisPath, CsvError, read_waypoints
from headstock.scene.reading.files import TomlTable, resolve_file
from headstock.scene.reading.findings import Findings, KeyPath, suggest_names
from headstock.scene.reading.watch_paths import parse_watch
from headstock.scene.schema.axes import PoseTable
from headstock.scene.schema.scene import SceneTable
from headstock.scene.schema.studies import MAX_SWEEP_POSES, FamilyTable, StudyTable, SweepTable
from headstock.scene.studies import (
    REFERENCE_RUN,
    VARIANT,
    Study,
    StudyFamily,
    Sweep,
    count_path,
    make_grid,
    make_list,
    make_path,
    sweep_pose,
)

OVERHANGS_TOLD = 3
SUFFIXES = (".csv",)
UNITS = {"m": "mm", "rad": "deg"}


def build_sweep(name: str, scene: SceneTable, paths: Mapping[str, AxisPath]) -> Sweep:
    """The sweep a faultless table stands for, with the ways that were read from files.

    Args:
        paths: Way of each sweep that names a file.
    """
    return dataclasses.replace(_build_poses(name, scene, paths), variant=scene.sweeps[name].variant)


def _build_poses(name: str, scene: SceneTable, paths: Mapping[str, AxisPath]) -> Sweep:
    table, units = scene.sweeps[name], position_units(scene)
    if table.axes is not None:
        return make_grid(name, units, {axis: span.values() for axis, span in table.axes.items()})
    if table.path is not None:
        step, unit = _step(table)
        return make_path(name, units, _waypoints(name, scene, paths), step, unit)
    poses = table.poses or []
    labels = [pose for pose in poses if isinstance(pose, str)]
    places = [_values(scene.poses[pose] if isinstance(pose, str) else pose) for pose in poses]
    return make_list(name, units, places, labels if len(labels) == len(poses) else [])


def check_sweeps(draft: Draft) -> None:
    """Report sweeps with unknown poses or too many; positions are checked with poses'."""
    scene = draft.table
    for name, table in scene.sweeps.items():
        for index, position in enumerate(table.poses or ()):
            if isinstance(position, str):
                key: KeyPath = ("sweeps", name, "poses", index)
                draft.findings.check_name(key, position, scene.poses, "pose", "poses")
        draft.check_variant(("sweeps", name, "variant"), table.variant)
        if (count := _count_poses(name, scene, draft.paths)) > MAX_SWEEP_POSES:
            part = "axes" if table.axes is not None else "step"
            draft.add(
                ("sweeps", name, part),
                f"has {count} poses; a sweep takes {MAX_SWEEP_POSES} at most",
            )


def check_sweep_carriages(machine: Machine, sweep: Sweep, findings: Findings) -> None:
    """Report carriages that hang over the end of their rail in a pose of a sweep; the first pose of
    each is named.

    Args:
        machine: As the sweep goes through it.
    """
    reported: set[str] = set()
    for number in range(len(sweep.positions)):
        pose = sweep_pose(sweep, number)
        try:
            overhangs = find_overhangs(machine, pose)
        except PoseError:
            continue  # out of the mechanism's reach: blank in the maps
        for joint, fault in overhangs.items():
            if joint not in reported and len(reported) < OVERHANGS_TOLD:
                reported.add(joint)
                findings.add(("sweeps", sweep.name), f"in pose {pose.name} {fault}")


def _waypoints(
    name: str, scene: SceneTable, paths: Mapping[str, AxisPath]
) -> list[dict[str, float]]:
    """Corners of a path as the scene or its file has them; none where the file could not be
    read.
    """
    path = scene.sweeps[name].path
    if isinstance(path, str):
        return paths[name].waypoints() if name in paths else []
    return [_values(position) for position in path or ()]


def _values(position: PoseTable) -> dict[str, float]:
    return {axis: quantity.value for axis, quantity in position.items()}


def _step(table: SweepTable) -> tuple[float, str]:
    """Largest distance of poses and its unit; without one no poses between waypoints."""
    return (math.inf, "m") if table.step is None else (table.step.value, table.step.dimension.unit)


def _count_poses(name: str, scene: SceneTable, paths: Mapping[str, AxisPath]) -> int:
    table = scene.sweeps[name]
    if table.axes is not None:
        return math.prod(span.positions for span in table.axes.values())
    waypoints = _waypoints(name, scene, paths)
    step, unit = _step(table)
    if waypoints:
        return count_path(position_units(scene), waypoints, step, unit)
    return len(table.poses or ())


def read_sweep_paths(scene: SceneTable, folder: Path, findings: Findings) -> dict[str, AxisPath]:
    """The way of each sweep that names a file, where it could be read; what is wrong is reported.

    Args:
        findings: Receives problems, each with the line of the file.
    """
    paths: dict[str, AxisPath] = {}
    units = position_units(scene)
    for name, table in scene.sweeps.items():
        if not isinstance(table.path, str):
            continue
        key: KeyPath = ("sweeps", name, "path")
        try:
            paths[name] = read_waypoints(resolve_file(folder, table.path, SUFFIXES, WAYPOINTS))
        except (ValueError, CsvError) as error:
            findings.add(key, str(error))
            continue
        for column, axis in enumerate(paths[name].axes):
            if fault := _find_fault(paths[name], column, axis, scene, units):
                findings.add(key, fault)
    return paths


def _find_fault(
    path: AxisPath, column: int, axis: str, scene: SceneTable, units: dict[str, str]
) -> str:
    """Why an axis cannot follow its column; empty where it can."""
    if axis not in units:
        return (
            f"{path.name}:1: unknown axis {axis[:80]!r}; {suggest_names(axis, units, what='axes')}"
        )
    if units[axis] != path.units[column]:
        kind = "linear" if units[axis] == "m" else "rotary"
        return (
            f"{path.name}:1: axis {axis} is {kind}; write for example {axis} [{UNITS[units[axis]]}]"
        )
    limits = scene.axes[axis].limits if axis in scene.axes else None
    if limits is None:
        return ""
    low, high = (limit.value for limit in limits)
    outside = np.flatnonzero((path.positions[:, column] < low) | (path.positions[:, column] > high))
    if not len(outside):
        return ""
    first = int(outside[0])
    more = f" ({len(outside) - 1} rows more)" if len(outside) > 1 else ""
    fault = find_limit_fault(
        axis, float(path.positions[first, column]), low=low, high=high, unit=path.units[column]
    )
    return f"{path.name}:{path.lines[first]}: {fault}{more}"


def build_study(name: str, table: StudyTable) -> Study:
    """The study a faultless table stands for; what it sets itself holds in each of its families
    unless they set it too.
    """
    families = [
        _build_family(key, family.label or key.replace("_", " "), family, table)
        for key, family in table.families.items()
    ]
    if table.vary is not None:
        families = [_build_family("", name, table, table)]
    if (run := table.reference_run) is not None:
        settings = {key: value for key, value in (table.set | run).items() if key != VARIANT}
        vary = {VARIANT: (str(run[VARIANT]),)} if VARIANT in run else {}
        analyses = tuple(table.analyses or ())
        # last: what it needs of memory would hide what the others need where a process cannot
        # forget its peak
        families.append(
            StudyFamily(REFERENCE_RUN, "reference run", settings, vary, analyses=analyses)
        )
    return table.fill(Study, name=name, families=tuple(families), cold=table.store == "cold")


def _build_family(
    name: str, label: str, family: FamilyTable | StudyTable, table: StudyTable
) -> StudyFamily:
    return family.fill(
        StudyFamily,
        name=name,
        label=label,
        settings=table.set | family.set,
        vary={key: tuple(values) for key, values in (family.vary or {}).items()},
        pairwise=family.pairwise or table.pairwise,
        analyses=tuple(family.analyses or table.analyses or ()),
    )


def check_studies(draft: Draft) -> None:
    """Report studies that vary, watch or compute what the scene does not have."""
    for name, study in draft.table.studies.items():
        key: KeyPath = ("studies", name)
        _check_part(key, study, study.reference_run or {}, draft)
        for family, table in study.families.items():
            _check_part((*key, "families", family), table, {}, draft)
        for index, watch in enumerate(study.watch or ()):
            _check_watch((*key, "watch", index), watch, draft.table, draft.findings)


def check_comparison(draft: Draft) -> None:
    """Report a comparison of unknown variants, or in an unknown pose."""
    table = draft.table.compare
    for index, choice in enumerate(table.variants or ()):
        if choice != AS_WRITTEN:
            draft.check_variant(
                ("compare", "variants", index), choice, more=f"; {AS_WRITTEN!r} is the scene itself"
            )
    draft.check_pose(("compare", "pose"), table.pose)


def _check_part(
    key: KeyPath, table: StudyTable | FamilyTable, reference: TomlTable, draft: Draft
) -> None:
    """Report what a study, or one of its families, sets, varies or computes that there is not.

    Args:
        reference: Settings of the run that the others are compared with.
    """
    varied = table.vary or {}
    for section, paths in (("vary", varied), ("set", table.set), ("reference_run", reference)):
        for path in paths:
            if (path != VARIANT or section == "set") and (
                reason := path_exists(draft.written, path)
            ):
                draft.add((*key, section, path), reason)
    choices = [*varied.get(VARIANT, ()), *([reference[VARIANT]] if VARIANT in reference else ())]
    for choice in choices:
        text = str(choice or "")
        draft.check_variant((*key, "vary", VARIANT), text, '; "" is the scene as written')
    requested = draft.table.analyses.requested
    for analysis in table.analyses or ():
        if analysis not in requested:
            draft.add(
                (*key, "analyses"),
                f"the scene has no [analyses.{analysis}]; it has: {', '.join(requested) or 'none'}",
            )


def _check_watch(key: KeyPath, watch: str, scene: SceneTable, findings: Findings) -> None:
    root, *rest = parse_watch(watch).steps
    sections: dict[object, Mapping[str, object]] = {
        "static": scene.points,
        "components": scene.components,
    }
    names = sections.get(root)
    if names is not None and rest and rest[0] not in names:
        findings.add(
            key,
            f"{watch}: {suggest_names(rest[0], names, what='points' if root == 'static' else 'components')}",
        )


def build_grid(
    sweep: SweepTable,
) -> tuple[tuple[tuple[str, FloatArray], ...], dict[str, float]]:
    """Return the axes of a sweep with several positions, and the positions of the others."""
    spans = {name: span.values() for name, span in (sweep.axes or {}).items()}
    return (
        tuple((name, values) for name, values in spans.items() if len(values) > 1),
        {name: float(values[0]) for name, values in spans.items() if len(values) == 1},
    )


def check_grid(key: KeyPath, name: str, what: str, most: int, draft: Draft) -> None:
    """Report a sweep that does not exist, is no grid of two or three axes, or has too many poses.

    Args:
        key: Where the sweep is named.
        what: Analysis that needs it, with its article.
    """
    draft.check_name(key, name, "sweeps")
    if (sweep := draft.table.sweeps.get(name)) is None:
        return
    counts = [span.positions for span in (sweep.axes or {}).values()]
    if sum(count > 1 for count in counts) not in (2, 3):
        draft.add(
            key, f"{what} needs a sweep of axes in which two or three have more than one position"
        )
    elif math.prod(counts) > most:
        draft.add(key, f"has {math.prod(counts)} poses; {what} takes {most} at most")
