"""Rows of displacement and stress at probes, under static loads, over frequency and over time; and of what drives
and joints take while a machine moves.
"""

import dataclasses
import itertools
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from headstock.app.tables.table import (
    Cell,
    Column,
    Listing,
    NumbersRow,
    PlainTable,
    bound_column,
    plain_column,
    tabulate,
    tabulate_curves,
)
from headstock.geometry.frames import DIRECTIONS, FloatArray
from headstock.pipeline.answers.answer import Answer
from headstock.pipeline.answers.frf import ResponseCurves
from headstock.pipeline.answers.motion_forces import DriveExtremes, ProbeMotion, ProbeTrace
from headstock.pipeline.answers.path import PathCurves, PathRun
from headstock.pipeline.answers.probes import (
    MEGA,
    MICRO,
    ProbeAnswer,
    ProbeCurves,
    ProbeResponse,
    probe_units,
)
from headstock.pipeline.answers.transient import TransientAnswer, TransientCurves
from headstock.pipeline.numbers.estimates import Estimate, scale_known, scale_shares
from headstock.pipeline.results.mode_files import file_stem
from headstock.solvers.second_order import Channel, ComplexArray, name_channel
from headstock.solvers.stresses import STRESS_NAMES
from headstock.solvers.watched_outputs import Extreme


@dataclass(frozen=True, eq=False)
class ProbeRow(NumbersRow):
    """A probe under static loads."""

    name: str
    probe: ProbeResponse


type ProbeColumns = tuple[Column[ProbeRow], Column[ProbeRow]]


def list_probes(answer: ProbeAnswer) -> list[ProbeRow]:
    """Return the probes of a pose."""
    numbers = answer.index_numbers()
    return [
        ProbeRow(numbers, {"pose": answer.pose, "probe": name}, name, probe)
        for name, probe in answer.probes.items()
    ]


def _moved(axis: int) -> ProbeColumns:
    d = DIRECTIONS[axis]
    return bound_column(
        lambda row: float(MICRO * row.probe.shown_displacement[axis]),
        lambda row: row.error("probe_displacement", direction=d),
        f"displacement {d} [um]",
        f">{d} µm",
        f"{d} [µm]",
    )


def _stressed(place: int, pair: str) -> ProbeColumns:
    return bound_column(
        lambda row: float(MEGA * row.probe.shown_stress[place]),
        lambda row: row.error("probe_stress", component=pair),
        f"stress {pair} [MPa]",
        report=f"{pair} [MPa]",
    )


_NAMES: tuple[Column[ProbeRow], ...] = (
    Column(lambda row: row.name, "probe", "probe", "Probe"),
    Column(lambda row: row.probe.component, "component", "in", "Component"),
)
_MOVED = [_moved(axis) for axis in range(3)]
_STRESSED = [_stressed(place, pair) for place, pair in enumerate(STRESS_NAMES)]
_MISES: ProbeColumns = bound_column(
    lambda row: row.value("probe_stress", component="von_mises"),
    lambda row: row.error("probe_stress", component="von_mises"),
    "von Mises [MPa]",
    ">von Mises MPa",
    "von Mises [MPa]",
)
# in the report two tables, so that six stresses with their errors fit
PROBE_MOTION_COLUMNS = (*_NAMES, *(moved for moved, _ in _MOVED), _MISES[0])
PROBE_STRESS_COLUMNS = (*_NAMES, *(stressed for stressed, _ in _STRESSED))
PROBE_COLUMNS = (*_NAMES, *itertools.chain(*_MOVED, *_STRESSED, _MISES))


@dataclass(frozen=True)
class _ProbePeakRow:
    """The largest equivalent stress at a probe under an input, in its unit there."""

    probe: ProbeCurves
    given: Channel
    unit: str
    static: float | None = None
    largest: float | None = None
    error: float | None = None
    hz: float | None = None


def list_probe_peaks(curves: ResponseCurves) -> list[_ProbePeakRow]:
    """Every probe of a frequency response under every input."""
    rows = []
    for probe in curves.probes:
        for column, given in enumerate(probe.inputs):
            unit, _, per = probe_units(given)
            row, peak = _ProbePeakRow(probe, given, unit), probe.find_peak(column)
            if peak is not None:
                factor = per * MEGA
                row = dataclasses.replace(
                    row,
                    static=scale_known(peak.static, factor),
                    largest=factor * peak.size,
                    error=Estimate(scale_shares(peak.error, factor)).total,
                    hz=float(probe.frequencies_hz[peak.place]),
                )
            rows.append(row)
    return rows


PROBE_PEAK_COLUMNS: tuple[Column[_ProbePeakRow], ...] = (
    Column(lambda row: row.probe.name, "probe", "probe", "Probe"),
    Column(lambda row: row.probe.component, "component", "in", "Component"),
    Column(lambda row: " ".join(row.given), "load", "load", "Load"),
    Column(lambda row: row.static, "von Mises at rest", ">von Mises at rest", "von Mises at rest"),
    *bound_column(
        lambda row: row.largest,
        lambda row: row.error,
        "largest von Mises",
        ">largest",
        "largest over a cycle",
    ),
    plain_column(lambda row: row.hz, "at [Hz]", ">at Hz", "at [Hz]"),
    plain_column(lambda row: row.unit, "unit", "unit", "Unit"),
)


@dataclass(frozen=True, eq=False)
class _ForceRow[Found](NumbersRow):
    """What a probe, drive or joint took at most while the machine moved."""

    name: str
    found: Found


type _ProbeRow = _ForceRow[ProbeMotion]
type _DriveRow = _ForceRow[DriveExtremes]
type _JointRow = _ForceRow[dict[str, Extreme]]


def list_moved[Found](
    answer: Answer, found: Mapping[str, Found], role: str, **roles: str
) -> list[_ForceRow[Found]]:
    """Return a row for each probe, drive or joint.

    Args:
        role: In keys of their numbers, such as ``probe``.
        roles: Others that these keys have: feed or pose.
    """
    numbers = answer.index_numbers()
    return [_ForceRow(numbers, {role: name, **roles}, name, each) for name, each in found.items()]


PROBE_MOTION_PEAKS: tuple[Column[_ProbeRow], ...] = (
    Column(lambda row: row.name, "probe", "probe", "Probe"),
    Column(lambda row: row.found.component, "component", "in", "Component"),
    *bound_column(
        lambda row: row.value("peak_stress"),
        lambda row: row.error("peak_stress"),
        "largest von Mises [MPa]",
        ">von Mises MPa",
        "von Mises [MPa]",
    ),
    plain_column(
        lambda row: 1e3 * row.found.von_mises.time, "von Mises at [ms]", ">at ms", "at [ms]"
    ),
    *bound_column(
        lambda row: row.value("peak_displacement"),
        lambda row: row.error("peak_displacement"),
        "largest displacement [um]",
        ">displacement µm",
        "Displacement [µm]",
    ),
    plain_column(
        lambda row: 1e3 * row.found.displacement.time, "displacement at [ms]", ">at ms ", "at [ms]"
    ),
)


def list_motion_columns(curves: PathCurves | TransientCurves) -> list[tuple[str, FloatArray]]:
    """Headings and values ``(n,)`` of probes over time, and of what drives under control do."""
    columns = [column for probe in curves.probes for column in list_trace_columns(probe)]
    for number, name in enumerate(curves.drives):
        columns += [
            (f"torque of {name} [N m]", curves.torques[:, number]),
            (f"position error of {name} [um]", MICRO * curves.position_errors[:, number]),
        ]
    return columns


def list_trace_columns(probe: ProbeTrace) -> list[tuple[str, FloatArray]]:
    """Headings and values ``(n,)`` of stress and displacement at a probe over time."""
    return [
        (f"von Mises {probe.name} [MPa]", MEGA * probe.von_mises),
        *(
            (f"stress {pair} {probe.name} [MPa]", MEGA * probe.stress[:, row])
            for row, pair in enumerate(STRESS_NAMES)
        ),
        *(
            (f"displacement {along} {probe.name} [um]", MICRO * probe.displacement[:, row])
            for row, along in enumerate(DIRECTIONS)
        ),
    ]


def tabulate_probes(curves: ResponseCurves) -> PlainTable:
    """Tabulate a row per frequency: largest equivalent stress over a cycle with its error, and real and
    imaginary part of displacement and stress, at every probe under every input; SI.
    """
    columns = itertools.chain.from_iterable(map(_list_columns, curves.probes))
    first = ("frequency [Hz]", curves.frequencies_hz)
    return tabulate_curves(f"probes_frf_{file_stem(curves.pose)}", [first, *columns])


def _list_columns(probe: ProbeCurves) -> Iterator[tuple[str, FloatArray]]:
    for column, given in enumerate(probe.inputs):
        stress, moved, _ = probe_units(given)
        pascal, metre = stress.replace("MPa/kN", "MPa/N"), moved.replace("µm/kN", "µm/N")
        pascal, metre = pascal.replace("MPa", "Pa"), metre.replace("µm", "m")
        where = f"{probe.name} / {name_channel(given)}"
        yield f"von Mises {where} [{pascal}]", probe.von_mises[:, column]
        if probe.von_mises_error is not None:
            yield f"± von Mises {where} [{pascal}]", probe.von_mises_error[:, column]
        for row, name in enumerate(STRESS_NAMES):
            for part, values in _parts(probe.stress[:, row, column]):
                yield f"{part} stress {name} {where} [{pascal}]", values
        for row, name in enumerate(DIRECTIONS):
            for part, values in _parts(probe.displacement[:, row, column]):
                yield f"{part} displacement {name} {where} [{metre}]", values


def _parts(values: ComplexArray) -> tuple[tuple[str, FloatArray], ...]:
    return (
        ("Re", np.asarray(values.real, dtype=float)),
        ("Im", np.asarray(values.imag, dtype=float)),
    )


MOTOR_COLUMNS: tuple[Column[_DriveRow], ...] = (
    Column(lambda row: row.name, "drive", "drive", "Drive"),
    *bound_column(
        lambda row: row.value("motor_torque"),
        lambda row: row.error("motor_torque"),
        "largest torque [N m]",
        ">torque N m",
        "Torque [N m]",
        error_file="± torque [N m]",
        open_errors=False,
    ),
    plain_column(lambda row: 1e3 * row.found.torque.time, "torque at [ms]", ">at ms", "at [ms]"),
    *bound_column(
        lambda row: row.value("position_error"),
        lambda row: row.error("position_error"),
        "largest position error [um]",
        ">position error µm",
        "Position error [µm]",
        error_file="± position error [um]",
        open_errors=False,
    ),
    plain_column(
        lambda row: 1e3 * row.found.position_error.time,
        "position error at [ms]",
        ">at ms ",
        "at [ms]",
    ),
)


def _unit_of(direction: str) -> str:
    """N of a force, N m of a moment."""
    return "N m" if direction.startswith("r") else "N"


def _list_largest(unit: str, heading: str, at: str) -> tuple[Column[_JointRow], ...]:
    """Return the columns of the largest force, or moment, of a joint; files have all directions."""

    def find(row: _JointRow) -> tuple[str, Extreme] | None:
        forces = [item for item in row.found.items() if _unit_of(item[0]) == unit]
        return max(forces, key=lambda item: abs(item[1].value), default=None)

    def read(pick: Callable[[str, Extreme], Cell]) -> Callable[[_JointRow], Cell]:
        return lambda row: None if (found := find(row)) is None else pick(*found)

    def error(row: _JointRow) -> float | None:
        found = find(row)
        if found is None or not found[1].value:
            return None
        return row.error("joint_force", direction=found[0])

    return (
        Column(read(lambda direction, _: direction), "", heading, heading.capitalize()),
        Column(read(lambda _, force: force.value), "", f">{unit}", f"[{unit}]", error=error),
        Column(read(lambda _, force: 1e3 * force.time), "", at, "at [ms]"),
    )


JOINT_FORCE_COLUMNS: tuple[Column[_JointRow], ...] = (
    Column(lambda row: row.name, "", "joint", "Joint"),
    *_list_largest("N", "force in", ">at ms"),
    *_list_largest("N m", "moment about", ">at ms "),
)


FORCE_COLUMNS = {  # as templates call them
    "probe_peaks_over_time": PROBE_MOTION_PEAKS,
    "motors": MOTOR_COLUMNS,
    "joint_forces": JOINT_FORCE_COLUMNS,
}


class Forces(NamedTuple):
    """What probes, drives and joints took at most while the machine moved."""

    probes: list[_ProbeRow]
    motors: list[_DriveRow]
    joints: list[_JointRow]


def gather_forces(answer: Answer, found: PathRun | TransientAnswer, **roles: str) -> Forces:
    """Return what a move took at most; roles as of :func:`list_moved`."""
    return Forces(
        list_moved(answer, found.probes, "probe", **roles),
        list_moved(answer, found.drives, "drive", **roles),
        list_moved(answer, found.joints, "joint", **roles),
    )


def list_force_tables(forces: Forces, where: str, stress: str) -> Iterator[Listing[Any]]:
    """Yield tables of forces, as far as there are any.

    Args:
        where: Ends the titles: at which feed or in which pose.
        stress: Begins the title of probes.
    """
    if forces.probes:
        yield Listing(f"{stress} at probes {where}", PROBE_MOTION_PEAKS, forces.probes)
    if forces.motors:
        yield Listing(f"Motors {where}", MOTOR_COLUMNS, forces.motors)
    if forces.joints:
        yield Listing(f"Largest forces of joints {where}", JOINT_FORCE_COLUMNS, forces.joints)


def tabulate_forces(forces: Forces, stem: str, probes: str) -> Iterator[PlainTable]:
    """Yield the same for files, joints with a row per direction.

    Args:
        stem: Ends the names of the files.
    """
    if forces.motors:
        yield tabulate(f"motors_{stem}", MOTOR_COLUMNS, forces.motors)
    if forces.probes:
        yield tabulate(f"{probes}_{stem}", PROBE_MOTION_PEAKS, forces.probes)
    if forces.joints:
        yield PlainTable(
            f"joint_forces_{stem}",
            ("joint", "direction", "largest force on the first end", "±", "unit", "at [s]"),
            tuple(
                (
                    row.name,
                    each,
                    force.value,
                    row.error("joint_force", direction=each),
                    _unit_of(each),
                    force.time,
                )
                for row in forces.joints
                for each, force in row.found.items()
            ),
        )
