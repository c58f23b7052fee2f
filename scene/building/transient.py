"""The transient analysis: built from its table, and what may be wrong with it."""

from pathlib import Path

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.meshing.process.strangers import RECORD
from headstock.scene.building.analyses import build_channels, check_probe_output
from headstock.scene.building.draft import Draft, check_channel, check_name, check_pose_names
from headstock.scene.reading.files import resolve_file
from headstock.scene.reading.findings import Findings
from headstock.scene.reading.forces import (
    ForceFileError,
    ForceRecord,
    read_columns,
    resample_forces,
    resampling_loss,
)
from headstock.scene.reading.positions import KeyPath
from headstock.scene.reading.units import ANGULAR_IMPULSE, FORCE, IMPULSE, MOMENT
from headstock.scene.requests import TimedLoad, TransientRequest
from headstock.scene.schema.scene import SceneTable
from headstock.scene.schema.transient import TimedLoadTable, TransientTable
from headstock.solvers.linear.load_history import (
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
RECORD_COLUMNS = ("time", "value")
ON_GRID = 1e-6  # of a time step
MUCH_LOST = 0.01  # of the rms of a record
GRAVITY = "gravity"


def build_transient(
    scene: SceneTable, poses: tuple[str, ...], folder: Path
) -> TransientRequest | None:
    """The transient response a scene asks for; in ``poses`` unless it names some.

    Args:
        scene: With its tables.
        poses: Of the scene.
        folder: Of the scene, for records.

    Raises:
        ValueError: A record is missing or out of bounds.
        ForceFileError: A record cannot be used.
    """
    table = scene.analyses.transient
    if table is None:
        return None
    outputs = [one for one in table.outputs or () if one[0] not in scene.probes]
    inside = [name for name, _ in table.outputs or () if name in scene.probes]
    return TransientRequest(
        loads=tuple(
            TimedLoad(
                name,
                load.at if load.at is not None else load.load or "",
                load.shape,
                _build_history(load, table, folder),
            )
            for name, load in table.loads.items()
        ),
        velocities={
            name: (speeds[0], speeds[1], speeds[2]) for name, speeds in table.velocity.items()
        },
        outputs=build_channels(outputs or [(name, "") for name in scene.points]),
        duration=table.duration,
        sampling_hz=table.samples_per_second,
        up_to_hz=table.up_to,
        settled=table.settled,
        poses=tuple(table.poses or poses),
        motors=table.motors,
        probes=tuple(dict.fromkeys(inside if table.outputs else scene.probes)),
    )


def check_transient(draft: Draft, findings: Findings) -> None:
    """Report names that there are not, sizes of another kind than their direction, and records that
    cannot be used.
    """
    table = draft.table.analyses.transient
    if table is None:
        return
    for name, load in table.loads.items():
        _check_load((*KEY, "loads", name), load, draft, findings)
        if load.file is not None:
            _check_record((*KEY, "loads", name, "file"), load, table, draft.folder, findings)
    for name in table.velocity:
        check_name((*KEY, "velocity", name), name, "components", draft, findings)
    for index, (name, direction) in enumerate(table.outputs or ()):
        if name in draft.sections.get("probes", ()):
            check_probe_output((*KEY, "outputs", index), name, direction, draft, findings)
        else:
            check_channel((*KEY, "outputs", index), name, draft, findings)
    check_pose_names((*KEY, "poses"), table.poses, draft, findings)
    outputs = [one for one, _ in table.outputs or () if one not in draft.table.probes]
    if not outputs and not draft.table.points:
        findings.add(
            KEY,
            'there is no point whose motion is wanted; write [points], or outputs = [["tcp", "z"]]',
        )


def _check_load(key: KeyPath, load: TimedLoadTable, draft: Draft, findings: Findings) -> None:
    if load.at is None:
        if load.load == GRAVITY:
            if not draft.table.effects.get(GRAVITY):
                findings.add((*key, "load"), "needs gravity; write [effects] gravity = true")
            return
        check_name((*key, "load"), load.load or "", "loads", draft, findings)
        named = draft.table.loads.get(load.load or "")
        if named is not None and named.joint is not None:
            findings.add(
                (*key, "load"),
                "is a displacement, which is a static load only; write a force over time",
            )
        return
    name, direction = load.at
    check_channel((*key, "at"), name, draft, findings)
    if load.size is None:
        return
    turns, strikes = direction.startswith("r"), load.shape == "impulse"
    wanted = (ANGULAR_IMPULSE if turns else IMPULSE) if strikes else MOMENT if turns else FORCE
    if load.size.dimension != wanted:
        findings.add(
            (*key, "size"),
            f"is a {load.size.dimension.name}, and shape {load.shape} in {direction} takes a {wanted.name}; write for"
            f' example "{wanted.example}"',
        )


def _check_record(
    key: KeyPath, load: TimedLoadTable, table: TransientTable, folder: Path, findings: Findings
) -> None:
    try:
        record = _read_record(load, folder)
        lost = _find_loss(record, load, table)
    except (ValueError, ForceFileError) as error:
        findings.add(key, str(error))
        return
    if lost > MUCH_LOST:
        findings.warn(
            key,
            f"{100.0 * lost:.2g} % of its rms are faster than the samples of the analysis at"
            f" {table.samples_per_second:g} Hz and are left out; each sample has the mean around it",
        )


def _build_history(load: TimedLoadTable, table: TransientTable, folder: Path) -> LoadHistory:
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


def _read_record(load: TimedLoadTable, folder: Path) -> ForceRecord:
    path = resolve_file(folder, load.file or "", RECORD_SUFFIXES, RECORD)
    values = read_columns(path, RECORD_COLUMNS)
    return ForceRecord(values[:, 0], values[:, 1:])


def _grid_of(record: ForceRecord, load: TimedLoadTable, table: TransientTable) -> FloatArray:
    """Samples of the analysis that lie within a record, in its own time.

    Raises:
        ForceFileError: There are none.
    """
    rate = table.samples_per_second
    ends = (record.times[[0, -1]] + load.start) * rate
    first, last = int(np.ceil(ends[0] - ON_GRID)), int(np.floor(ends[1] + ON_GRID))
    if last - first < 1:
        raise ForceFileError(
            f"the record lasts {record.times[-1] - record.times[0]:g} s, less than a sample of the analysis at {rate:g} Hz; raise sampling"
        )
    grid = np.arange(first, last + 1) / rate - load.start
    return np.asarray(np.clip(grid, record.times[0], record.times[-1]))


def _is_on_grid(record: ForceRecord, load: TimedLoadTable, table: TransientTable) -> bool:
    places = (record.times + load.start) * table.samples_per_second
    return bool((np.abs(places - np.round(places)) < ON_GRID).all())


def _place_record(
    record: ForceRecord, load: TimedLoadTable, table: TransientTable
) -> tuple[FloatArray, FloatArray]:
    """Times of the analysis and values there: those of the record where it has these samples, else
    means around them, which keep its impulse.
    """
    grid = _grid_of(record, load, table)
    exact = _is_on_grid(record, load, table)
    values: FloatArray = (
        np.interp(grid, record.times, record.forces[:, 0])
        if exact
        else resample_forces(record, grid)[:, 0]
    )
    return grid + load.start, values


def _find_loss(record: ForceRecord, load: TimedLoadTable, table: TransientTable) -> float:
    """Share of the rms of a record that samples of the analysis do not hold."""
    grid = _grid_of(record, load, table)
    return 0.0 if _is_on_grid(record, load, table) else resampling_loss(record, grid)
