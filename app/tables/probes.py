"""Rows of displacement and stress at probes, under static loads, over frequency and over time; and of what drives
and joints take while a machine moves.
"""

import itertools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from headstock.app.tables.table import Cell, Column, Listing, PlainTable, tabulate, tabulate_curves
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


def _open(error: float | None) -> float:
    """An error that nobody knows as NaN, which is shown as such."""
    return math.nan if error is None else error


def _moved(axis: int) -> Column[tuple[str, ProbeSummary]]:
    d = DIRECTIONS[axis]
    return Column(
        lambda row: row[1]["displacement_um"][axis],
        f"displacement {d} [um]",
        f">{d} µm",
        f"{d} [µm]",
        error=lambda row: _open(row[1]["displacement_error_um"][axis]),
    )


def _stressed(pair: str) -> Column[tuple[str, ProbeSummary]]:
    return Column(
        lambda row: row[1]["stress_mpa"][pair],
        f"stress {pair} [MPa]",
        report=f"{pair} [MPa]",
        error=lambda row: _open(row[1]["stress_error_mpa"][pair]),
    )


def _moved_error(axis: int) -> Column[tuple[str, ProbeSummary]]:
    return Column(
        lambda row: row[1]["displacement_error_um"][axis], f"± displacement {DIRECTIONS[axis]} [um]"
    )


def _stress_error(pair: str) -> Column[tuple[str, ProbeSummary]]:
    return Column(lambda row: row[1]["stress_error_mpa"][pair], f"± stress {pair} [MPa]")


_NAMES: tuple[Column[tuple[str, ProbeSummary]], ...] = (
    Column(lambda row: row[0], "probe", "probe", "Probe"),
    Column(lambda row: row[1]["component"], "component", "in", "Component"),
)
_MOVED = tuple(_moved(axis) for axis in range(3))
_STRESSED = tuple(_stressed(pair) for pair in STRESS_NAMES)
_MISES: Column[tuple[str, ProbeSummary]] = Column(
    lambda row: row[1]["von_mises_mpa"],
    "von Mises [MPa]",
    ">von Mises MPa",
    "von Mises [MPa]",
    error=lambda row: _open(row[1]["von_mises_error_mpa"]),
)
# in the report two tables, so that six stresses with their errors fit
PROBE_MOTION_COLUMNS = (*_NAMES, *_MOVED, _MISES)
PROBE_STRESS_COLUMNS = (*_NAMES, *_STRESSED)
PROBE_COLUMNS = (
    *_NAMES,
    *(bound for axis in range(3) for bound in (_MOVED[axis], _moved_error(axis))),
    *(
        bound
        for column, pair in zip(_STRESSED, STRESS_NAMES, strict=True)
        for bound in (column, _stress_error(pair))
    ),
    _MISES,
    Column[tuple[str, ProbeSummary]](
        lambda row: row[1]["von_mises_error_mpa"], "± von Mises [MPa]"
    ),
)


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


PROBE_PEAK_COLUMNS: tuple[Column[_ProbePeakRow], ...] = (
    Column(lambda row: row.probe, "probe", "probe", "Probe"),
    Column(lambda row: row.component, "component", "in", "Component"),
    Column(lambda row: " ".join(row.peak["input"]), "load", "load", "Load"),
    Column(
        lambda row: row.peak["static_von_mises"],
        "von Mises at rest",
        ">von Mises at rest",
        "von Mises at rest",
    ),
    Column(
        lambda row: row.peak["peak_von_mises"],
        "largest von Mises",
        ">largest",
        "largest over a cycle",
        error=lambda row: _open(row.peak["peak_von_mises_error"]),
    ),
    Column(lambda row: row.peak["peak_von_mises_error"], "± largest von Mises"),
    Column(lambda row: row.peak["peak_hz"], "at [Hz]", ">at Hz", "at [Hz]"),
    Column(lambda row: row.peak["unit"], "unit", "unit", "Unit"),
)


type ProbeMotionRow = tuple[str, ProbeMotionSummary]

PROBE_MOTION_PEAKS: tuple[Column[ProbeMotionRow], ...] = (
    Column(lambda row: row[0], "probe", "probe", "Probe"),
    Column(lambda row: row[1]["component"], "component", "in", "Component"),
    Column(
        lambda row: row[1]["peak_von_mises_mpa"],
        "largest von Mises [MPa]",
        ">von Mises MPa",
        "von Mises [MPa]",
        error=lambda row: _open(row[1]["peak_von_mises_error_mpa"]),
    ),
    Column(lambda row: row[1]["peak_von_mises_error_mpa"], "± largest von Mises [MPa]"),
    Column(lambda row: 1e3 * row[1]["peak_von_mises_s"], "von Mises at [ms]", ">at ms", "at [ms]"),
    Column(
        lambda row: row[1]["peak_displacement_um"],
        "largest displacement [um]",
        ">displacement µm",
        "Displacement [µm]",
        error=lambda row: _open(row[1]["peak_displacement_error_um"]),
    ),
    Column(lambda row: row[1]["peak_displacement_error_um"], "± largest displacement [um]"),
    Column(
        lambda row: 1e3 * row[1]["peak_displacement_s"],
        "displacement at [ms]",
        ">at ms ",
        "at [ms]",
    ),
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
    Column(
        lambda row: row[1]["torque_nm"],
        "largest torque [N m]",
        ">torque N m",
        "Torque [N m]",
        error=lambda row: row[1]["torque_off_nm"],
    ),
    Column(lambda row: row[1]["torque_off_nm"], "± torque [N m]"),
    Column(lambda row: 1e3 * row[1]["torque_s"], "torque at [ms]", ">at ms", "at [ms]"),
    Column(
        lambda row: row[1]["position_error_um"],
        "largest position error [um]",
        ">position error µm",
        "Position error [µm]",
        error=lambda row: row[1]["position_error_off_um"],
    ),
    Column(lambda row: row[1]["position_error_off_um"], "± position error [um]"),
    Column(
        lambda row: 1e3 * row[1]["position_error_s"],
        "position error at [ms]",
        ">at ms ",
        "at [ms]",
    ),
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


# the largest force and the largest moment of each joint; files have all directions
JOINT_FORCE_COLUMNS: tuple[Column[JointRow], ...] = (
    Column(lambda row: row[0], "", "joint", "Joint"),
    Column(lambda row: _read(row, "N", "direction"), "", "force in", "Force in"),
    Column(
        lambda row: _read(row, "N", "force"),
        "",
        ">N",
        "[N]",
        error=lambda row: _find_error(row, "N"),
    ),
    Column(lambda row: _read(row, "N", "force_s"), "", ">at ms", "at [ms]"),
    Column(lambda row: _read(row, "N m", "direction"), "", "moment about", "Moment about"),
    Column(
        lambda row: _read(row, "N m", "force"),
        "",
        ">N m",
        "[N m]",
        error=lambda row: _find_error(row, "N m"),
    ),
    Column(lambda row: _read(row, "N m", "force_s"), "", ">at ms ", "at [ms]"),
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
        probes: Begins the name of that of probes.
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
