"""Motion under loads that change with time."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from headstock.geometry.frames import FloatArray
from headstock.meshing.process.strangers import RECORD
from headstock.scene.building.draft import (
    Draft,
    SceneAnalysis,
)
from headstock.scene.building.drives import FRICTION, check_motors, check_sampling
from headstock.scene.reading.csv_files import (
    CsvError,
    ForceRecord,
    read_history,
    resample_forces,
    resampling_loss,
)
from headstock.scene.reading.files import resolve_file
from headstock.scene.reading.findings import Findings, KeyPath
from headstock.scene.reading.units import ANGULAR_IMPULSE, FORCE, IMPULSE, MOMENT
from headstock.scene.scene import Motors, Request
from headstock.scene.schema import types
from headstock.solvers.second_order import Channel
from headstock.solvers.state_spaces.load_history import (
    LoadHistory,
    half_sine_load,
    impulse_load,
    ramp_load,
    recorded_load,
    released_load,
    sine_load,
    step_load,
)

KEY: KeyPath = ("analyses", "transient")
RECORD_SUFFIXES = (".csv",)
RECORD_COLUMNS = ("value",)
ON_GRID = 1e-6  # of a time step
MUCH_LOST = 0.01  # of the rms of a record
GRAVITY = "gravity"
Channels = Annotated[list[types.ChannelName], Field(min_length=1, max_length=100)]
SAMPLES_PER_PERIOD = 20
MOST_SAMPLES = 500_000
# shape: keys it needs, and keys it may have
SHAPE_KEYS: dict[str, tuple[frozenset[str], frozenset[str]]] = {
    "step": (frozenset(), frozenset({"time"})),
    "ramp": (frozenset({"time"}), frozenset()),
    "half_sine": (frozenset({"time"}), frozenset()),
    "sine": (frozenset({"frequency"}), frozenset({"cycles"})),
    "impulse": (frozenset(), frozenset()),
    "release": (frozenset(), frozenset()),
    "file": (frozenset({"file"}), frozenset()),
}
EXAMPLES = {"time": '"5 ms"', "frequency": '"80 Hz"', "file": '"hammer.csv"', "cycles": "5"}


@dataclass(frozen=True, eq=False)
class TimedLoad:
    """A load over time.

    Attributes:
        target: Where it acts, as point or interface with a direction; or the name of a static load.
        history: Force, moment or factor of the static load over time.
    """

    name: str
    target: Channel | str
    shape: str
    history: LoadHistory


@dataclass(frozen=True, eq=False)
class TransientRequest(Request):
    """Motion under loads that change with time, in named poses.

    Attributes:
        velocities: Component to its velocity before the time zero, machine axes [m/s].
        outputs: Where motion is wanted.
        duration: From the time zero [s].
        up_to_hz: Modes up to here vibrate; those above follow at once.
        settled: Share of its way within which an output has settled.
        poses: All of them when empty.
        motors: Locked, or under control.
        probes: Where displacement and stress are wanted.
    """

    analysis: ClassVar[str] = "transient"

    loads: tuple[TimedLoad, ...]
    velocities: dict[str, tuple[float, float, float]]
    outputs: tuple[Channel, ...]
    duration: float
    sampling_hz: float
    up_to_hz: float
    settled: float
    poses: tuple[str, ...] = ()
    motors: Motors = "locked"
    probes: tuple[str, ...] = ()

    @property
    def loaded_places(self) -> tuple[str, ...]:
        """Return names of the points, sensors and interfaces on which loads act."""
        return tuple(load.target[0] for load in self.loads if not isinstance(load.target, str))

    def describe(self) -> str:
        """In a few words: what is computed, and how far."""
        causes = [f"{load.shape.replace('_', ' ')} {load.name}" for load in self.loads]
        if self.velocities:
            causes.append(f"initial velocity of {', '.join(self.velocities)}")
        under = ", drives under control" if self.motors == "controlled" else ""
        inside = f", displacement and stress at {', '.join(self.probes)}" if self.probes else ""
        return f"{', '.join(causes)}: {self.duration:g} s with modes up to {self.up_to_hz:g} Hz{under}{inside}"


class _TimedLoadTable(types.StrictTable):
    """A force, a moment or a load of `[loads]` that changes with time."""

    model_config = types.not_both("at", "load")

    shape: Literal["step", "ramp", "half_sine", "sine", "impulse", "release", "file"]
    """`step` (with `time`: a pulse), `ramp` to its size in `time`, `half_sine` of the length `time`, `sine` of `frequency`, or for some
    `cycles`, `impulse`, `release` (has acted for long and is gone), `file`"""
    at: types.ChannelName | None = None
    """point or interface and direction: `["tcp", "x"]`"""
    size: types.TimedLoadSize | None = None
    """force, moment, or impulse; values of a `file` are multiplied by it; default: `1 N` of a `file`, else required with `at`"""
    load: types.Text | None = None
    """a load of `[loads]`, or `gravity`, in place of `at`"""
    factor: types.Number | None = None
    """factor of that load; default: 1"""
    start: types.NotNegativeTime = 0.0
    """when it begins to act, is released, or strikes"""
    time: types.PositiveTime | None = None
    """how long it rises or acts; required by `ramp` and `half_sine`; default: a `step` acts on"""
    frequency: types.PositiveFrequency | None = None
    """frequency of a `sine`, which needs it"""
    cycles: types.PositiveNumber | None = None
    """how many cycles a `sine` has; default: it goes on"""
    file: types.Text | None = None
    """CSV file with the columns `time` [s] and `value`, linear between its samples and zero outside"""

    def _faults(self) -> Iterator[str]:
        if (self.at is None) == (self.load is None):
            yield 'needs either at = ["tcp", "x"] or the name of a load of [loads]'
        if self.at is not None:
            if not self.at[1]:
                yield f'a load acts in one direction; write at = ["{self.at[0]}", "x"] and its size'
            if self.factor is not None:
                yield "`factor` goes with `load`; write the size of this one as `size`"
            if self.size is None and self.shape != "file":
                yield 'has no size; write for example size = "100 N"'
        elif self.size is not None:
            yield "a load of [loads] has its size there; write a `factor` of it"
        elif self.shape == "impulse":
            yield 'an impulse acts in a direction of a point; write at = ["tcp", "x"] and size = "2 N s"'
        needed, allowed = SHAPE_KEYS[self.shape]
        for key, example in EXAMPLES.items():
            given = getattr(self, key) is not None
            if key in needed and not given:
                yield f"shape {self.shape} needs {key}; write for example {key} = {example}"
            if given and key not in needed | allowed:
                yield f"shape {self.shape} has no {key}; remove it"


class _TransientTable(types.RequestTable):
    """Motion of points under loads that change with time."""

    loads_probes = "by itself"

    loads: Annotated[dict[types.Name, _TimedLoadTable], Field(max_length=100)] = {}
    """forces, moments and loads of `[loads]` over time, by name"""
    velocity: Annotated[
        dict[types.Text, Annotated[list[types.Speed], Field(min_length=3, max_length=3)]],
        Field(max_length=1000),
    ] = {}
    """velocity of components before the time zero, machine axes: `{ table = ["100 mm/s", "0 m/s", "0 m/s"] }`; joints turn it into the
    motion with the same momentum"""
    duration: types.PositiveTime
    """how long the motion is computed, from the time zero"""
    up_to: types.PositiveFrequency = 1000.0
    """modes up to this frequency vibrate; those above follow the loads quasi-statically"""
    sampling: types.PositiveFrequency | None = None
    """samples per second, more than twice `up_to`; default: 20 times `up_to`"""
    settled: types.NotNegativeShare = 0.02
    """share of the way to the rest position (of the peak, where there is no way) within which an output has settled"""
    outputs: Channels | None = None
    """where the motion is computed: `[["tcp", "z"], "fillet"]`, with a probe; default: all points in x, y, z and all probes"""
    motors: Motors = "locked"
    """as in `[analyses.frf]`; with the effect `friction` guides have friction"""
    poses: types.Names | None = None
    """poses in which it is computed; default: all of them"""

    @property
    def effects(self) -> frozenset[str]:
        """Guides rub where motors are under control."""
        return frozenset({FRICTION} if self.motors == "controlled" else ())

    @property
    def samples_per_second(self) -> float:
        """As written, or enough for the highest mode kept [Hz]."""
        return self.sampling or SAMPLES_PER_PERIOD * self.up_to

    def _faults(self) -> Iterator[str]:
        if not self.loads and not self.velocity:
            yield 'nothing moves the machine; write loads.hit = { at = ["tcp", "x"], shape = "impulse", size = "1 N s" }'
        if self.sampling is not None and self.sampling < 2.0 * self.up_to:
            yield (
                f"sampling is {self.sampling:g} Hz, and modes up to {self.up_to:g} Hz need more than"
                f' {2.0 * self.up_to:g}; write sampling = "{SAMPLES_PER_PERIOD * self.up_to:g} Hz", or a lower up_to'
            )
        samples = self.duration * self.samples_per_second
        if not 1.0 <= samples <= MOST_SAMPLES:
            yield (
                f"{self.duration:g} s at {self.samples_per_second:g} Hz are {samples:.3g} samples, and from 1 to"
                f" {MOST_SAMPLES} are possible; change duration, sampling or up_to"
            )


def _build(table: _TransientTable, draft: Draft) -> TransientRequest:
    """Build the request: in all poses unless the table names some.

    Raises:
        ValueError: A record is missing or out of bounds.
        CsvError: A record cannot be used.
    """
    scene = draft.table
    outputs, probes = draft.split_outputs(table.outputs)
    return table.fill(
        TransientRequest,
        loads=tuple(
            TimedLoad(
                name,
                load.at if load.at is not None else load.load or "",
                load.shape,
                _build_history(load, table, draft.folder),
            )
            for name, load in table.loads.items()
        ),
        velocities={
            name: (speeds[0], speeds[1], speeds[2]) for name, speeds in table.velocity.items()
        },
        outputs=outputs or draft.build_channels([(name, "") for name in scene.points]),
        sampling_hz=table.samples_per_second,
        up_to_hz=table.up_to,
        poses=tuple(table.poses or draft.poses),
        probes=probes,
    )


def _check(table: _TransientTable, draft: Draft) -> None:
    """Report names that do not exist, sizes of another kind than their direction, and records that
    cannot be used.
    """
    for name, load in table.loads.items():
        _check_load((*KEY, "loads", name), load, draft)
        if load.file is not None:
            _check_record((*KEY, "loads", name, "file"), load, table, draft.folder, draft.findings)
    for name in table.velocity:
        draft.check_name((*KEY, "velocity", name), name, "components")
    for index, (name, direction) in enumerate(table.outputs or ()):
        draft.check_output((*KEY, "outputs", index), name, direction)
    outputs = [one for one, _ in table.outputs or () if one not in draft.table.probes]
    if not outputs and not draft.table.points:
        draft.add(
            KEY,
            'there is no point whose motion is wanted; write [points], or outputs = [["tcp", "z"]]',
        )


def _check_motors(table: _TransientTable, draft: Draft) -> None:
    """Report drives that are not controlled, or sample too slowly."""
    if table.motors == "controlled":
        check_motors(draft, "transient")
        check_sampling(draft, table.up_to, "transient", "up_to")


def _check_load(key: KeyPath, load: _TimedLoadTable, draft: Draft) -> None:
    if load.at is None:
        if load.load == GRAVITY:
            if GRAVITY not in draft.table.active:
                draft.add((*key, "load"), "needs gravity; write [effects] gravity = true")
            return
        draft.check_name((*key, "load"), load.load or "", "loads")
        return
    name, direction = load.at
    draft.check_channel((*key, "at"), name, direction)
    if load.size is None:
        return
    turns, strikes = direction.startswith("r"), load.shape == "impulse"
    wanted = (ANGULAR_IMPULSE if turns else IMPULSE) if strikes else MOMENT if turns else FORCE
    if load.size.dimension != wanted:
        draft.add(
            (*key, "size"),
            f"is a {load.size.dimension.name}, and shape {load.shape} in {direction} takes a {wanted.name}; write for"
            f' example "{wanted.example}"',
        )


def _check_record(
    key: KeyPath, load: _TimedLoadTable, table: _TransientTable, folder: Path, findings: Findings
) -> None:
    try:
        record = _read_record(load, folder)
        grid, exact = _sample_record(record, load, table)
        lost = 0.0 if exact else resampling_loss(record, grid)
    except (ValueError, CsvError) as error:
        findings.add(key, str(error))
        return
    if lost > MUCH_LOST:
        findings.warn(
            key,
            f"{100.0 * lost:.2g} % of its rms are faster than the samples of the analysis at"
            f" {table.samples_per_second:g} Hz and are left out; each sample has the mean around it",
        )


def _build_history(load: _TimedLoadTable, table: _TransientTable, folder: Path) -> LoadHistory:
    size = load.size.value if load.size is not None else 1.0
    if load.at is None:
        size = 1.0 if load.factor is None else load.factor
    time = load.time or np.inf
    match load.shape:
        case "step":
            return step_load(size, load.start, load.start + time)
        case "ramp":
            return ramp_load(size, load.start, time)
        case "half_sine":
            return half_sine_load(size, load.start, time)
        case "sine":
            return sine_load(size, load.start, load.frequency or 1.0, load.cycles or np.inf)
        case "impulse":
            return impulse_load(size, load.start)
        case "release":
            return released_load(size, load.start)
        case "file":
            times, values = _place_record(_read_record(load, folder), load, table)
            return recorded_load(times, size * values)


def _read_record(load: _TimedLoadTable, folder: Path) -> ForceRecord:
    path = resolve_file(folder, load.file or "", RECORD_SUFFIXES, RECORD)
    return ForceRecord(*read_history(path, RECORD_COLUMNS))


def _sample_record(
    record: ForceRecord, load: _TimedLoadTable, table: _TransientTable
) -> tuple[FloatArray, bool]:
    """Samples of the analysis that lie within a record, in its own time, and whether they are the
    record's own.

    Raises:
        CsvError: There are none.
    """
    rate = table.samples_per_second
    numbers = (record.times + load.start) * rate
    first, last = int(np.ceil(numbers[0] - ON_GRID)), int(np.floor(numbers[-1] + ON_GRID))
    if last - first < 1:
        raise CsvError(
            f"the record lasts {record.times[-1] - record.times[0]:g} s, less than a sample of the analysis at {rate:g} Hz; raise sampling"
        )
    grid = np.arange(first, last + 1) / rate - load.start
    exact = bool((np.abs(numbers - np.round(numbers)) < ON_GRID).all())
    return np.clip(grid, record.times[0], record.times[-1]), exact


def _place_record(
    record: ForceRecord, load: _TimedLoadTable, table: _TransientTable
) -> tuple[FloatArray, FloatArray]:
    """Times of the analysis and values there: those of the record where it has these samples, else
    means around them, which keep its impulse.
    """
    grid, exact = _sample_record(record, load, table)
    values: FloatArray = (
        np.interp(grid, record.times, record.forces[:, 0])
        if exact
        else resample_forces(record, grid)[:, 0]
    )
    return grid + load.start, values


ANALYSIS = SceneAnalysis(
    _TransientTable,
    TransientRequest,
    "motion under loads that change with time, see [loads over time](transient.md)",
    build=_build,
    check=_check,
    check_complete=_check_motors,
)
