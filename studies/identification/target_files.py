"""Target files: what was measured and which numbers of the scene may be fitted, in SI units; or
everything that is wrong.
"""

import dataclasses
import functools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from headstock.geometry.errors import NumberNameError
from headstock.pipeline.numbers.numbers import Key, parse_key
from headstock.reduction.coupling.slopes import ObservedDof
from headstock.scene.building.draft import describe_unmeasured
from headstock.scene.building.loader import load_scene
from headstock.scene.building.sensors import load_places
from headstock.scene.expansion.overrides import split_variant
from headstock.scene.reading.csv_files import CsvError, read_pushes
from headstock.scene.reading.files import TomlValue, read_scene, resolve_file
from headstock.scene.reading.findings import Findings, KeyPath, suggest_names
from headstock.scene.reading.units import COMPLIANCE, FREQUENCY, RATIO, Quantity
from headstock.scene.scene import Scene
from headstock.scene.schema.validation import validate_against
from headstock.scene.test_data.errors import MeasurementError
from headstock.studies.identification.measured_responses import read_pairs
from headstock.studies.identification.parameters import read_parameters
from headstock.studies.identification.records import LineFit, fit_line
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


MOST_NAMED = 3  # unknown places


@dataclass(frozen=True, eq=False)
class _Source:
    """A case of a target file as it is read.

    Attributes:
        scene: Whose places its targets name.
        findings: Where problems go.
        unknown: Places that the scene has not, with the key that names each first.
    """

    name: str
    table: CaseTable
    scene: Scene
    findings: Findings
    unknown: dict[str, KeyPath] = field(default_factory=dict)

    @property
    def spread(self) -> float:
        """Relative standard deviation of targets without their own."""
        return _relative(self.table.tolerance, 1.0, DEFAULT_TOLERANCE)

    def add(self, message: str, *key: str | int) -> None:
        """Report a problem at a key below that of the case."""
        self.findings.add(("cases", self.name, *key), message)

    def check_place(self, place: str, directions: str, *key: str | int) -> None:
        """Report directions that a sensor does not measure, and keep a place that there is not."""
        machine = self.scene.machine
        component, _, interface = place.partition(".")
        sensor = machine.sensors.get(place)
        if sensor is not None and sensor.directions:
            for direction in set(directions) & set("xyz") - sensor.directions.keys():
                self.add(describe_unmeasured(sensor, direction), *key)
        elif place not in machine.points and not (
            component in machine.components
            and interface in machine.components[component].interfaces
        ):
            self.unknown.setdefault(place, key)

    def report_unknown(self) -> None:
        """Report all places that there are not, at the first."""
        if not self.unknown:
            return
        machine, names = self.scene.machine, list(self.unknown)
        observers = [
            *machine.points,
            *(name for name, sensor in machine.sensors.items() if sensor.directions),
            *(
                f"{name}.{other}"
                for name, item in machine.components.items()
                for other in item.interfaces
            ),
        ]
        shown = ", ".join(repr(name[:80]) for name in names[:MOST_NAMED])
        more = ", ..." if len(names) > MOST_NAMED else ""
        what = f"{len(names)} unknown points" if len(names) > 1 else "unknown point"
        hint = suggest_names(names[0], observers, what="points, sensors and interfaces")
        self.add(f"{what} {shown}{more}; {hint}", *self.unknown[names[0]])


def _read_case(
    name: str, table: CaseTable, scene: Scene, fit: FitTable, findings: Findings
) -> TargetCase:
    """Return the targets of a case.

    Args:
        findings: Where problems go.
    """
    source = _Source(name, table, scene, findings)
    if (pose := table.pose) is not None and pose not in scene.poses:
        hint = suggest_names(pose, scene.poses, what="poses")
        source.add(f"unknown pose {pose[:80]!r}; {hint}", "pose")
    numbers = [*_read_numbers(source)]
    modes = [*_read_modes(source), *(one for one in numbers if isinstance(one, ModeTarget))]
    modes.sort(key=lambda mode: mode.frequency_hz)
    compliances = [*_read_compliances(source)]
    compliances += [one for one in numbers if isinstance(one, ComplianceTarget)]
    floor = (table.modes_above if table.modes_above is not None else fit.modes_above) or 0.0
    for mode in [mode for mode in modes if mode.frequency_hz <= floor]:
        source.add(
            f"{mode.frequency_hz:g} Hz lies below modes_above ({floor:g} Hz), so no mode can meet it; lower that"
        )
    case = TargetCase(
        name=name,
        variant=table.variant,
        pose=pose,
        floor_hz=floor,
        modes=tuple(modes),
        compliances=tuple(compliances),
        responses=tuple(_read_responses(source)),
        limit=_read_limit(table),
        like=table.like,
        scene=table.scene or "",
    )
    source.report_unknown()
    if case.is_damped and DAMPING not in scene.effects:
        source.add(
            "damping and responses are fitted with the effect damping; name it in the scene's effects"
        )
    return case


def _read_limit(table: CaseTable) -> ModeLimit | None:
    if (limit := table.at_most) is None:
        return None
    sigma = _relative(limit.tolerance, 1.0, LIMIT_TOLERANCE)
    return ModeLimit(limit.modes, limit.below, sigma)


def _read_modes(source: _Source) -> Iterator[ModeTarget]:
    """Yield the targets of frequencies, with and without shapes."""
    case, table = source.name, source.table
    for frequency in table.frequencies or ():
        yield ModeTarget(f"{case} {frequency:g} Hz", frequency, source.spread, None, table.hold_out)
    for index, entry in enumerate(table.modes or ()):
        _check_shape(source, entry, "modes", index)
        hz, hold_out, root = entry.frequency, entry.hold_out or table.hold_out, entry.weight**0.5
        sigma = _relative(entry.tolerance, hz, source.spread) / root
        name = f"{case} {hz:g} Hz" + (f" {entry.name}" if entry.name else "")
        damping = None
        if entry.damping is not None:
            spread = _relative(entry.damping_tolerance, 1.0, DAMPING_TOLERANCE)
            damping = MeasuredDamping(entry.damping.value, spread / root)
        shape = _read_shape(entry, source.scene)
        yield ModeTarget(name, hz, sigma, shape, hold_out, label=entry.name, damping=damping)


def _read_compliances(source: _Source) -> Iterator[ComplianceTarget]:
    """Yield the targets of compliances."""
    for index, entry in enumerate(source.table.compliances or ()):
        key = ("compliances", index)
        source.check_place(entry.point, entry.motion, *key, "point")
        force_key = "point" if entry.force_at is None else "force_at"
        source.check_place(entry.force_at or entry.point, entry.force, *key, force_key)
        record, value, spread = None, entry.value, source.spread
        if entry.record is not None:
            try:
                record = _fit_record(entry.record, Path(source.findings.path).parent)
            except (ValueError, CsvError) as error:
                source.add(str(error), *key, "record")
                continue
            value, spread = record.compliance, max(record.error, LEAST_ERROR)
        if value is None:
            continue  # the schema reports it
        yield ComplianceTarget(
            name=f"{source.name} {entry.point} d{entry.motion}/F{entry.force}"
            + (f" at {entry.force_at}" if entry.force_at else ""),
            motion=ObservedDof(entry.point, "xyz".index(entry.motion)),
            force=ObservedDof(entry.force_at or entry.point, "xyz".index(entry.force)),
            value=value,
            sigma=_relative(entry.tolerance, value, spread) / entry.weight**0.5,
            either_sign=entry.either_sign,
            hold_out=entry.hold_out or source.table.hold_out,
            record=record,
        )


def _fit_record(record: str | Sequence[tuple[float, float]], folder: Path) -> LineFit:
    """Return the line through a record as written, or through that of a file of the folder.

    Raises:
        ValueError: There is no such file, or no line.
        CsvError: The file cannot be read.
    """
    if isinstance(record, str):
        return fit_line(read_pushes(resolve_file(folder, record, (".csv",))))
    return fit_line(record)


def _read_responses(source: _Source) -> Iterator[ResponseTarget]:
    """Yield the targets of frequency responses."""
    for index, entry in enumerate(source.table.responses or ()):
        key = ("responses", index)
        try:
            pairs = [*read_pairs(entry, Path(source.findings.path).parent)]
        except (ValueError, MeasurementError) as error:
            source.add(str(error), *key, "file")
            continue
        for pair in pairs:
            ends = {"point": pair.motion, "force_at": pair.force}
            for name, (place, dof) in ends.items():
                where = name if entry.file is None else "file"
                where = "point" if name == "force_at" and not entry.force_at else where
                source.check_place(place, "xyz"[dof], *key, where)
            motion, force = ("xyz"[end.dof] for end in ends.values())
            root = entry.weight**0.5
            deviations = np.array(pair.deviations) / root
            sigma = _relative(entry.tolerance, 1.0, RESPONSE_TOLERANCE) / root
            if len(deviations):
                sigma = float(np.sqrt(np.mean(deviations**2)) / np.abs(pair.values).max())
            elsewhere = pair.force.observer != pair.motion.observer
            yield dataclasses.replace(
                pair,
                name=f"{source.name} {pair.motion.observer} {motion}/F{force}"
                + (f" at {pair.force.observer}" if elsewhere else ""),
                sigma=sigma,
                deviations=tuple(deviations.tolist()),
                hold_out=entry.hold_out or source.table.hold_out,
            )


def _read_numbers(source: _Source) -> Iterator[ModeTarget | ComplianceTarget]:
    """Yield the targets of measured numbers: frequencies and compliances."""
    table, spread = source.table, source.spread
    pose = table.pose or next(iter(source.scene.poses))
    for text, measured in (table.numbers or {}).items():
        key = _read_number(source, text, measured, pose)
        if key is None:
            continue
        name, hold_out = f"{source.name} {text}", table.hold_out
        if key.kind == "frequency":
            mode = int(key["mode"])
            yield ModeTarget(name, measured.value, spread, hold_out=hold_out, number=mode)
            continue
        point, direction = str(key["point"]), str(key["direction"])
        source.check_place(point, direction, "numbers", text)
        motion, force = (ObservedDof(point, "xyz".index(direction[end])) for end in (0, -1))
        yield ComplianceTarget(name, motion, force, measured.value, spread, hold_out=hold_out)


def _read_number(source: _Source, text: str, measured: Quantity, pose: str) -> Key | None:
    """Return the key of a measured number; None for one that cannot be fitted, which is reported."""
    try:
        key = parse_key(text)
    except NumberNameError as error:
        source.add(str(error), "numbers", text)
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
    source.add(problem, "numbers", text)
    return None


def _relative(spread: Quantity | None, size: float, default: float) -> float:
    """A spread as a share of a value."""
    if spread is None:
        return default
    return spread.value if spread.dimension == RATIO else spread.value / abs(size)


def _read_shape(table: ModeTargetTable, scene: Scene) -> ShapeTarget | None:
    """Return the shape of a mode, measured or in words."""
    if table.moves is not None:
        return _read_words(table, scene)
    if table.vectors is None:
        return None
    entries = tuple((observer, dof, value) for (observer, dof), value in table.motions.items())
    return ShapeTarget(entries, table.shape_tolerance or VECTOR_TOLERANCE, described=False)


def _read_words(table: ModeTargetTable, scene: Scene) -> ShapeTarget:
    """Return a shape in words: bodies that it is silent about stand still, those to be ignored are left
    out.
    """
    moves = table.moves or ()
    named = {(body, move.dof): move.sign for move in moves for body in move.bodies}
    kinds = {dof // 3 for _, dof in named}  # translations, rotations
    bodies = [body for body in scene.machine.components if body not in (table.ignore or ())]
    dofs = [dof for dof in range(6) if dof // 3 in kinds]
    entries = tuple((body, dof, named.get((body, dof), 0.0)) for body in bodies for dof in dofs)
    tolerance = table.shape_tolerance or DESCRIBED_TOLERANCE
    return ShapeTarget(entries, tolerance, described=True, insist=table.insist)


def _check_shape(source: _Source, table: ModeTargetTable, *key: str | int) -> None:
    for observer, vector in (table.vectors or {}).items():
        given = [dof for dof, value in zip("xyz", vector, strict=True) if value is not None]
        source.check_place(observer, "".join(given), *key, "vectors", observer)
    if table.vectors is not None and not any(any(vector) for vector in table.vectors.values()):
        source.add("every vector is zero; give the motions that were measured", *key, "vectors")
    bodies: list[tuple[KeyPath, str]] = [
        (("moves", i, "bodies", j), body)
        for i, m in enumerate(table.moves or ())
        for j, body in enumerate(m.bodies)
    ]
    bodies += [(("ignore", i), body) for i, body in enumerate(table.ignore or ())]
    components = source.scene.machine.components
    for where, body in bodies:
        if body not in components:
            hint = suggest_names(body, components, what="components")
            source.add(f"unknown component {body[:80]!r}; {hint}", *key, *where)


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
    if "orientation" in written.raw:  # its parts are not placed by their own keys alone
        findings.add_line(
            None,
            f"{written.path} sets the machine up with [orientation]; take it out for the fit, it changes no frequency",
        )
    scenes = _load_scenes(table, written, overrides, rival, path, findings)
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


def _load_scenes(
    table: TargetsTable,
    written: Scene,
    overrides: Sequence[str],
    rival: str | None,
    path: Path,
    findings: Findings,
) -> dict[MachineKey, Scene]:
    """Return the scene of each machine and variant that the cases name.

    Args:
        written: The scene that is fitted.
        overrides: Settings of it.
        rival: Name of its other model; None for itself.
        path: Of the target file, beside which other scenes are.
    """
    machines: dict[str, Scene] = {"": written}
    scenes: dict[MachineKey, Scene] = {}
    sensors = _collect_sensors(table, findings)
    for name, entry in table.cases.items():
        if entry.scene is not None and entry.scene not in machines:
            try:
                file = resolve_file(path.parent, entry.scene, (".toml",))
            except ValueError as error:
                findings.add(("cases", name, "scene"), str(error))
                continue
            machines[entry.scene] = load_scene(file)
        settings, values = overrides, sensors[entry.machine]
        source = f"{path.name}: cases.{name}"
        if entry.scene:
            settings = ()
        elif rival is not None:
            # sensors are checked by now: the file is loaded without another model first
            values = values | table.rivals[rival].set
            source = f"{path.name}: rivals.{rival}.set"
        load = functools.partial(load_scene, overrides=settings, values=values, source=source)
        _load_variant(name, entry, machines, load, scenes, findings)
    return scenes


def _collect_sensors(
    table: TargetsTable, findings: Findings
) -> dict[MachineKey, dict[str, TomlValue]]:
    """Return the sensors of all cases of each machine and variant, by their keys in the scene."""
    sensors: dict[MachineKey, dict[str, TomlValue]] = {}
    for name, entry in table.cases.items():
        shared = sensors.setdefault(entry.machine, {})
        for sensor, value in entry.sensors.items():
            if shared.setdefault(f"sensors.{sensor}", value) != value:
                findings.add(
                    ("cases", name, "sensors", sensor),
                    "another case of this variant has a sensor of this name elsewhere; rename one of them",
                )
    return sensors


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
    known = {case.name: case for case in cases if case.like is None}
    for case in cases:
        if case.like is None:
            continue
        base, key = known.get(case.like), ("cases", case.name, "like")
        if base is None:
            hint = suggest_names(case.like, known, what="cases")
            findings.add(key, f"is no other case without `like`; {hint}")
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
