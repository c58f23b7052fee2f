"""Position errors of points over a volume of poses, and quantities of a mechanism over its workspace."""

import math
from collections.abc import Iterator, Mapping
from itertools import product
from typing import NamedTuple

from headstock.app.drawings.figures import draw_budget, draw_map, map_layers
from headstock.app.drawings.volumetric import draw_motions, draw_volume, list_maps
from headstock.app.tables.static import (
    DEVIATION_COLUMNS,
    DeviationRow,
    merge_families,
    tabulate_budget,
)
from headstock.app.tables.table import Column, Listing, PlainTable, show_deviation, tabulate
from headstock.app.texts.bounded_values import NO_BOUND, show_bound, show_bounded
from headstock.app.views.view import FinishedRun, Section, Shares, TerminalPart, View
from headstock.geometry.machine.machine import show_position
from headstock.pipeline.answers.map import Grid, GridSummary
from headstock.pipeline.answers.volumetric import (
    SYMBOLS,
    TOTAL,
    AxisMotionsSummary,
    SquarenessSummary,
    VolumetricSummary,
)
from headstock.pipeline.results.mode_files import file_stem


def _tabulate_map(stem: str, found: GridSummary) -> PlainTable:
    """Tabulate a row per pose with every quantity."""
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


MAP_VIEW = View(
    tables=lambda run: [_tabulate_map("map", run.summary["map"])],
    section=Section(
        "map",
        "Workspace map",
        template="views/map.html",
        names={"draw_map": draw_map, "map_layers": map_layers},
    ),
)


def _list_ranges(found: VolumetricSummary) -> list[DeviationRow]:
    """Ranges of the position error over a volume: of each source, then of all together."""
    rows = [
        DeviationRow(
            "all together" if source == TOTAL else source,
            [1e-6 * ranges[symbol] for symbol in SYMBOLS],
            _list_errors(found["range_errors"][source]),
        )
        for source, ranges in found["ranges"].items()
    ]
    # one source alone is all there is
    return rows[1:] + rows[:1] if len(rows) > 2 else rows[1:]


def _list_errors(errors: Mapping[str, float | None]) -> list[float]:
    """How far numbers may be off, in the order of the symbols; empty where nothing is known."""
    if all(error is None for error in errors.values()):
        return []
    return [math.nan if error is None else 1e-6 * error for error in errors.values()]


class _LineRow(NamedTuple):
    """Deviations of the error motions along one axis."""

    axis: str
    line: AxisMotionsSummary


def _list_lines(found: VolumetricSummary) -> list[_LineRow]:
    """The axes of a volumetric map."""
    return [_LineRow(axis, line) for axis, line in found["lines"].items()]


def _line_column(dof: int) -> Column[_LineRow]:
    symbol = SYMBOLS[dof]
    unit = "um" if dof < 3 else "urad"
    shown = f"{symbol} [{'µm' if dof < 3 else 'µrad'}]"

    def error(row: _LineRow) -> float | None:
        errors = _list_errors(row.line["errors"])
        still = show_deviation(row.line["deviations"][symbol]) == "0"
        return None if still or not errors else 1e6 * errors[dof]

    return Column(
        lambda row: row.line["deviations"][symbol],
        f"{symbol} [{unit}]",
        f">{shown}",
        shown,
        show=show_deviation,
        error=error,
    )


def _line_error(dof: int) -> Column[_LineRow]:
    symbol = SYMBOLS[dof]
    return Column(
        lambda row: row.line["errors"][symbol], f"± {symbol} [{'um' if dof < 3 else 'urad'}]"
    )


LINE_COLUMNS: tuple[Column[_LineRow], ...] = (
    Column(lambda row: row.axis, "axis", "axis", "Axis"),
    *(_line_column(dof) for dof in range(6)),
    *(_line_error(dof) for dof in range(6)),
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
        error=lambda row: row["error_urad"] if show_deviation(row["angle_urad"]) != "0" else None,
    ),
)


def _volumetric_words(found: VolumetricSummary) -> list[str]:
    """The largest error of a volume and where it is; where its ± comes from, and what is not in it."""
    place = ", ".join(
        f"{axis} = {show_position(position, found['units'][axis])}"
        for axis, position in found["largest_at"].items()
    )
    size, error = found["largest_um"], found["largest_error_um"]
    left_out = "; ".join(found["error_left_out"])
    if error is None:
        words = f"largest position error {size:.4g} µm {NO_BOUND} at {place}"
        return [words, *([f"{NO_BOUND} : nothing is known of {left_out}"] if left_out else [])]
    shown = f"{show_bounded(size, error)} {show_bound(size, error)}"
    largest = {
        symbol: max(
            ((own, name, source) for source, parts in each.items() for name, own in parts.items()),
            default=(0.0, "", ""),
        )
        for symbol, each in found["error_parts"].items()
    }
    most = max(largest, key=lambda symbol: largest[symbol][0])
    own, name, source = largest[most]
    told = [f"largest position error {shown} µm at {place}"]
    if own > 0.0:
        unit = "µm" if SYMBOLS.index(most) < 3 else "µrad"
        told.append(
            f"± covers 95 % of errors by meshes; most by {name}: {source}, {own:.2g} {unit} of the range of {most}"
        )
    return told + ([f"not in ±: {left_out}"] if left_out else [])


def _list_tables(run: FinishedRun) -> Iterator[PlainTable]:
    for point, volume in run.summary["volumetric"].items():
        stem = file_stem(point)
        yield _tabulate_map(f"volumetric_{stem}", volume)
        yield tabulate(f"error_motions_{stem}", LINE_COLUMNS, _list_lines(volume))
        yield tabulate_budget(f"volumetric_budget_{stem}", volume["budget"])


def _list_parts(run: FinishedRun) -> Iterator[TerminalPart]:
    for point, volume in run.summary["volumetric"].items():
        title = f"Position error of {point} over {' × '.join(volume['axes'])}: range by source"
        yield Listing(title, DEVIATION_COLUMNS, _list_ranges(volume))
        yield from (f"  {words}" for words in _volumetric_words(volume))
        yield ""
        title = "Error motions along each axis: straightness, positioning, angles"
        yield Listing(title, LINE_COLUMNS, _list_lines(volume))
        if volume["squareness"]:
            yield Listing("Squareness", SQUARENESS_COLUMNS, volume["squareness"])
        for direction, shares in volume["budget"].items():
            yield Shares(direction, merge_families(shares))
        yield ""


VIEW = View(
    tables=_list_tables,
    terminal=_list_parts,
    section=Section(
        "volumetric",
        "Volumetric errors",
        template="views/volumetric.html",
        names={
            "columns": {
                "deviations": DEVIATION_COLUMNS,
                "lines": LINE_COLUMNS,
                "squareness": SQUARENESS_COLUMNS,
            },
            "draw_budget": draw_budget,
            "draw_map": draw_map,
            "draw_motions": draw_motions,
            "draw_volume": draw_volume,
            "list_lines": _list_lines,
            "list_maps": list_maps,
            "list_ranges": _list_ranges,
            "map_layers": map_layers,
            "merge_families": merge_families,
            "volumetric_words": _volumetric_words,
        },
    ),
)
