"""Rows of a volumetric map."""

from typing import NamedTuple

from headstock.app.tables.static import DeviationRow
from headstock.app.tables.table import Column, show_deviation
from headstock.geometry.machine.machine import show_position
from headstock.pipeline.answers.volumetric import (
    SYMBOLS,
    TOTAL,
    AxisMotionsSummary,
    SquarenessSummary,
    VolumetricSummary,
)


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
