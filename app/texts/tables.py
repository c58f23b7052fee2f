"""Rows of what a run found, for terminal, report and CSV files."""

import csv
import io
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Literal, NamedTuple

import numpy as np

from headstock.app.texts.bounded_values import bound_size, show_damping, show_digits
from headstock.app.texts.curves import name_entry, response_unit_si
from headstock.geometry.frames import DIRECTIONS
from headstock.geometry.machine.machine import show_position
from headstock.pipeline.answers.accuracy import BodyModelSummary
from headstock.pipeline.answers.contouring import ContourSummary, FaceSummary
from headstock.pipeline.answers.control import DriveSummary, PoleSummary
from headstock.pipeline.answers.frf import DrivePointSummary, ResponseCurves, ResponseSummary
from headstock.pipeline.answers.interfaces import JointShapesSummary
from headstock.pipeline.answers.lobes import DirectionSummary, LobesSummary, LobeSummary
from headstock.pipeline.answers.map import Grid, GridSummary
from headstock.pipeline.answers.milled_faces import MilledFaceSummary
from headstock.pipeline.answers.modal import ModesSummary
from headstock.pipeline.answers.path import (
    CruiseSummary,
    FeedSummary,
    PathCurves,
    PathSummary,
    ZoneSummary,
    deviation_unit,
)
from headstock.pipeline.answers.static import PointSummary, ProbeSummary
from headstock.pipeline.answers.transient import (
    MovedOutputSummary,
    TransientCurves,
    TransientSummary,
)
from headstock.pipeline.answers.volumetric import (
    SYMBOLS,
    TOTAL,
    AxisMotionsSummary,
    SquarenessSummary,
    VolumetricSummary,
)
from headstock.pipeline.results.mode_files import file_stem
from headstock.pipeline.results.summary import ComponentSummary, RunSummary
from headstock.reduction.motions.body_motions import name_families
from headstock.solvers.second_order import name_channel

type Cell = str | float | None
type MilledKey = Literal[
    "location_error_um", "ra_um", "rz_um", "wt_um", "pt_um", "mark_at_start_um", "mark_at_end_um"
]
LEAST_WAVE_UM = 1e-3  # that is told of a profile
PART_NAMES = {
    "total": "deviation",
    "quasi_static": "quasi-static",
    "low_frequency": "low-frequency",
    "dynamic": "residual vibration",
}


@dataclass(frozen=True)
class PlainTable:
    """A table: the stem of its file, headings and rows; numbers unrounded."""

    name: str
    headings: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]


@dataclass(frozen=True)
class Column[Row]:
    """A column of a table, the same for the screen, the report and files; each leaves out what has
    no heading there.

    Attributes:
        value: Of a row, unrounded; None where there is none.
        file: Heading in CSV files, with the unit.
        screen: Heading on the screen, after ``>`` for numbers.
        report: Heading in the report.
        digits: Significant ones of a number on the screen and in the report.
        show: Another way to write a number there.
        missing: Written there in place of None; empty for a dash.
        error: How far the number of a row may be off; None where nobody says, and the number is
            then written like any other.
    """

    value: Callable[[Row], Cell]
    file: str = ""
    screen: str = ""
    report: str = ""
    digits: int = 4
    show: Callable[[float], str] | None = None
    missing: str = ""
    error: Callable[[Row], float | None] | None = None


def tabulate[Row](name: str, columns: Sequence[Column[Row]], rows: Iterable[Row]) -> PlainTable:
    """The columns of a table that files have.

    Args:
        name: Stem of the file.
        columns: Of the table.
        rows: As the columns take them.
    """
    kept = [column for column in columns if column.file]
    headings = tuple(column.file for column in kept)
    return PlainTable(
        name, headings, tuple(tuple(column.value(row) for column in kept) for row in rows)
    )


def show_percent(share: float) -> str:
    """A share in per cent, to a tenth."""
    return f"{100.0 * share:.1f} %"


COMPONENT_COLUMNS: tuple[Column[tuple[str, ComponentSummary]], ...] = (
    Column(lambda row: row[0], "component", "component", "Component"),
    Column(lambda row: row[1]["fidelity"], "fidelity", "fidelity", "Fidelity"),
    Column(lambda row: row[1]["full_dofs"], "dofs", ">dofs", "Dofs"),
    Column(lambda row: row[1]["reduced_dofs"], "reduced dofs", ">reduced", "reduced to"),
    Column(lambda row: row[1]["mass_kg"], "mass [kg]", ">kg", "Mass [kg]"),
    Column(
        lambda row: row[1]["cutoff_hz"],
        file="modes complete to [Hz]",
        screen=">modes to Hz",
        report="Modes complete to [Hz]",
        show=lambda hz: f"{hz:.0f}" if hz else "-",
    ),
    Column(lambda row: row[1]["residual"], "residual", report="Residual", digits=3),
    Column(
        lambda row: (
            row[1]["mesh_quality"]["minimum_scaled_jacobian"] if "mesh_quality" in row[1] else None
        ),
        file="worst scaled Jacobian",
        report="Worst element (1 is ideal)",
        digits=2,
    ),
    Column(
        lambda row: row[1]["mesh_quality"]["repaired"] if "mesh_quality" in row[1] else None,
        report="Repaired elements",
    ),
)


JOINT_COLUMNS: tuple[Column[tuple[str, JointShapesSummary]], ...] = (
    Column(lambda row: row[0], "joint", "joint", "Joint"),
    Column(lambda row: row[1]["between"], "between", "between", "Between"),
    Column(lambda row: row[1]["shapes"], "shapes", ">shapes", "Shapes"),
    Column(lambda row: row[1]["compared_with"], "compared with", ">compared with", "Compared with"),
    Column(
        lambda row: row[1]["largest"],
        "largest change",
        ">may be off",
        "May be off",
        show=show_percent,
    ),
    Column(lambda row: row[1]["number"], "of", "<of", "of"),
)
MODEL_COLUMNS: tuple[Column[tuple[str, BodyModelSummary]], ...] = (
    Column(lambda row: row[0], "component", "body", "Body"),
    Column(lambda row: row[1]["fidelity"], "model", "model", "Model"),
    Column(lambda row: row[1]["compared_with"], "compared with", "compared with", "Compared with"),
    Column(
        lambda row: row[1]["largest"],
        "largest change",
        ">changes",
        "Largest change",
        show=show_percent,
    ),
    Column(lambda row: row[1]["number"], "of", "<of", "of"),
)


def _moved(axis: int) -> Column[tuple[str, ProbeSummary]]:
    d = DIRECTIONS[axis]
    return Column(
        lambda row: row[1]["displacement_um"][axis],
        f"displacement {d} [um]",
        f">{d} µm",
        f"{d} [µm]",
    )


def _stressed(pair: str) -> Column[tuple[str, ProbeSummary]]:
    return Column(
        lambda row: row[1]["stress_mpa"][pair], f"stress {pair} [MPa]", report=f"{pair} [MPa]"
    )


def show_deviation(value: float) -> str:
    """A deviation in micrometres or microradians: four digits, and zero below a picometre."""
    return "0" if abs(value) < 1e-6 else f"{value:.4g}"


@dataclass(frozen=True)
class DeviationRow:
    """Displacement of a tool against the work: from what, and ``(6,)`` along and about the machine
    axes [m, rad].
    """

    source: str
    motion: Sequence[float | None]


def _moved_by(dof: int) -> Column[DeviationRow]:
    name = ("x", "y", "z", "A", "B", "C")[dof]
    unit = "um" if dof < 3 else "urad"

    def value(row: DeviationRow) -> Cell:
        moved = row.motion[dof]
        return None if moved is None else 1e6 * moved

    shown = f"{name} [{'µm' if dof < 3 else 'µrad'}]"
    return Column(value, f"{name} [{unit}]", f">{shown}", shown, show=show_deviation, missing="-")


DEVIATION_COLUMNS: tuple[Column[DeviationRow], ...] = (
    Column(lambda row: row.source, "source", "from", "From"),
    *(_moved_by(dof) for dof in range(6)),
)


def list_displacements(point: PointSummary) -> list[DeviationRow]:
    """How a point is moved by each static load, errors of guides among them, and by all."""
    if "displacement" not in point:
        return []
    rows = [
        DeviationRow(load.replace("_", " "), moved)
        for load, moved in point.get("displacements", {}).items()
    ]
    total = DeviationRow("all together", point["displacement"])
    return [*rows, total] if len(rows) != 1 else rows


def list_ranges(found: VolumetricSummary) -> list[DeviationRow]:
    """Ranges of the position error over a volume: of each source, then of all together."""
    rows = [
        DeviationRow(
            "all together" if source == TOTAL else source,
            [1e-6 * ranges[symbol] for symbol in SYMBOLS],
        )
        for source, ranges in found["ranges"].items()
    ]
    # one source alone is all there is
    return rows[1:] + rows[:1] if len(rows) > 2 else rows[1:]


class LineRow(NamedTuple):
    """Deviations of the error motions along one axis."""

    axis: str
    line: AxisMotionsSummary


def list_lines(found: VolumetricSummary) -> list[LineRow]:
    """The axes of a volumetric map."""
    return [LineRow(axis, line) for axis, line in found["lines"].items()]


def _line_column(dof: int) -> Column[LineRow]:
    symbol = SYMBOLS[dof]
    unit = "um" if dof < 3 else "urad"
    shown = f"{symbol} [{'µm' if dof < 3 else 'µrad'}]"
    return Column(
        lambda row: row.line["deviations"][symbol],
        f"{symbol} [{unit}]",
        f">{shown}",
        shown,
        show=show_deviation,
    )


LINE_COLUMNS: tuple[Column[LineRow], ...] = (
    Column(lambda row: row.axis, "axis", "axis", "Axis"),
    *(_line_column(dof) for dof in range(6)),
)

SQUARENESS_COLUMNS: tuple[Column[SquarenessSummary], ...] = (
    Column(lambda row: row["symbol"], "symbol", "symbol", "Symbol"),
    Column(
        lambda row: f"{row['second']} to {row['first']}",
        "squareness of",
        "squareness of",
        "Squareness of",
    ),
    Column(
        lambda row: row["angle_urad"],
        "angle [urad]",
        ">angle [µrad]",
        "Angle [µrad]",
        show=show_deviation,
    ),
)


def volumetric_words(found: VolumetricSummary) -> str:
    """The largest error of a volume and where it is."""
    place = ", ".join(
        f"{axis} = {show_position(position, found['units'][axis])}"
        for axis, position in found["largest_at"].items()
    )
    return f"largest position error {found['largest_um']:.4g} µm at {place}"


PROBE_COLUMNS: tuple[Column[tuple[str, ProbeSummary]], ...] = (
    Column(lambda row: row[0], "probe", "probe", "Probe"),
    Column(lambda row: row[1]["component"], "component", "in", "Component"),
    *(_moved(axis) for axis in range(3)),
    *(_stressed(pair) for pair in ("xx", "yy", "zz", "xy", "xz", "yz")),
    Column(
        lambda row: row[1]["von_mises_mpa"], "von Mises [MPa]", ">von Mises MPa", "von Mises [MPa]"
    ),
    Column(
        lambda row: row[1]["stress_jump"],
        "stress jump",
        ">stress jump",
        "Jump between elements",
        show=show_percent,
    ),
)


def _decay(row: tuple[int, PoleSummary]) -> Cell:
    real = row[1]["real"]
    return "grows" if real > 0.0 else "never" if real == 0.0 else -1e3 / real


POLE_COLUMNS: tuple[Column[tuple[int, PoleSummary]], ...] = (
    Column(lambda row: row[0], screen=">no.", report="No."),
    Column(
        lambda row: row[1]["frequency_hz"],
        file="frequency [Hz]",
        screen=">Hz",
        report="Hz",
        show=lambda hz: f"{hz:.3f}" if hz else "0",
    ),
    Column(
        lambda row: row[1]["damping_ratio"],
        "damping ratio",
        ">damping",
        "Damping",
        show=show_damping,
    ),
    Column(_decay, screen=">decays in ms"),
    Column(lambda row: row[1]["real"], "real [rad/s]"),
    Column(lambda row: row[1]["imag"], "imaginary [rad/s]"),
    Column(lambda row: row[1]["drive"], "drive", "drive", "Drive"),
    Column(lambda row: row[1]["name"], "motion", "motion", "Motion"),
)


def _margin(
    key: Literal["bandwidth_hz", "gain", "phase_deg", "sensitivity"], screen: str, report: str
) -> Column[tuple[str, DriveSummary]]:
    return Column(
        lambda row: row[1]["margins"][key] if row[1]["margins"] else None,
        screen=screen,
        report=report,
    )


DRIVE_COLUMNS: tuple[Column[tuple[str, DriveSummary]], ...] = (
    Column(lambda row: row[0], screen="drive", report="Drive"),
    Column(lambda row: row[1]["encoder"], screen="encoder", report="Position from"),
    Column(lambda row: row[1]["kv_per_s"], screen=">kv 1/s", report="kv [1/s]"),
    Column(lambda row: row[1]["velocity_gain_n_s_per_m"], screen=">kp N s/m", report="kp [N s/m]"),
    Column(lambda row: row[1]["motor_mass_kg"], screen=">motor kg"),
    Column(lambda row: 1e3 * row[1]["dead_time_s"], report="Dead time [ms]", digits=3),
    Column(lambda row: row[1]["velocity_lag_um"], screen=">lag µm", report="Lag [µm]"),
    _margin("bandwidth_hz", ">bandwidth Hz", "Bandwidth [Hz]"),
    _margin("gain", ">gain margin", "Gain margin"),
    _margin("phase_deg", ">phase margin °", "Phase margin [°]"),
    _margin("sensitivity", ">max |S|", "Largest |S|"),
)


def list_channels(response: ResponseSummary) -> list[DrivePointSummary]:
    """Ports of forces: those of moments are in files only."""
    return [channel for channel in response["drive_points"] if "static_um_per_kN" in channel]


def _show_four(value: float) -> str:
    return show_digits(value, 4)


DRIVE_POINT_COLUMNS: tuple[Column[DrivePointSummary], ...] = (
    Column(lambda row: " ".join(row["dof"]), screen="force at", report="Force and motion"),
    Column(
        lambda row: row["static_um_per_kN"],
        screen=">static µm/kN",
        report="static [µm/kN]",
        show=_show_four,
        missing="free",
    ),
    Column(
        lambda row: row["most_negative_real_um_per_kN"],
        screen=">min. Re µm/kN",
        report="most negative real part [µm/kN]",
        show=_show_four,
        error=lambda row: row.get("most_negative_real_error_um_per_kN"),
    ),
    Column(
        lambda row: row["most_negative_real_hz"], screen=">at Hz", report="at [Hz]", show=_show_four
    ),
    Column(
        lambda row: row["chatter_limit_N_per_um"],
        screen=">-1/(2 Re) N/µm",
        report="chatter limit −1/(2 Re) [N/µm]",
        show=_show_four,
    ),
    Column(
        lambda row: row["minimum_dynamic_stiffness_N_per_um"],
        screen=">min. N/µm",
        report="minimum dynamic stiffness [N/µm]",
        show=_show_four,
    ),
    Column(
        lambda row: row["minimum_dynamic_stiffness_hz"],
        screen=">at Hz",
        report="at [Hz]",
        show=_show_four,
    ),
    Column(
        lambda row: row["minimum_dynamic_stiffness_mode"], screen="near mode", report="near mode"
    ),
    Column(
        lambda row: row["truncation_share"], report="missed by a plain modal sum", show=show_percent
    ),
)


type MovedRow = tuple[str, MovedOutputSummary]
MOVED_UNITS = {"um": "µm", "urad": "µrad"}


def list_moved(transient: TransientSummary) -> list[MovedRow]:
    """Outputs of a transient analysis by name."""
    return list(transient["outputs"].items())


def _settled(row: MovedRow) -> Cell:
    found = row[1]
    if found["settling_s"] is not None:
        return 1e3 * found["settling_s"]
    return "at rest" if found["peak"] == 0.0 else "never" if found["final"] is None else "later"


MOVED_COLUMNS: tuple[Column[MovedRow], ...] = (
    Column(lambda row: row[0], "at", "at", "At"),
    Column(lambda row: MOVED_UNITS[row[1]["unit"]], "unit", "in", "In"),
    Column(
        lambda row: row[1]["peak"],
        "peak",
        ">peak",
        "Peak",
        error=lambda row: row[1]["error"] if row[1]["peak"] else None,
    ),
    Column(lambda row: row[1]["error"], "± peak"),
    Column(lambda row: 1e3 * row[1]["peak_s"], "at [ms]", ">at ms", "at [ms]"),
    Column(lambda row: row[1]["start"], "from", report="From"),
    Column(lambda row: row[1]["final"], "final", ">final", "Comes to rest at"),
    Column(
        lambda row: row[1]["overshoot"], "overshoot", ">overshoot", "Overshoot", show=show_percent
    ),
    Column(_settled, "settled after [ms]", ">settled after ms", "Settled after [ms]"),
)


class ZoneRow(NamedTuple):
    """What a path analysis says of an output while a ramp lasts; sizes in µm or µrad."""

    run: FeedSummary
    channel: list[str]
    zone: str
    found: ZoneSummary

    def size(self, name: str) -> float | None:
        """One of its sizes, by its name without the unit."""
        return self.found[f"{name}_{deviation_unit((self.channel[0], self.channel[1]))[0]}"]


def list_zones(path: PathSummary, output: int | None = None) -> list[ZoneRow]:
    """Every feed, output and ramp of a path analysis; of one output where its number is given."""
    return [
        ZoneRow(run, shown["dof"], zone, found)
        for run in path["feeds"]
        for number, shown in enumerate(run["outputs"])
        if output in (None, number)
        for zone, found in (
            ("accelerating", shown["accelerating"]),
            ("decelerating", shown["decelerating"]),
        )
    ]


ZONE_COLUMNS: tuple[Column[ZoneRow], ...] = (
    Column(lambda row: row.run["name"], screen="feed", report="Feed"),
    Column(lambda row: " ".join(row.channel), screen="<at"),
    Column(lambda row: row.zone, screen="<zone", report="Zone"),
    Column(lambda row: row.run["acceleration"], report="Acceleration [m/s²]", digits=3),
    Column(lambda row: row.size("peak"), screen=">peak", report="Peak"),
    Column(lambda row: row.found["peak_s"], screen=">at s", report="at [s]"),
    Column(lambda row: row.size("span"), screen=">span", report="Peak to peak"),
    Column(lambda row: row.size("quasi_static"), screen=">static", report="Quasi-static"),
    Column(
        lambda row: row.size("dynamic"),
        screen=">vibration",
        report=PART_NAMES["dynamic"].capitalize(),
    ),
    Column(lambda row: row.size("rms"), report="rms"),
    Column(
        lambda row: row.found["settling_s"],
        screen=">settles",
        report="below 5 % after [s]",
        digits=3,
        missing="never",
    ),
    Column(lambda row: row.size("frozen_peak"), screen=">frozen pose", report="Peak, frozen pose"),
)


class CruiseRow(NamedTuple):
    """An output of a path at constant feed."""

    run: FeedSummary
    channel: Sequence[str]
    found: CruiseSummary


def list_cruises(path: PathSummary, output: int | None = None) -> list[CruiseRow]:
    """Every feed and output of a path on which errors of guides act; of one output where its number
    is given.
    """
    return [
        CruiseRow(run, shown["dof"], shown["cruising"])
        for run in path["feeds"]
        for number, shown in enumerate(run["outputs"])
        if output in (None, number) and "cruising" in shown
    ]


CRUISE_COLUMNS: tuple[Column[CruiseRow], ...] = (
    Column(lambda row: row.run["name"], screen="feed", report="Feed"),
    Column(lambda row: " ".join(row.channel), screen="<at"),
    Column(
        lambda row: row.found["variation_um"],
        screen=">variation",
        report="Variation",
        show=show_deviation,
    ),
    Column(
        lambda row: row.found["straightness_um"],
        screen=">straightness",
        report="Straightness",
        show=show_deviation,
    ),
    Column(
        lambda row: row.found["amplitude_um"],
        screen=">wave of",
        report="Strongest wave",
        show=show_deviation,
    ),
    Column(lambda row: row.found["period_s"], screen=">period s", report="Period [s]", digits=3),
    Column(lambda row: row.found["period_mm"], screen=">mm", report="Period [mm]", digits=3),
)


def static_by_pose(summary: RunSummary) -> dict[str, dict[str, PointSummary]]:
    """Pose to point to compliance; a summary of one pose names it nowhere but in its stages."""
    if "static_poses" in summary:
        return summary["static_poses"]
    if not summary["static"]:
        return {}
    poses = [row["pose"] or "reference" for row in summary["stages"] if row["stage"] == "static"]
    return {(poses or ["reference"])[0]: summary["static"]}


def shared_budget(point: PointSummary) -> dict[str, dict[str, float]]:
    """The budget of a point; empty where one part alone gives way, which says nothing."""
    budget = point["budget"]
    return budget if any(len(shares) > 1 for shares in budget.values()) else {}


def sort_shares(shares: Mapping[str, float]) -> list[tuple[str, float]]:
    """Shares, largest first; what symmetry makes equal goes by name, whatever the roundoff."""
    return sorted(shares.items(), key=lambda item: (-round(item[1], 6), item[0]))


def merge_families(shares: Mapping[str, float]) -> dict[str, float]:
    """Shares of parts whose names differ by a number, such as the carriages of a guide, together."""
    return {
        family: sum(shares[name] for name in members)
        for family, members in name_families(shares).items()
    }


def top_shares(shares: Mapping[str, float], count: int, least: float) -> list[tuple[str, float]]:
    """The largest shares, at most so many.

    Args:
        shares: Name to share.
        count: How many there may be.
        least: Share below which one is not named.
    """
    return [item for item in sort_shares(shares)[:count] if item[1] >= least]


@dataclass(frozen=True)
class ModeRow:
    """A natural mode as a row: unrounded, None where it is not known; a damped frequency of zero is
    an overdamped mode.
    """

    number: int
    rigid: bool
    hz: float
    error_hz: float | None
    damped_hz: float | None
    damped_error_hz: float | None
    damping_ratio: float | None
    damping_error: float | None
    name: str
    energy_share: dict[str, float]
    spread_hz: tuple[float, float] | None


def list_modes(modes: ModesSummary) -> list[ModeRow]:
    """The modes of a pose, from the lowest or from the first in a window of frequencies."""
    below = modes.get("modes_below", 0)
    spreads = modes.get("interface_spread_hz") or [None] * len(modes["frequencies_hz"])
    return [
        ModeRow(
            number=below + place + 1,
            rigid=place < modes["rigid_count"],
            hz=hz,
            error_hz=modes["error_hz"][place],
            damped_hz=modes["damped_hz"][place],
            damped_error_hz=modes["damped_error_hz"][place],
            damping_ratio=modes["damping_ratio"][place],
            damping_error=modes["damping_error"][place],
            name=modes["mode_names"][place],
            energy_share=modes["energy_share"][place],
            spread_hz=spreads[place],
        )
        for place, hz in enumerate(modes["frequencies_hz"])
    ]


class LobeRow(NamedTuple):
    """A lobe of a direction of travel in a pose."""

    pose: str
    direction: DirectionSummary
    lobe: LobeSummary


def list_lowest_lobes(lobes: Mapping[str, LobesSummary]) -> list[LobeRow]:
    """The lowest limit of every pose and direction of travel."""
    return [
        LobeRow(pose, direction, direction["lowest"])
        for pose, found in lobes.items()
        for direction in found["directions"]
        if direction["lowest"] is not None
    ]


def _show_speed(value: float) -> str:
    return f"{value:.0f}"


def _tell_best(direction: DirectionSummary) -> str | None:
    best = direction["best_speeds"][:1]
    return f"{best[0]['limit_depth_mm']:.3g} at {best[0]['rpm']:.0f}" if best else None


def _tell_checks(direction: DirectionSummary) -> str:
    if direction["checks"]:
        confirmed = sum(check["confirmed"] for check in direction["checks"])
        return f"{confirmed} of {len(direction['checks'])}"
    return "bisected" if direction["bisected"] else "none"


LOWEST_LOBE_COLUMNS: tuple[Column[LobeRow], ...] = (
    Column(lambda row: row.pose, screen="pose", report="Pose"),
    Column(lambda row: row.direction["name"], screen="<travel", report="Travel"),
    Column(
        lambda row: row.lobe["limit_depth_mm"],
        screen=">lowest mm",
        report="Lowest limit [mm]",
        digits=3,
    ),
    Column(
        lambda row: row.lobe["rpm"],
        screen=">at rpm",
        report="at [rpm]",
        show=_show_speed,
    ),
    Column(
        lambda row: row.lobe["chatter_hz"], screen=">chatter Hz", report="Chatter [Hz]", digits=4
    ),
    Column(lambda row: row.lobe["mode"], screen="<mode", report="Mode"),
    Column(lambda row: row.lobe["part"], report="Part"),
    Column(
        lambda row: _tell_best(row.direction), screen="<best mm, rpm", report="Best [mm at rpm]"
    ),
    Column(lambda row: _tell_checks(row.direction), report="Limits confirmed"),
)
LOBE_COLUMNS: tuple[Column[LobeRow], ...] = (
    Column(lambda row: row.pose, "pose"),
    Column(lambda row: row.direction["name"], "travel", report="Travel"),
    Column(lambda row: row.lobe["waves"], "waves", report="Waves"),
    Column(lambda row: row.lobe["from_rpm"], "from [rpm]", report="from [rpm]", show=_show_speed),
    Column(lambda row: row.lobe["to_rpm"], "to [rpm]", report="to [rpm]", show=_show_speed),
    Column(
        lambda row: row.lobe["limit_depth_mm"],
        "lowest limit [mm]",
        report="Lowest limit [mm]",
        digits=3,
    ),
    Column(lambda row: row.lobe["rpm"], "at [rpm]", report="at [rpm]", show=_show_speed),
    Column(lambda row: row.lobe["chatter_hz"], "chatter [Hz]", report="Chatter [Hz]"),
    Column(lambda row: row.lobe["mode"], "mode", report="Mode"),
    Column(lambda row: row.lobe["mode_hz"], "mode [Hz]", report="Mode [Hz]"),
    Column(
        lambda row: row.lobe["mode_share"], "share of the motion", report="Share", show=show_percent
    ),
    Column(lambda row: row.lobe["part"], "part", report="Part"),
)


def list_lobes(pose: str, found: LobesSummary, most: int | None = None) -> list[LobeRow]:
    """Lobes of a pose, direction by direction, rising in speed.

    Args:
        pose: Its name.
        found: Its lobes.
        most: The widest so many of each direction only.
    """
    rows = []
    for direction in found["directions"]:
        lobes = direction["lobes"]
        if most is not None and len(lobes) > most:
            widest = sorted(lobes, key=lambda lobe: lobe["from_rpm"] - lobe["to_rpm"])[:most]
            lobes = sorted(widest, key=lambda lobe: lobe["from_rpm"])
        rows += [LobeRow(pose, direction, lobe) for lobe in lobes]
    return rows


def _limits_table(pose: str, found: LobesSummary) -> PlainTable:
    """A row per direction and speed."""
    rows = [
        (direction["name"], *values, None if lobe is None else direction["lobes"][lobe]["mode"])
        for direction in found["directions"]
        for *values, lobe in zip(
            direction["series"]["rpm"],
            direction["series"]["limit_depth_mm"],
            direction["series"]["zeroth_order_mm"],
            direction["series"]["chatter_hz"],
            direction["series"]["lobe"],
            strict=True,
        )
    ]
    headings = (
        "travel",
        "speed [rpm]",
        "limit depth [mm]",
        "zeroth order [mm]",
        "chatter [Hz]",
        "mode",
    )
    return PlainTable(f"limits_{file_stem(pose)}", headings, tuple(rows))


def list_tables(summary: RunSummary) -> list[PlainTable]:
    """Every table of a summary."""
    tables = [
        tabulate("components", COMPONENT_COLUMNS, summary["components"].items()),
        _stage_table(summary),
    ]
    for pose, points in static_by_pose(summary).items():
        for name, point in points.items():
            stem = f"{file_stem(pose)}_{file_stem(name)}"
            tables += [
                _compliance_table(f"compliance_{stem}", point),
                _whole_compliance_table(f"compliance_6x6_{stem}", point),
            ]
            tables.append(_budget_table(f"budget_{stem}", point["budget"]))
            if rows := list_displacements(point):
                tables.append(tabulate(f"displacement_{stem}", DEVIATION_COLUMNS, rows))
    tables += [_tabulate_modes(modes) for modes in summary["modal"]]
    for pose, probes in summary.get("probes", {}).items():
        tables.append(tabulate(f"probes_{file_stem(pose)}", PROBE_COLUMNS, probes.items()))
    if "model_errors" in summary:
        bodies = summary["model_errors"]["bodies"]
        tables.append(tabulate("model_errors", MODEL_COLUMNS, bodies.items()))
    if "interface_errors" in summary:
        joints = summary["interface_errors"]["joints"]
        tables.append(tabulate("interface_errors", JOINT_COLUMNS, joints.items()))
    if "contouring" in summary:
        contour = summary["contouring"]
        tables += [
            _contour_table(contour),
            tabulate("contour_faces", FACE_COLUMNS, list_faces(contour)),
        ]
        tables += [
            table for face in contour.get("milled_faces", []) for table in _profile_tables(face)
        ]
    for pose, control in summary.get("control", {}).items():
        tables.append(
            tabulate(
                f"poles_{file_stem(pose)}", POLE_COLUMNS, list(enumerate(control["poles"], start=1))
            )
        )
    for pose, found in summary.get("lobes", {}).items():
        tables.append(tabulate(f"lobes_{file_stem(pose)}", LOBE_COLUMNS, list_lobes(pose, found)))
        tables.append(_limits_table(pose, found))
    for pose, transient in summary.get("transient", {}).items():
        tables.append(tabulate(f"peaks_{file_stem(pose)}", MOVED_COLUMNS, list_moved(transient)))
    if "map" in summary:
        tables.append(_map_table("map", summary["map"]))
    for place, volume in summary.get("volumetric", {}).items():
        stem = file_stem(place)
        tables += [
            _map_table(f"volumetric_{stem}", volume),
            tabulate(f"error_motions_{stem}", LINE_COLUMNS, list_lines(volume)),
            _budget_table(f"volumetric_budget_{stem}", volume["budget"]),
        ]
    return tables


class FaceRow(NamedTuple):
    """A face of a contour: the gap beside it, and its profile where it has one."""

    face: int
    at: str
    gap: FaceSummary | None
    milled: MilledFaceSummary | None


def list_faces(found: ContourSummary) -> list[FaceRow]:
    """Faces of a contour in the order of the path."""
    gaps = {face["face"]: face for face in found["faces"]}
    milled = {face["face"]: face for face in found.get("milled_faces", [])}
    names = {number: face["at"] for number, face in (gaps | milled).items()}
    return [
        FaceRow(number, names[number], gaps.get(number), milled.get(number))
        for number in sorted(names)
    ]


def _of_milled(key: MilledKey) -> Callable[[FaceRow], float | None]:
    return lambda row: None if row.milled is None else row.milled[key]


def _tell_wave(row: FaceRow) -> str | None:
    if row.milled is None or row.milled["strongest_wave"]["amplitude_um"] < LEAST_WAVE_UM:
        return None
    wave = row.milled["strongest_wave"]
    return f"{wave['length_mm']:.3g} mm, {wave['amplitude_um']:.2g} µm"


FACE_COLUMNS: tuple[Column[FaceRow], ...] = (
    Column(lambda row: row.face, "face", screen=">face", report="Face"),
    Column(lambda row: row.at, "at", screen="<at", report="At"),
    Column(
        lambda row: None if row.gap is None else row.gap["outward_um"],
        "mean gap outward [um]",
        screen=">gap",
        report="Mean gap [µm]",
    ),
    Column(
        lambda row: None if row.gap is None else row.gap["outward_peak_to_peak_um"],
        "gap peak to peak [um]",
        screen=">ripple",
        report="peak to peak [µm]",
        digits=3,
    ),
    Column(
        _of_milled("location_error_um"),
        "location error [um]",
        screen=">location",
        report="Location error [µm]",
    ),
    Column(_of_milled("ra_um"), "Ra [um]", screen=">Ra", report="Ra [µm]", digits=3),
    Column(_of_milled("rz_um"), "Rz [um]", screen=">Rz", report="Rz [µm]", digits=3),
    Column(_of_milled("wt_um"), "Wt [um]", screen=">Wt", report="Wt [µm]", digits=3),
    Column(_of_milled("pt_um"), "Pt [um]", report="Pt [µm]", digits=3),
    Column(
        _of_milled("mark_at_start_um"),
        "mark at the start [um]",
        screen=">at start",
        report="Mark at start [µm]",
        digits=3,
    ),
    Column(
        _of_milled("mark_at_end_um"),
        "mark at the end [um]",
        screen=">at end",
        report="at end [µm]",
        digits=3,
    ),
    Column(_tell_wave, "strongest wave", report="Strongest wave"),
)


def contour_words(found: ContourSummary) -> str | None:
    """How the profiles were measured; None where there is none."""
    if not found.get("milled_faces"):
        return None
    face = found["milled_faces"][0]
    low, high = face["evaluated_mm"]
    by_height = [depth["location_error_um"] for depth in face["location_by_height"]]
    return (
        f"Profiles {face['height_mm']:.3g} mm above the end of the tool, ideal edges. Location error: mean, positive where material is left;"
        f" {min(by_height):.4g} to {max(by_height):.4g} µm over the depth of face {face['face']}. Ra, Rz, Wt (ISO 21920) over {high - low:.3g} mm, line"
        f" removed, Gaussian filter with a cut-off of {face['cut_off_mm']:.3g} mm. At start and end: mean line off the location error outside"
        f" that length. Cusps of a rigid machine: {face['rigid_cusp_um']:.3g} µm."
    )


def _profile_tables(face: MilledFaceSummary) -> list[PlainTable]:
    """Profile over the whole face in cells, and a short piece of it sample by sample."""
    profile, detail = face["profile"], face["detail"]
    return [
        PlainTable(
            f"profile_face_{face['face']}",
            ("along [mm]", "lowest [um]", "highest [um]", "mean line [um]"),
            tuple(
                zip(
                    profile["at_mm"],
                    profile["lowest_um"],
                    profile["highest_um"],
                    profile["waviness_um"],
                    strict=True,
                )
            ),
        ),
        PlainTable(
            f"profile_detail_face_{face['face']}",
            ("along [mm]", "height [um]"),
            tuple(zip(detail["at_mm"], detail["height_um"], strict=True)),
        ),
    ]


def _contour_table(found: ContourSummary) -> PlainTable:
    series, drives = found["series"], found["drives"]
    headings = [
        "time [s]",
        *(f"gap {d} [um]" for d in DIRECTIONS),
        *(f"force of {name} [N]" for name in drives),
    ]
    rows = [
        (time, *gap, *forces)
        for time, gap, forces in zip(
            series["time_s"], series["gap_um"], series["drive_force_n"], strict=True
        )
    ]
    if "motor_torque_nm" in series:
        headings += [f"torque of the motor of {name} [Nm]" for name in drives]
        rows = [
            (*row, *torques) for row, torques in zip(rows, series["motor_torque_nm"], strict=True)
        ]
    return PlainTable("contour", tuple(headings), tuple(rows))


def _map_table(stem: str, found: GridSummary) -> PlainTable:
    names = list(found["quantities"])
    flat = [_flatten(found["quantities"][name]) for name in names]
    rows = tuple(
        (*place, *values)
        for place, *values in zip(product(*found["positions"]), *flat, strict=True)
    )
    return PlainTable(stem, (*found["axes"], *names), rows)


def _flatten(values: Grid) -> list[float | None]:
    return [
        value for item in values for value in (_flatten(item) if isinstance(item, list) else [item])
    ]


def encode_csv(table: PlainTable) -> bytes:
    """A table as CSV (RFC 4180) in UTF-8. A text that a spreadsheet would take for a formula gets
    an apostrophe before it.
    """
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow(table.headings)
    writer.writerows([_cell(value) for value in row] for row in table.rows)
    return text.getvalue().encode()


def _cell(value: Cell) -> Cell:
    if isinstance(value, str) and value[:1] in ("=", "+", "-", "@", "\t", "\r"):
        return f"'{value}"
    return "" if value is None else value


def _stage_table(summary: RunSummary) -> PlainTable:
    headings = (
        "stage",
        "component",
        "pose",
        "seconds",
        "peak memory [MB]",
        "from the store",
        "reason",
    )
    rows = tuple(
        (
            row["stage"],
            row["component"],
            row["pose"],
            row["seconds"],
            row["peak_rss_mb"],
            row["cached"],
            row["reason"],
        )
        for row in summary["stages"]
    )
    return PlainTable("stages", headings, rows)


def _compliance_table(name: str, point: PointSummary) -> PlainTable:
    matrix = point["compliance_um_per_kN"]
    errors = point.get("error_um_per_kN", {})
    headings = (
        "force in",
        *(f"motion in {direction} [um/kN]" for direction in DIRECTIONS),
        "± along the force [um/kN]",
    )
    rows = (
        (
            d,
            *(matrix[row][column] for row in range(3)),
            bound_size(matrix[column][column], errors.get(d)),
        )
        for column, d in enumerate(DIRECTIONS)
    )
    return PlainTable(name, headings, tuple(rows))


def _whole_compliance_table(name: str, point: PointSummary) -> PlainTable:
    loads = [*(f"1 N in {d}" for d in DIRECTIONS), *(f"1 N m about {d}" for d in DIRECTIONS)]
    headings = (
        "load",
        *(f"motion in {d} [m]" for d in DIRECTIONS),
        *(f"rotation about {d} [rad]" for d in DIRECTIONS),
    )
    columns = zip(*point["compliance_6x6"], strict=True)
    return PlainTable(
        name, headings, tuple((load, *column) for load, column in zip(loads, columns, strict=True))
    )


def _budget_table(name: str, budget: Mapping[str, dict[str, float]]) -> PlainTable:
    parts = [part for part, _ in sort_shares(next(iter(budget.values()), {}))]
    return PlainTable(
        name,
        ("part", *budget),
        tuple((part, *(budget[d].get(part) for d in budget)) for part in parts),
    )


def _tabulate_modes(modes: ModesSummary) -> PlainTable:
    found = list_modes(modes)
    parts = sorted({part for row in found for part in row.energy_share})
    headings = (
        *(
            "mode",
            "frequency [Hz]",
            "± [Hz]",
            "damped frequency [Hz]",
            "± damped [Hz]",
            "damping ratio",
            "± damping ratio",
            "name",
        ),
        *(f"strain energy in {part}" for part in parts),
    )
    rows = tuple(
        (
            *(row.number, row.hz, bound_size(row.hz, row.error_hz)),
            *(row.damped_hz, bound_size(row.damped_hz, row.damped_error_hz)),
            *(row.damping_ratio, bound_size(row.damping_ratio, row.damping_error), row.name),
            *(row.energy_share.get(part) for part in parts),
        )
        for row in found
    )
    return PlainTable(f"modes_{file_stem(modes['pose_name'])}", headings, rows)


def tabulate_response(curves: ResponseCurves) -> PlainTable:
    """A row per frequency: real and imaginary part of every entry in SI, its error and the part of
    each source; empty where there is none.
    """
    values, errors, shares = curves.values, curves.value_errors, curves.value_error_share
    headings, columns = ["frequency [Hz]"], [curves.frequencies_hz]
    for row, output in enumerate(curves.outputs):
        for column, given in enumerate(curves.inputs):
            unit = response_unit_si(curves.motion, output, given)
            headings += [f"{part} {name_entry(output, given)} [{unit}]" for part in ("Re", "Im")]
            columns += [
                np.array(part, dtype=float)
                for part in (values[:, row, column].real, values[:, row, column].imag)
            ]
            if errors is not None:
                headings.append(f"± {name_entry(output, given)} [{unit}]")
                columns.append(np.array(errors[:, row, column], dtype=float))
            for source, share in shares.items():
                headings.append(f"± {source} {name_entry(output, given)} [{unit}]")
                columns.append(np.array(share[:, row, column], dtype=float))
    cells = tuple(
        tuple(None if math.isnan(value) else float(value) for value in row)
        for row in np.column_stack(columns)
    )
    return PlainTable(f"frf_{file_stem(curves.pose)}", tuple(headings), cells)


def path_stem(curves: PathCurves) -> str:
    """Name of a feed's files: ``path_3000``."""
    return f"path_{6e4 * curves.feed:g}".replace(".", "_").replace("+", "")


def transient_stem(curves: TransientCurves) -> str:
    """Name of a pose's files: ``transient_reference``."""
    return f"transient_{file_stem(curves.pose)}"


def tabulate_transient(curves: TransientCurves) -> PlainTable:
    """A row per sample: time, every load, and the displacement of every output."""
    headings, columns = ["time [s]"], [curves.times]
    for number, (name, unit) in enumerate(zip(curves.loads, curves.units, strict=True)):
        if not unit.endswith(" s"):  # an impulse has no value at a time
            headings.append(f"{name} [{unit}]")
            columns.append(curves.load_values[:, number])
    for number, channel in enumerate(curves.outputs):
        unit, factor = deviation_unit(channel)
        headings.append(f"{name_channel(channel)} [{unit}]")
        columns.append(factor * curves.displacements[:, number])
    return PlainTable(
        transient_stem(curves),
        tuple(headings),
        tuple(tuple(float(value) for value in row) for row in np.column_stack(columns)),
    )


def tabulate_path(curves: PathCurves) -> PlainTable:
    """A row per sample: time, set point, and the deviation of every output with its parts."""
    found = curves.deviation
    headings = ["time [s]", "position [mm]", "acceleration [m/s^2]"]
    columns = [found.times, 1e3 * curves.positions, curves.accelerations]
    for number, channel in enumerate(curves.outputs):
        unit, factor = deviation_unit(channel)
        for part, words in PART_NAMES.items():
            headings.append(f"{words} {name_channel(channel)} [{unit}]")
            columns.append(factor * getattr(found, part)[:, number])
        headings.append(f"deviation in the pose of the middle {name_channel(channel)} [{unit}]")
        columns.append(factor * curves.frozen[:, number])
    return PlainTable(
        path_stem(curves),
        tuple(headings),
        tuple(tuple(float(value) for value in row) for row in np.column_stack(columns)),
    )
