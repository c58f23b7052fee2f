"""The tables of a summary as plain rows, for the report and for CSV files."""

import csv
import io
from dataclasses import dataclass
from itertools import product
from typing import Any

from headstock.app.texts.error_texts import bound_size
from headstock.pipeline.results.mode_files import file_stem
from headstock.pipeline.storage.json_texts import Json

DIRECTIONS = ("x", "y", "z")


@dataclass(frozen=True)
class PlainTable:
    """A table: the stem of its file, headings and rows; numbers unrounded."""

    name: str
    headings: tuple[str, ...]
    rows: tuple[tuple[Any, ...], ...]


def static_by_pose(summary: Json) -> dict[str, Json]:
    """Pose to point to compliance; a summary of one pose names it nowhere but in its stages."""
    if "static_poses" in summary:
        return dict(summary["static_poses"])
    if not summary["static"]:
        return {}
    pose = next((row["pose"] for row in summary["stages"] if row["stage"] == "static" and row.get("pose")), "reference")
    return {pose: summary["static"]}


def list_tables(summary: Json) -> list[PlainTable]:
    """Every table of a summary."""
    tables = [_component_table(summary), _stage_table(summary)]
    for pose, points in static_by_pose(summary).items():
        for name, point in points.items():
            stem = f"{file_stem(pose)}_{file_stem(name)}"
            tables += [_compliance_table(f"compliance_{stem}", point), _whole_compliance_table(f"compliance_6x6_{stem}", point)]
            tables.append(_budget_table(f"budget_{stem}", point["budget"]))
    tables += [_mode_table(modes) for modes in summary["modal"]]
    tables += [_probe_table(pose, probes) for pose, probes in summary.get("probes", {}).items()]
    if "contouring" in summary:
        tables.append(_contour_table(summary["contouring"]["series"]))
    tables += [_pole_table(pose, control) for pose, control in summary.get("control", {}).items()]
    if "map" in summary:
        tables.append(_map_table(summary["map"]))
    return tables


def _contour_table(series: Json) -> PlainTable:
    columns = [("gap_um", [f"gap {d} [um]" for d in DIRECTIONS]), ("leg_force_n", [f"force of leg {n} [N]" for n in (1, 2, 3)])]
    if "motor_torque_nm" in series:
        columns.append(("motor_torque_nm", [f"torque of motor {n} [Nm]" for n in (1, 2, 3)]))
    headings = ("time [s]", *(heading for _, names in columns for heading in names))
    rows = zip(series["time_s"], *(series[key] for key, _ in columns), strict=True)
    return PlainTable("contour", headings, tuple((time, *(value for part in parts for value in part)) for time, *parts in rows))


def _pole_table(pose: str, control: Json) -> PlainTable:
    keys = ("frequency_hz", "damping_ratio", "real", "imag", "drive", "name")
    headings = ("frequency [Hz]", "damping ratio", "real [rad/s]", "imaginary [rad/s]", "drive", "motion")
    return PlainTable(f"poles_{file_stem(pose)}", headings, tuple(tuple(pole[key] for key in keys) for pole in control["poles"]))


def _map_table(found: Json) -> PlainTable:
    names = list(found["quantities"])
    flat = [_flatten(found["quantities"][name], len(found["axes"])) for name in names]
    rows = tuple((*place, *values) for place, *values in zip(product(*found["positions"]), *flat, strict=True))
    return PlainTable("map", (*found["axes"], *names), rows)


def _flatten(values: list[Any], depth: int) -> list[Any]:
    return values if depth == 1 else [value for row in values for value in _flatten(row, depth - 1)]


def encode_csv(table: PlainTable) -> bytes:
    """A table as CSV (RFC 4180) in UTF-8. A text that a spreadsheet would take for a formula gets an apostrophe before it."""
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow(table.headings)
    writer.writerows([_cell(value) for value in row] for row in table.rows)
    return text.getvalue().encode()


def _cell(value: Any) -> Any:
    if isinstance(value, str) and value[:1] in ("=", "+", "-", "@", "\t", "\r"):
        return f"'{value}"
    return "" if value is None else value


def _component_table(summary: Json) -> PlainTable:
    headings = (
        "component",
        "fidelity",
        "dofs",
        "reduced dofs",
        "mass [kg]",
        "modes complete to [Hz]",
        "residual",
        "worst scaled Jacobian",
    )
    rows = tuple(
        (
            name,
            facts["fidelity"],
            facts["full_dofs"],
            facts["reduced_dofs"],
            facts["mass_kg"],
            facts["cutoff_hz"],
            facts["residual"],
            facts.get("mesh_quality", {}).get("minimum_scaled_jacobian"),
        )
        for name, facts in summary["components"].items()
    )
    return PlainTable("components", headings, rows)


def _stage_table(summary: Json) -> PlainTable:
    keys = ("stage", "component", "pose", "seconds", "peak_rss_mb", "cached", "reason")
    headings = ("stage", "component", "pose", "seconds", "peak memory [MB]", "from the store", "reason")
    return PlainTable("stages", headings, tuple(tuple(row.get(key) for key in keys) for row in summary["stages"]))


def _compliance_table(name: str, point: Json) -> PlainTable:
    matrix = point["compliance_um_per_kN"]
    errors = point.get("error_um_per_kN", {})
    headings = ("force in", *(f"motion in {direction} [um/kN]" for direction in DIRECTIONS), "± along the force [um/kN]")
    rows = (
        (d, *(matrix[row][column] for row in range(3)), bound_size(matrix[column][column], errors.get(d)))
        for column, d in enumerate(DIRECTIONS)
    )
    return PlainTable(name, headings, tuple(rows))


def _whole_compliance_table(name: str, point: Json) -> PlainTable:
    loads = [*(f"1 N in {d}" for d in DIRECTIONS), *(f"1 N m about {d}" for d in DIRECTIONS)]
    headings = ("load", *(f"motion in {d} [m]" for d in DIRECTIONS), *(f"rotation about {d} [rad]" for d in DIRECTIONS))
    columns = zip(*point["compliance_6x6"], strict=True)
    return PlainTable(name, headings, tuple((load, *column) for load, column in zip(loads, columns, strict=True)))


def _budget_table(name: str, budget: Json) -> PlainTable:
    parts = [part for part, _ in sort_shares(next(iter(budget.values()), {}))]
    return PlainTable(name, ("part", *budget), tuple((part, *(budget[d].get(part) for d in budget)) for part in parts))


def _mode_table(modes: Json) -> PlainTable:
    parts = sorted({part for shares in modes["energy_share"] for part in shares})
    headings = [
        "mode",
        "frequency [Hz]",
        "± [Hz]",
        "damped frequency [Hz]",
        "± damped [Hz]",
        "damping ratio",
        "± damping ratio",
        "name",
    ]
    keys = (
        "frequencies_hz",
        "error_hz",
        "damped_hz",
        "damped_error_hz",
        "damping_ratio",
        "damping_error",
        "mode_names",
        "energy_share",
    )
    rows = tuple(
        (
            number,
            hz,
            bound_size(hz, error),
            damped,
            bound_size(damped, damped_error),
            damping,
            bound_size(damping, damping_error),
            name,
            *(shares.get(part) for part in parts),
        )
        for number, (hz, error, damped, damped_error, damping, damping_error, name, shares) in enumerate(
            zip(*(modes[key] for key in keys), strict=True), start=1
        )
    )
    headings += [f"strain energy in {part}" for part in parts]
    return PlainTable(f"modes_{file_stem(modes['pose_name'])}", tuple(headings), rows)


def _probe_table(pose: str, probes: Json) -> PlainTable:
    pairs = ("xx", "yy", "zz", "xy", "xz", "yz")
    moved = tuple(f"displacement {d} [um]" for d in DIRECTIONS)
    headings = ("probe", "component", *moved, *(f"stress {pair} [MPa]" for pair in pairs), "von Mises [MPa]", "stress jump")
    rows = tuple(
        (
            name,
            probe["component"],
            *probe["displacement_um"],
            *(probe["stress_mpa"][pair] for pair in pairs),
            probe["von_mises_mpa"],
            probe["stress_jump"],
        )
        for name, probe in probes.items()
    )
    return PlainTable(f"probes_{file_stem(pose)}", headings, rows)


def sort_shares(shares: dict[str, float]) -> list[tuple[str, float]]:
    """Shares, largest first; what symmetry makes equal goes by name, whatever the roundoff."""
    return sorted(shares.items(), key=lambda item: (-round(item[1], 6), item[0]))
