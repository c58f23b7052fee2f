"""Rows of displacement and stress at probes, under static loads, over frequency and over time; and of what drives
and joints take while a machine moves.
"""

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from headstock.app.tables.table import (
    Cell,
    Column,
    Listing,
    PlainTable,
    bound_column,
    tabulate,
    tabulate_curves,
)
from headstock.geometry.frames import DIRECTIONS, FloatArray
from headstock.pipeline.answers.frf import ResponseCurves, ResponseSummary
from headstock.pipeline.answers.motion_forces import (
    DriveForceSummary,
    JointForceSummary,
    ProbeMotionSummary,
    ProbeTrace,
)
from headstock.pipeline.answers.path import FeedSummary, PathCurves
from headstock.pipeline.answers.probes import (
    MEGA,
    MICRO,
    ProbeCurves,
    ProbePeakSummary,
    ProbeSummary,
    probe_units,
)
from headstock.pipeline.answers.transient import TransientCurves, TransientSummary
from headstock.pipeline.results.mode_files import file_stem
from headstock.solvers.second_order import ComplexArray, name_channel
from headstock.solvers.stresses import STRESS_NAMES

type ProbeRow = tuple[str, ProbeSummary]
type ProbeColumns = tuple[Column[ProbeRow], Column[ProbeRow]]


def _moved(axis: int) -> ProbeColumns:
    d = DIRECTIONS[axis]
    return bound_column(
        lambda row: row[1]["displacement_um"][axis],
        lambda row: row[1]["displacement_error_um"][axis],
        f"displacement {d} [um]",
        f">{d} µm",
        f"{d} [µm]",
    )


def _stressed(pair: str) -> ProbeColumns:
    return bound_column(
        lambda row: row[1]["stress_mpa"][pair],
        lambda row: row[1]["stress_error_mpa"][pair],
        f"stress {pair} [MPa]",
        report=f"{pair} [MPa]",
    )


_NAMES: tuple[Column[ProbeRow], ...] = (
    Column(lambda row: row[0], "probe", "probe", "Probe"),
    Column(lambda row: row[1]["component"], "component", "in", "Component"),
)
_MOVED, _STRESSED = [_moved(axis) for axis in range(3)], [_stressed(pair) for pair in STRESS_NAMES]
_MISES: ProbeColumns = bound_column(
    lambda row: row[1]["von_mises_mpa"],
    lambda row: row[1]["von_mises_error_mpa"],
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
    """The largest equivalent stress at a probe under an input."""

    probe: str
    component: str
    peak: ProbePeakSummary


def list_probe_peaks(response: ResponseSummary) -> list[_ProbePeakRow]:
    """Every probe of a frequency response under every input."""
    return [
        _ProbePeakRow(name, probe["component"], peak)
        for name, probe in response.get("probes", {}).items()
        for peak in probe["inputs"]
    ]


def _of_peak(key: str, file: str, screen: str, report: str) -> Column[Any]:
    return Column(lambda row: row.peak[key], file, screen, report)


PROBE_PEAK_COLUMNS: tuple[Column[_ProbePeakRow], ...] = (
    Column(lambda row: row.probe, "probe", "probe", "Probe"),
    Column(lambda row: row.component, "component", "in", "Component"),
    Column(lambda row: " ".join(row.peak["input"]), "load", "load", "Load"),
    _of_peak("static_von_mises", "von Mises at rest", ">von Mises at rest", "von Mises at rest"),
    *bound_column(
        lambda row: row.peak["peak_von_mises"],
        lambda row: row.peak["peak_von_mises_error"],
        "largest von Mises",
        ">largest",
        "largest over a cycle",
    ),
    _of_peak("peak_hz", "at [Hz]", ">at Hz", "at [Hz]"),
    _of_peak("unit", "unit", "unit", "Unit"),
)


type ProbeMotionRow = tuple[str, ProbeMotionSummary]


def _at_ms(key: str, file: str, screen: str) -> Column[Any]:
    return Column(lambda row: 1e3 * row[1][key], file, screen, "at [ms]")


PROBE_MOTION_PEAKS: tuple[Column[ProbeMotionRow], ...] = (
    Column(lambda row: row[0], "probe", "probe", "Probe"),
    Column(lambda row: row[1]["component"], "component", "in", "Component"),
    *bound_column(
        lambda row: row[1]["peak_von_mises_mpa"],
        lambda row: row[1]["peak_von_mises_error_mpa"],
        "largest von Mises [MPa]",
        ">von Mises MPa",
        "von Mises [MPa]",
    ),
    _at_ms("peak_von_mises_s", "von Mises at [ms]", ">at ms"),
    *bound_column(
        lambda row: row[1]["peak_displacement_um"],
        lambda row: row[1]["peak_displacement_error_um"],
        "largest displacement [um]",
        ">displacement µm",
        "Displacement [µm]",
    ),
    _at_ms("peak_displacement_s", "displacement at [ms]", ">at ms "),
)


def list_motion_columns(curves: PathCurves | TransientCurves) -> list[tuple[str, FloatArray]]:
    """Headings and values ``(n,)`` of probes over time, and of what drives under control do."""
    columns = [column for probe in curves.probes for column in _list_trace_columns(probe)]
    for number, name in enumerate(curves.drives):
        columns += [
            (f"torque of {name} [N m]", curves.torques[:, number]),
            (f"position error of {name} [um]", MICRO * curves.position_errors[:, number]),
        ]
    return columns


def _list_trace_columns(probe: ProbeTrace) -> list[tuple[str, FloatArray]]:
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


type MotorRow = tuple[str, DriveForceSummary]
type JointForces = Mapping[str, JointForceSummary]
type JointRow = tuple[str, JointForces]

MOTOR_COLUMNS: tuple[Column[MotorRow], ...] = (
    Column(lambda row: row[0], "drive", "drive", "Drive"),
    *bound_column(
        lambda row: row[1]["torque_nm"],
        lambda row: row[1]["torque_off_nm"],
        "largest torque [N m]",
        ">torque N m",
        "Torque [N m]",
        error_file="± torque [N m]",
        open_errors=False,
    ),
    _at_ms("torque_s", "torque at [ms]", ">at ms"),
    *bound_column(
        lambda row: row[1]["position_error_um"],
        lambda row: row[1]["position_error_off_um"],
        "largest position error [um]",
        ">position error µm",
        "Position error [µm]",
        error_file="± position error [um]",
        open_errors=False,
    ),
    _at_ms("position_error_s", "position error at [ms]", ">at ms "),
)


def _largest(row: JointRow, unit: str) -> tuple[str, JointForceSummary] | None:
    own = [(name, found) for name, found in row[1].items() if found["unit"] == unit]
    return max(own, key=lambda item: abs(item[1]["force"]), default=None)


def _read(row: JointRow, unit: str, what: Literal["direction", "force", "force_s"]) -> Cell:
    largest = _largest(row, unit)
    if largest is None:
        return None
    if what == "direction":
        return largest[0]
    return largest[1][what] * (1e3 if what == "force_s" else 1.0)


def _find_error(row: JointRow, unit: str) -> float | None:
    largest = _largest(row, unit)
    return None if largest is None or not largest[1]["force"] else largest[1]["error"]


def _list_largest(unit: str, heading: str, at: str) -> tuple[Column[JointRow], ...]:
    """Return the columns of the largest force, or moment, of a joint; files have all directions."""
    screen, report = f">{unit}", f"[{unit}]"
    return (
        Column(lambda row: _read(row, unit, "direction"), "", heading, heading.capitalize()),
        Column(
            lambda row: _read(row, unit, "force"),
            "",
            screen,
            report,
            error=lambda row: _find_error(row, unit),
        ),
        Column(lambda row: _read(row, unit, "force_s"), "", at, "at [ms]"),
    )


JOINT_FORCE_COLUMNS: tuple[Column[JointRow], ...] = (
    Column(lambda row: row[0], "", "joint", "Joint"),
    *_list_largest("N", "force in", ">at ms"),
    *_list_largest("N m", "moment about", ">at ms "),
)
FORCE_COLUMNS = {  # as templates call them
    "probe_peaks_over_time": PROBE_MOTION_PEAKS,
    "motors": MOTOR_COLUMNS,
    "joint_forces": JOINT_FORCE_COLUMNS,
}


def list_force_tables(
    found: FeedSummary | TransientSummary, where: str, stress: str
) -> Iterator[Listing[Any]]:
    """Yield what probes, drives and joints took at most, as far as there are any.

    Args:
        where: Ends the titles: at which feed or in which pose.
        stress: Begins the title of probes.
    """
    if found["probes"]:
        yield Listing(f"{stress} at probes {where}", PROBE_MOTION_PEAKS, found["probes"].items())
    if found["drives"]:
        yield Listing(f"Motors {where}", MOTOR_COLUMNS, found["drives"].items())
    if found["joints"]:
        title = f"Largest forces of joints {where}"
        yield Listing(title, JOINT_FORCE_COLUMNS, found["joints"].items())


def tabulate_forces(
    found: FeedSummary | TransientSummary, stem: str, probes: str
) -> Iterator[PlainTable]:
    """Yield the same for files, joints with a row per direction.

    Args:
        stem: Ends the names of the files.
    """
    if found["drives"]:
        yield tabulate(f"motors_{stem}", MOTOR_COLUMNS, found["drives"].items())
    if found["probes"]:
        yield tabulate(f"{probes}_{stem}", PROBE_MOTION_PEAKS, found["probes"].items())
    if found["joints"]:
        yield PlainTable(
            f"joint_forces_{stem}",
            ("joint", "direction", "largest force on the first end", "±", "unit", "at [s]"),
            tuple(
                (joint, direction, force["force"], force["error"], force["unit"], force["force_s"])
                for joint, directions in found["joints"].items()
                for direction, force in directions.items()
            ),
        )
