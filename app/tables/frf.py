"""Rows of frequency responses."""

from typing import Literal

import numpy as np

from headstock.app.tables.table import Column, PlainTable, show_percent, tabulate_curves
from headstock.app.texts.bounded_values import show_digits
from headstock.app.texts.curves import name_entry, response_unit_si
from headstock.geometry.frames import FloatArray
from headstock.pipeline.answers.frf import (
    DrivePointSummary,
    NumberSummary,
    ResponseCurves,
    ResponseSummary,
)
from headstock.pipeline.results.mode_files import file_stem


def list_channels(response: ResponseSummary) -> list[DrivePointSummary]:
    """Ports of forces: those of moments are in files only."""
    return [channel for channel in response["drive_points"] if "static_um_per_kN" in channel]


def _show_four(value: float) -> str:
    return show_digits(value, 4)


type PortKey = Literal[
    "most_negative_real_hz",
    "chatter_limit_N_per_um",
    "minimum_dynamic_stiffness_N_per_um",
    "minimum_dynamic_stiffness_hz",
]


def _of_port(key: PortKey, screen: str, report: str) -> Column[DrivePointSummary]:
    return Column(lambda row: row[key], screen=screen, report=report, show=_show_four)


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
    _of_port("most_negative_real_hz", ">at Hz", "at [Hz]"),
    _of_port("chatter_limit_N_per_um", ">-1/(2 Re) N/µm", "chatter limit −1/(2 Re) [N/µm]"),
    _of_port(
        "minimum_dynamic_stiffness_N_per_um", ">min. N/µm", "minimum dynamic stiffness [N/µm]"
    ),
    _of_port("minimum_dynamic_stiffness_hz", ">at Hz", "at [Hz]"),
    Column(
        lambda row: row["minimum_dynamic_stiffness_mode"], screen="near mode", report="near mode"
    ),
    Column(
        lambda row: row["truncation_share"], report="missed by a plain modal sum", show=show_percent
    ),
)


def list_numbers(response: ResponseSummary) -> list[NumberSummary]:
    """Peaks and levels of forces and translations: others are in files only."""
    return [number for number in response.get("peaks", []) if "size_um_per_kN" in number]


def _name_number(row: NumberSummary) -> str:
    kind = "static" if row["kind"] == "level" else "peak"
    return f"{kind} {' '.join(row['output'])} / {' '.join(row['input'])}"


def _share(row: NumberSummary) -> str:
    error = row["error_um_per_kN"]
    return "?" if error is None else show_percent(error / row["size_um_per_kN"])


NUMBER_COLUMNS: tuple[Column[NumberSummary], ...] = (
    Column(_name_number, screen="of", report="of"),
    Column(lambda row: row["hz"], screen=">at Hz", report="at [Hz]", show=_show_four),
    Column(
        lambda row: row["size_um_per_kN"],
        screen=">µm/kN",
        report="size [µm/kN]",
        show=_show_four,
        error=lambda row: row["error_um_per_kN"],
    ),
    Column(
        lambda row: 1e3 / row["size_um_per_kN"],
        screen=">N/µm",
        report="dynamic stiffness [N/µm]",
        show=_show_four,
    ),
    Column(
        _share,
        screen=">± of it",
        report="± of it",
    ),
)


def tabulate_response(curves: ResponseCurves) -> PlainTable:
    """Tabulate a row per frequency: real and imaginary part of every entry in SI, its error and the part of
    each source; empty where there is none.
    """
    values, errors, shares = curves.values, curves.value_errors, curves.value_error_share
    columns: list[tuple[str, FloatArray]] = [("frequency [Hz]", curves.frequencies_hz)]
    for row, output in enumerate(curves.outputs):
        for column, given in enumerate(curves.inputs):
            entry = (
                f"{name_entry(output, given)} [{response_unit_si(curves.motion, output, given)}]"
            )
            value = values[:, row, column]
            for part, size in (("Re", value.real), ("Im", value.imag)):
                columns.append((f"{part} {entry}", np.asarray(size, dtype=float)))
            if errors is not None:
                columns.append((f"± {entry}", errors[:, row, column]))
            columns += [
                (f"± {source} {entry}", share[:, row, column]) for source, share in shares.items()
            ]
    return tabulate_curves(f"frf_{file_stem(curves.pose)}", columns)
