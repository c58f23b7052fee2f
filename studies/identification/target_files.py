"""Target files: what was measured and which numbers of the scene may be fitted, in SI units; or
everything that is wrong.
"""

import dataclasses
import functools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from headstock.geometry.errors import NumberNameError
from headstock.pipeline.numbers.numbers import Key, parse_key
from headstock.reduction.coupling.slopes import ObservedDof
from headstock.scene.building.draft import describe_unmeasured
from headstock.scene.building.loader import load_scene
from headstock.scene.building.sensors import load_places
from headstock.scene.expansion.overrides import split_variant
from headstock.scene.reading.files import read_scene, resolve_file
from headstock.scene.reading.findings import Findings, KeyPath, suggest_names
from headstock.scene.reading.units import COMPLIANCE, FREQUENCY, RATIO, Quantity
from headstock.scene.scene import Scene
from headstock.scene.schema.validation import validate_against
from headstock.scene.test_data.errors import MeasurementError
from headstock.studies.identification.measured_responses import MeasuredPair, read_pairs
from headstock.studies.identification.parameters import read_parameters
from headstock.studies.identification.records import fit_line
from headstock.studies.identification.targets import (
    VECTOR_TOLERANCE,
    CaseTable,
    ComplianceTarget,
    FitTable,
    IdentificationTask,
    MachineKey,
    MeasuredDamping,
    ModeLimit,
    ModeTarget,
    ModeTargetTable,
    Parameter,
    ParameterTable,
    ResponseTarget,
    ResponseTargetTable,
    RivalTable,
    ShapeTarget,
    TargetCase,
    TargetsTable,
)

DEFAULT_TOLERANCE = 0.01
DESCRIBED_TOLERANCE = 0.3
LIMIT_TOLERANCE = 0.01
LEAST_ERROR = 1e-3  # of the line through a record: no gauge is better
DAMPING_TOLERANCE = 0.1
RESPONSE_TOLERANCE = 0.1
DAMPING = "damping"


def _read_case(
    name: str, table: CaseTable, scene: Scene, fit: FitTable, findings: Findings
) -> TargetCase:
    """Return the targets of a case.

    Args:
        findings: Where problems go.
    """
    key: KeyPath = ("cases", name)
    pose = table.pose
    if pose is not None and pose not in scene.poses:
        findings.add(
            (*key, "pose"),
            f"unknown pose {pose[:80]!r}; {suggest_names(pose, scene.poses, what='poses')}",
        )
    spread = _relative(table.tolerance, 1.0) or DEFAULT_TOLERANCE
    targets = [
        *_read_modes(name, table, spread, scene, findings),
        *_read_compliances(name, table, spread, scene, findings),
        *_read_numbers(name, table, spread, pose, scene, findings),
    ]
    responses = tuple(_read_responses(name, table, scene, findings))
    modes = [target for target in targets if isinstance(target, ModeTarget)]
    compliances = [target for target in targets if isinstance(target, ComplianceTarget)]
    modes.sort(key=lambda mode: mode.frequency_hz)
    floor = (table.modes_above if table.modes_above is not None else fit.modes_above) or 0.0
    for mode in modes:
        if mode.frequency_hz <= floor:
            findings.add(
                key,
                f"{mode.frequency_hz:g} Hz lies below modes_above ({floor:g} Hz), so no mode can meet it; lower that",
            )
    shaped = tuple(_fill_shape(mode, scene) for mode in modes)
    limit = None
    if (at_most := table.at_most) is not None:
        sigma = _relative(at_most.tolerance, 1.0) or LIMIT_TOLERANCE
        limit = ModeLimit(at_most.modes, at_most.below, sigma)
    damped = bool(responses) or any(mode.damping is not None for mode in modes)
    if damped and DAMPING not in scene.effects:
        findings.add(
            key,
            "damping and responses are fitted with the effect damping; name it in the scene's effects",
        )
    return TargetCase(
        name=name,
        variant=table.variant,
        pose=pose,
        floor_hz=floor,
        modes=shaped,
        compliances=tuple(compliances),
        responses=responses,
        limit=limit,
        like=table.like,
        scene=table.scene or "",
    )


def _read_modes(
    case: str, table: CaseTable, spread: float, scene: Scene, findings: Findings
) -> Iterator[ModeTarget]:
    """Yield the targets of frequencies, with and without shapes."""
    for frequency in table.frequencies or ():
        yield ModeTarget(f"{case} {frequency:g} Hz", frequency, spread, None, table.hold_out)
    for index, entry in enumerate(table.modes or ()):
        _check_shape(("cases", case, "modes", index), entry, scene, findings)
        hz, hold_out = entry.frequency, entry.hold_out or table.hold_out
        sigma = (_relative(entry.tolerance, hz) or spread) / entry.weight**0.5
        name = f"{case} {hz:g} Hz" + (f" {entry.name}" if entry.name else "")
        damping = None
        if entry.damping is not None:
            spread_of_damping = _relative(entry.damping_tolerance, 1.0) or DAMPING_TOLERANCE
            damping = MeasuredDamping(entry.damping.value, spread_of_damping / entry.weight**0.5)
        shape = _read_shape(entry)
        yield ModeTarget(name, hz, sigma, shape, hold_out, label=entry.name, damping=damping)


def _read_compliances(
    case: str, table: CaseTable, spread: float, scene: Scene, findings: Findings
) -> Iterator[ComplianceTarget]:
    """Yield the targets of compliances."""
    for index, entry in enumerate(table.compliances or ()):
        key: KeyPath = ("cases", case, "compliances", index)
        _check_place((*key, "point"), entry.point, scene, findings, entry.motion)
        force = (*key, "point" if entry.force_at is None else "force_at")
        _check_place(force, entry.force_at or entry.point, scene, findings, entry.force)
        record, value = None, entry.value
        if entry.record is not None:
            try:
                record = fit_line(entry.record)
            except ValueError as error:
                findings.add((*key, "record"), str(error))
                continue
            value = record.compliance
        if value is None:
            continue  # the schema reports it
        own_spread = spread if record is None else max(record.error, LEAST_ERROR)
        yield ComplianceTarget(
            name=f"{case} {entry.point} d{entry.motion}/F{entry.force}"
            + (f" at {entry.force_at}" if entry.force_at else ""),
            motion=ObservedDof(entry.point, "xyz".index(entry.motion)),
            force=ObservedDof(entry.force_at or entry.point, "xyz".index(entry.force)),
            value=value,
            sigma=(_relative(entry.tolerance, value) or own_spread) / entry.weight**0.5,
            either_sign=entry.either_sign,
            hold_out=entry.hold_out or table.hold_out,
            record=record,
        )


def _read_responses(
    case: str, table: CaseTable, scene: Scene, findings: Findings
) -> Iterator[ResponseTarget]:
    """Yield the targets of frequency responses."""
    for index, entry in enumerate(table.responses or ()):
        key: KeyPath = ("cases", case, "responses", index)
        try:
            pairs = _list_pairs(entry, Path(findings.path).parent)
        except (ValueError, MeasurementError) as error:
            findings.add((*key, "file"), str(error))
            continue
        for pair in pairs:
            ends = {"point": pair.motion, "force_at": pair.force}
            for name, (place, dof) in ends.items():
                where = name if entry.file is None else "file"
                known = (*key, "point" if name == "force_at" and not entry.force_at else where)
                _check_place(known, place, scene, findings, "xyz"[dof])
            motion, force = ("xyz"[end.dof] for end in ends.values())
            root = entry.weight**0.5
            deviations = np.array(pair.deviations) / root
            sigma = (_relative(entry.tolerance, 1.0) or RESPONSE_TOLERANCE) / root
            if len(deviations):
                sigma = float(np.sqrt(np.mean(deviations**2)) / np.abs(pair.values).max())
            elsewhere = pair.force.observer != pair.motion.observer
            yield ResponseTarget(
                name=f"{case} {pair.motion.observer} {motion}/F{force}"
                + (f" at {pair.force.observer}" if elsewhere else ""),
                motion=pair.motion,
                force=pair.force,
                frequencies_hz=pair.frequencies_hz,
                values=pair.values,
                sigma=sigma,
                deviations=tuple(deviations.tolist()),
                hold_out=entry.hold_out or table.hold_out,
            )


def _list_pairs(entry: ResponseTargetTable, folder: Path) -> list[MeasuredPair]:
    """Return what an entry gives itself, or the pairs of its file."""
    if entry.file is not None:
        low, high = entry.band or (0.0, math.inf)
        return read_pairs(
            folder,
            entry.file,
            sensors=entry.sensors,
            band=(low, high),
            count=entry.count,
            noise=entry.noise,
        )
    if entry.point is None or entry.motion is None or entry.force is None:
        return []  # the schema reports it
    return [
        MeasuredPair(
            ObservedDof(entry.point, "xyz".index(entry.motion)),
            ObservedDof(entry.force_at or entry.point, "xyz".index(entry.force)),
            tuple(line[0] for line in entry.lines),
            tuple(complex(line[1], line[2]) for line in entry.lines),
        )
    ]


def _read_numbers(
    case: str,
    table: CaseTable,
    spread: float,
    pose: str | None,
    scene: Scene,
    findings: Findings,
) -> Iterator[ModeTarget | ComplianceTarget]:
    """Yield the targets of measured numbers: frequencies and compliances."""
    for text, measured in (table.numbers or {}).items():
        path: KeyPath = ("cases", case, "numbers", text)
        key = _read_number(text, measured, pose or next(iter(scene.poses)), path, findings)
        if key is None:
            continue
        name, hold_out = f"{case} {text}", table.hold_out
        if key.kind == "frequency":
            mode = int(key["mode"])
            yield ModeTarget(name, measured.value, spread, hold_out=hold_out, number=mode)
            continue
        point, direction = str(key["point"]), str(key["direction"])
        _check_place(path, point, scene, findings, direction)
        motion, force = (ObservedDof(point, "xyz".index(direction[end])) for end in (0, -1))
        yield ComplianceTarget(name, motion, force, measured.value, spread, hold_out=hold_out)


def _read_number(
    text: str, measured: Quantity, pose: str, path: KeyPath, findings: Findings
) -> Key | None:
    """Return the key of a measured number; None for one that cannot be fitted, which is reported.

    Args:
        findings: Where problems go.
    """
    try:
        key = parse_key(text)
    except NumberNameError as error:
        findings.add(path, str(error))
        return None
    needed = {"frequency": ("mode",), "compliance": ("point", "direction")}.get(key.kind)
    unit = FREQUENCY if key.kind == "frequency" else COMPLIANCE
    if needed is None:
        problem = f"{key.kind} cannot be fitted; write a frequency or a compliance"
    elif missing := [role for role in needed if key.get(role) is None]:
        problem = (
            f"names no {missing[0]}; write {key.kind}({','.join(f'{role}=...' for role in needed)})"
        )
    elif key.get("pose") not in (None, pose):
        problem = f"is in pose {key['pose']}, and the case in {pose}; write pose in the case, and a case per pose"
    elif measured.dimension != unit:
        problem = f"is a {measured.dimension.name}, not a {unit.name}"
    elif key.kind == "compliance" and not set(str(key["direction"])) <= set("xyz"):
        problem = f"has no direction {key['direction']}; write x, y, z or two of them: of motion and force"
    elif not measured.value:
        problem = "is zero; leave an entry that should vanish out, or give what was measured"
    else:
        return key
    findings.add(path, problem)
    return None


def _relative(spread: Quantity | None, size: float) -> float | None:
    """A spread as a share of a value."""
    if spread is None:
        return None
    return spread.value if spread.dimension == RATIO else spread.value / abs(size)


def _read_shape(table: ModeTargetTable) -> ShapeTarget | None:
    """Return the shape as written; bodies a description is silent about are filled in by
    ``_fill_shape``.
    """
    if table.vectors is not None:
        motions = [
            (observer, dof, value)
            for observer, vector in table.vectors.items()
            for dof, value in enumerate(vector)
            if value is not None
        ]
        return ShapeTarget(
            tuple(motions), table.shape_tolerance or VECTOR_TOLERANCE, described=False
        )
    if table.moves is None:
        return None
    entries_moved: list[tuple[str, int, complex]] = []
    for move in table.moves:
        letter = move.rotation or move.translation or ""
        dof = "xyz".index(letter[-1]) + (3 if move.rotation else 0)
        entries_moved += [
            (body, dof, -1.0 if letter.startswith("-") else 1.0) for body in move.bodies
        ]
    ignored = [(body, -1, 0.0) for body in table.ignore or ()]
    return ShapeTarget(
        (*entries_moved, *ignored),
        table.shape_tolerance or DESCRIBED_TOLERANCE,
        described=True,
        insist=table.insist,
    )


def _fill_shape(mode: ModeTarget, scene: Scene) -> ModeTarget:
    """Return a mode whose described shape has every body: one that is not named stands still, one to
    be ignored is left out.
    """
    if mode.shape is None or not mode.shape.described:
        return mode
    named = {(body, dof): value for body, dof, value in mode.shape.entries if dof >= 0}
    ignored = {body for body, dof, _ in mode.shape.entries if dof < 0}
    kinds = (range(3), range(3, 6))
    dofs = [dof for kind in kinds if any(d in kind for _, d in named) for dof in kind]
    entries = tuple(
        (body, dof, named.get((body, dof), 0.0))
        for body in scene.machine.components
        if body not in ignored
        for dof in dofs
    )
    return dataclasses.replace(mode, shape=dataclasses.replace(mode.shape, entries=entries))


def _check_shape(key: KeyPath, table: ModeTargetTable, scene: Scene, findings: Findings) -> None:
    for observer, vector in (table.vectors or {}).items():
        given = [dof for dof, value in zip("xyz", vector, strict=True) if value is not None]
        _check_place((*key, "vectors", observer), observer, scene, findings, "".join(given))
    if table.vectors is not None and not any(any(vector) for vector in table.vectors.values()):
        findings.add((*key, "vectors"), "every vector is zero; give the motions that were measured")
    bodies = [
        ((*key, "moves", i, "bodies", j), body)
        for i, m in enumerate(table.moves or ())
        for j, body in enumerate(m.bodies)
    ]
    bodies += [((*key, "ignore", i), body) for i, body in enumerate(table.ignore or ())]
    components = scene.machine.components
    for where, body in bodies:
        if body not in components:
            findings.add(
                where,
                f"unknown component {body[:80]!r}; {suggest_names(body, components, what='components')}",
            )


def _check_place(
    key: KeyPath, place: str, scene: Scene, findings: Findings, directions: str
) -> None:
    """Report a place that there is not, and a direction that a sensor there does not measure."""
    machine = scene.machine
    component, _, interface = place.partition(".")
    if place in machine.points or (
        component in machine.components and interface in machine.components[component].interfaces
    ):
        return
    sensor = machine.sensors.get(place)
    if sensor is not None and sensor.directions:
        for direction in set(directions) & set("xyz") - sensor.directions.keys():
            findings.add(key, describe_unmeasured(sensor, direction))
        return
    observers = [
        *machine.points,
        *(name for name, sensor in machine.sensors.items() if sensor.directions),
        *(
            f"{name}.{other}"
            for name, item in machine.components.items()
            for other in item.interfaces
        ),
    ]
    findings.add(
        key,
        f"unknown point {place[:80]!r}; {suggest_names(place, observers, what='points, sensors and interfaces')}",
    )


@dataclass(frozen=True, eq=False)
class LoadedTask:
    """A checked target file.

    Attributes:
        scenes: Every machine that the file names.
        findings: Lines of the file, for what only the built scene can tell.
    """

    task: IdentificationTask
    scenes: Mapping[MachineKey, Scene]
    findings: Findings


def load_targets(
    path: Path,
    scene: Path,
    *,
    overrides: Sequence[str] = (),
    starts: int | None = None,
    rival: str | None = None,
) -> LoadedTask:
    """Load a target file for a scene.

    Args:
        path: Target file (``.toml``).
        overrides: ``key=value`` settings of the scene.
        starts: How many starting points the fit has; None for what the file says.
        rival: One of the file's other models; None for the scene with the file's own parameters.

    Raises:
        SceneError: Anything is wrong with either file; holds every problem with file, line, key and
            what to write.
    """
    findings = Findings(str(path))
    table = validate_against(TargetsTable, read_scene(path, findings, "target"), findings)
    if table is None:
        findings.raise_if_any()
        raise AssertionError("the schema refused a target file without saying why")
    other = table.rivals[rival] if rival is not None else None
    if other is not None:
        table = table.model_copy(update={"parameters": _change_parameters(table, other, findings)})
    written = load_scene(scene, overrides=overrides)
    load = functools.partial(
        load_scene, overrides=overrides, values={} if other is None else other.set
    )
    if "orientation" in written.raw:  # its parts are not placed by their own keys alone
        findings.add_line(
            None,
            f"{written.path} sets the machine up with [orientation]; take it out for the fit, it changes no frequency",
        )
    machines = {"": written}
    scenes: dict[MachineKey, Scene] = {}
    for name, entry in table.cases.items():
        if entry.scene is not None and entry.scene not in machines:
            try:
                file = resolve_file(path.parent, entry.scene, (".toml",))
            except ValueError as error:
                findings.add(("cases", name, "scene"), str(error))
                continue
            machines[entry.scene] = load_scene(file)
        _load_variant(name, entry, machines, load_scene if entry.scene else load, scenes, findings)
    cases = [
        _read_case(name, entry, scenes[entry.machine], table.fit, findings)
        for name, entry in table.cases.items()
        if entry.machine in scenes
    ]
    _check_likes(cases, findings)
    parameters = read_parameters(table, [*scenes.values()] or [written], findings)
    _check_amount(cases, parameters, findings)
    findings.raise_if_any()
    forces = {force.observer for case in cases for _, force in case.ends}
    loaded = {
        key: dataclasses.replace(one, machine=load_places(one.machine, forces))
        for key, one in scenes.items()
    }
    settings = table.fit if starts is None else table.fit.model_copy(update={"starts": starts})
    return LoadedTask(
        IdentificationTask(
            table.name or path.stem, tuple(cases), parameters, settings, tuple(table.rivals)
        ),
        loaded,
        findings,
    )


def _change_parameters(
    table: TargetsTable, rival: RivalTable, findings: Findings
) -> dict[str, ParameterTable]:
    """Return the parameters of another model."""
    for name in rival.without or ():
        if name not in table.parameters:
            known = suggest_names(name, table.parameters, what="parameters")
            findings.add(("rivals",), f"`without` names no parameter {name[:80]!r}; {known}")
    kept = {
        name: entry for name, entry in table.parameters.items() if name not in (rival.without or ())
    }
    return kept | rival.parameters


def _load_variant(
    name: str,
    entry: CaseTable,
    machines: Mapping[str, Scene],
    load: Callable[..., Scene],
    scenes: dict[MachineKey, Scene],
    findings: Findings,
) -> None:
    if entry.machine in scenes:
        return
    written = machines[entry.scene or ""]
    unknown = [part for part in split_variant(entry.variant) if part not in written.variants]
    for part in unknown:
        text = f"unknown variant {part[:80]!r}; {suggest_names(part, written.variants, what='variants')}"
        findings.add(("cases", name, "variant"), text)
    if not unknown:
        scene = load(written.path, variant=entry.variant)
        if scene.is_lumped:
            key = ("cases", name) if entry.variant is None else ("cases", name, "variant")
            findings.add(
                key,
                'is a lumped mechanism, which has no joints to fit; name a variant with model = "components"',
            )
        scenes[entry.machine] = scene


def _check_likes(cases: Sequence[TargetCase], findings: Findings) -> None:
    """Refuse modified cases whose modes are not those of an unmodified one."""
    known = {case.name: case for case in cases}
    for case in cases:
        if case.like is None:
            continue
        base, key = known.get(case.like), ("cases", case.name, "like")
        if base is None or base is case or base.like is not None:
            others = [
                name for name, other in known.items() if other.like is None and other is not case
            ]
            text = (
                f"is no other case without `like`; {suggest_names(case.like, others, what='cases')}"
            )
            findings.add(key, text)
            continue
        labels = [target.label for target in base.modes if target.label]
        unknown = [target for target in case.modes if target.label not in labels]
        if unknown:
            findings.add(
                key,
                f"{unknown[0].name} has no partner in {base.name}: write the same name = in a mode of both; named there: "
                f"{', '.join(labels) or 'none'}",
            )


def _check_amount(
    cases: Sequence[TargetCase], parameters: Sequence[Parameter], findings: Findings
) -> None:
    """Refuse more free parameters than there is data."""
    if findings.problems:
        return
    data = sum(case.data for case in cases)
    free = [parameter for parameter in parameters if parameter.prior is None]
    if data == 0:
        findings.add(
            ("cases",), "every target is held out, so there is nothing to fit to; keep some"
        )
    elif data < len(free):
        findings.add(
            ("parameters",),
            f"{data} measured value(s) cannot fix {len(free)} parameters without a prior; add targets, fix some parameters, or give them "
            "prior and prior_sigma",
        )
