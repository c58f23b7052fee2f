"""Rows of frequency responses."""

from typing import NamedTuple

import numpy as np

from headstock.app.tables.table import Column, PlainTable, show_percent, tabulate_curves
from headstock.app.texts.bounded_values import show_digits
from headstock.app.texts.curves import name_entry, response_unit_si
from headstock.geometry.frames import FloatArray
from headstock.pipeline.answers.frf import DrivePointFigures, PoseResponse, ResponseCurves
from headstock.pipeline.answers.static import N_PER_UM, UM_PER_KN
from headstock.pipeline.numbers.estimates import scale_known, scale_total
from headstock.pipeline.results.mode_files import file_stem
from headstock.solvers.pairing.response_peaks import ResponseLevel


class _DrivePointRow(NamedTuple):
    """What the response at a drive point says about cutting, and ± of its most negative real part."""

    figures: DrivePointFigures
    error: float | None


def list_drive_points(response: PoseResponse) -> list[_DrivePointRow]:
    """Drive points of forces: those of moments are in files only."""
    return [
        _DrivePointRow(
            figures, scale_total(response.error_of(response.figure_key(figures.channel)), UM_PER_KN)
        )
        for figures in response.figures
        if figures.channel[1] in "xyz"
    ]


def _show_four(value: float) -> str:
    return show_digits(value, 4)


def _of_figures(
    name: str, screen: str, report: str, factor: float = 1.0, missing: str = ""
) -> Column[_DrivePointRow]:
    return Column(
        lambda row: scale_known(getattr(row.figures, name), factor),
        screen=screen,
        report=report,
        show=_show_four,
        missing=missing,
    )


DRIVE_POINT_COLUMNS: tuple[Column[_DrivePointRow], ...] = (
    Column(lambda row: " ".join(row.figures.channel), screen="force at", report="Force and motion"),
    _of_figures("static", ">static µm/kN", "static [µm/kN]", UM_PER_KN, missing="free"),
    Column(
        lambda row: scale_known(row.figures.most_negative_real, UM_PER_KN),
        screen=">min. Re µm/kN",
        report="most negative real part [µm/kN]",
        show=_show_four,
        error=lambda row: row.error,
    ),
    _of_figures("most_negative_real_hz", ">at Hz", "at [Hz]"),
    _of_figures("chatter_limit", ">-1/(2 Re) N/µm", "chatter limit −1/(2 Re) [N/µm]", N_PER_UM),
    _of_figures(
        "minimum_dynamic_stiffness", ">min. N/µm", "minimum dynamic stiffness [N/µm]", N_PER_UM
    ),
    _of_figures("minimum_dynamic_stiffness_hz", ">at Hz", "at [Hz]"),
    Column(
        lambda row: row.figures.minimum_dynamic_stiffness_mode,
        screen="near mode",
        report="near mode",
    ),
    Column(
        lambda row: row.figures.truncation_share,
        report="missed by a plain modal sum",
        show=show_percent,
    ),
)


class _HeightRow(NamedTuple):
    """A peak or level [um/kN] of an entry of a response, and its ±."""

    name: str
    hz: float
    size: float
    error: float | None


def list_heights(response: PoseResponse) -> list[_HeightRow]:
    """Peaks and levels of forces and translations: others are in files only."""
    curves, rows = response.curves, []
    for height in response.heights:
        output, given = curves.outputs[height.output], curves.inputs[height.given]
        if output[1] in "xyz" and given[1] in "xyz":
            kind = "static" if isinstance(height, ResponseLevel) else "peak"
            error = scale_total(response.error_of(response.key(height)), UM_PER_KN)
            name = f"{kind} {name_entry(output, given)}"
            rows.append(_HeightRow(name, height.hz, UM_PER_KN * height.height, error))
    return rows


def _share(row: _HeightRow) -> str:
    return "?" if row.error is None else show_percent(row.error / row.size)


HEIGHT_COLUMNS: tuple[Column[_HeightRow], ...] = (
    Column(lambda row: row.name, screen="of", report="of"),
    Column(lambda row: row.hz, screen=">at Hz", report="at [Hz]", show=_show_four),
    Column(
        lambda row: row.size,
        screen=">µm/kN",
        report="size [µm/kN]",
        show=_show_four,
        error=lambda row: row.error,
    ),
    Column(
        lambda row: 1e3 / row.size,
        screen=">N/µm",
        report="dynamic stiffness [N/µm]",
        show=_show_four,
    ),
    Column(_share, screen=">± of it", report="± of it"),
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
