"""Position errors of points over a volume of poses, and quantities of a mechanism over its workspace."""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np

from headstock.app.drawings.figures import draw_budget, draw_map, map_layers
from headstock.app.drawings.volumetric import draw_motions, draw_volume, list_maps
from headstock.app.tables.static import (
    DEVIATION_COLUMNS,
    DeviationRow,
    tabulate_budget,
)
from headstock.app.tables.table import (
    Column,
    Listing,
    NumbersRow,
    PlainTable,
    show_deviation,
    tabulate,
)
from headstock.app.texts.bounded_values import NO_BOUND, left_out_words, show_bound, show_bounded
from headstock.app.views.view import Section, Shares, TerminalPart, View
from headstock.geometry.machine.machine import show_position
from headstock.pipeline.answers.map import PoseGrid, WorkspaceMap
from headstock.pipeline.answers.volumetric import (
    MICRO,
    SYMBOLS,
    TOTAL,
    VolumetricAnswer,
    largest_key,
    range_key,
    squareness_key,
)
from headstock.pipeline.numbers.estimates import scale_parts, scale_total
from headstock.pipeline.results.mode_files import file_stem
from headstock.pipeline.results.results import Results
from headstock.pipeline.storage.json_texts import find_known
from headstock.solvers.linear.volumetric import Squareness, measure_range

MOST_LINES = 256  # of a file of LinuxCNC


def _tabulate_map(stem: str, found: PoseGrid) -> PlainTable:
    """Tabulate a row per pose with every quantity."""
    columns = [map(find_known, values.ravel()) for values in found.quantities.values()]
    places = product(*(map(float, positions) for positions in found.positions))
    rows = tuple((*place, *values) for place, *values in zip(places, *columns, strict=True))
    return PlainTable(stem, (*found.axes, *found.quantities), rows)


MAP_VIEW = View(
    tables=lambda run: [_tabulate_map("map", run.find(WorkspaceMap)[-1])],
    section=lambda run: Section(
        "map",
        "Workspace map",
        template="views/map.html",
        names={
            "map": run.find(WorkspaceMap)[-1],
            "draw_map": draw_map,
            "map_layers": map_layers,
        },
    ),
)


def _list_ranges(found: VolumetricAnswer) -> list[DeviationRow]:
    """Ranges of the position error over a volume: of each source, then of all together."""
    rows = [
        DeviationRow(
            "all together" if source == TOTAL else source,
            measure_range(values),
            _list_errors(
                found.error_of(range_key(found.point, source, each)).total for each in SYMBOLS
            ),
        )
        for source, values in found.grids.items()
    ]
    # one source alone is all there is
    return rows[1:] + rows[:1] if len(rows) > 2 else rows[1:]


def _list_errors(totals: Iterable[float | None]) -> list[float]:
    """How far numbers may be off, in the order of the symbols; empty where nothing is known."""
    errors = [math.nan if total is None else total for total in totals]
    return [] if all(map(math.isnan, errors)) else errors


@dataclass(frozen=True, eq=False)
class _LineRow(NumbersRow):
    """Deviations of the error motions along one axis."""

    axis: str


def _list_lines(found: VolumetricAnswer) -> list[_LineRow]:
    """The axes of a volumetric map."""
    numbers = found.index_numbers()
    return [
        _LineRow(numbers, {"point": found.point, "axis": line.axis}, line.axis)
        for line in found.lines
    ]


def _show_unless_zero(value: float | None, error: float | None) -> float | None:
    """Return ± of a deviation, which one that is written as zero has not."""
    return None if value is None or show_deviation(value) == "0" else error


def _line_column(dof: int) -> Column[_LineRow]:
    symbol, kind = SYMBOLS[dof], "line_deviation"
    shown = f"{symbol} [{'µm' if dof < 3 else 'µrad'}]"

    def error(row: _LineRow) -> float | None:
        errors = _list_errors(row.error(kind, component=each) for each in SYMBOLS)
        return _show_unless_zero(row.value(kind, component=symbol), errors[dof] if errors else None)

    return Column(
        lambda row: row.value(kind, component=symbol),
        f"{symbol} [{'um' if dof < 3 else 'urad'}]",
        f">{shown}",
        shown,
        show=show_deviation,
        error=error,
    )


def _line_error(dof: int) -> Column[_LineRow]:
    heading = f"± {SYMBOLS[dof]} [{'um' if dof < 3 else 'urad'}]"
    return Column(lambda row: row.error("line_deviation", component=SYMBOLS[dof]), heading)


LINE_COLUMNS: tuple[Column[_LineRow], ...] = (
    Column(lambda row: row.axis, "axis", "axis", "Axis"),
    *(_line_column(dof) for dof in range(6)),
    *(_line_error(dof) for dof in range(6)),
)


@dataclass(frozen=True, eq=False)
class _SquarenessRow(NumbersRow):
    """Squareness of two axes."""

    pair: Squareness


def _list_squareness(found: VolumetricAnswer) -> list[_SquarenessRow]:
    numbers = found.index_numbers()
    return [
        _SquarenessRow(numbers, dict(squareness_key(found.point, pair).at), pair)
        for pair in found.squareness
    ]


SQUARENESS_COLUMNS: tuple[Column[_SquarenessRow], ...] = (
    Column(lambda row: row.pair.symbol, "symbol", "symbol", "Symbol"),
    Column(
        lambda row: f"{row.pair.second} to {row.pair.first}",
        "squareness of",
        "squareness of",
        "Squareness of",
    ),
    Column(
        lambda row: row.value("squareness"),
        "angle [urad]",
        ">angle [µrad]",
        "Angle [µrad]",
        show=show_deviation,
        error=lambda row: _show_unless_zero(row.value("squareness"), row.error("squareness")),
    ),
)


def _volumetric_words(found: VolumetricAnswer) -> list[str]:
    """The largest error of a volume and where it is; where its ± comes from, and what is not in it."""
    largest_error, largest_at = found.find_largest()
    place = ", ".join(
        f"{axis} = {show_position(position, found.axis_units[axis])}"
        for axis, position in largest_at.items()
    )
    estimate = found.error_of(largest_key(found.point))
    size, error = MICRO * largest_error, scale_total(estimate, MICRO)
    if error is None:
        words = f"largest position error {size:.4g} µm {NO_BOUND} at {place}"
        return [words, *left_out_words(estimate.left_out, known=False)]
    shown = f"{show_bounded(size, error)} {show_bound(size, error)}"
    largest = {
        symbol: max(
            ((own, name, source) for source, parts in each.items() for name, own in parts.items()),
            default=(0.0, "", ""),
        )
        for symbol in SYMBOLS
        for each in [scale_parts(found.error_of(range_key(found.point, TOTAL, symbol)), MICRO)]
    }
    most = max(largest, key=lambda symbol: largest[symbol][0])
    own, name, source = largest[most]
    lines = [f"largest position error {shown} µm at {place}"]
    if own > 0.0:
        unit = "µm" if SYMBOLS.index(most) < 3 else "µrad"
        lines.append(
            f"± covers 95 % of errors by meshes; most by {name}: {source}, {own:.2g} {unit} of the range of {most}"
        )
    return lines + left_out_words(estimate.left_out)


def _tabulate_corrections(found: VolumetricAnswer) -> PlainTable:
    """Tabulate what brings the tool back in every pose: minus its error, with ± where it is known."""
    scales = {"m": ("mm", 1e3), "rad": ("deg", math.degrees(1.0))}
    units = [scales[found.axis_units[axis]] for axis in found.axes]
    shown = [f"{symbol} [{'um' if dof < 3 else 'urad'}]" for dof, symbol in enumerate(SYMBOLS)]
    headings = (
        *(f"{axis} [{unit}]" for axis, (unit, _) in zip(found.axes, units, strict=True)),
        *(f"correction {name}" for name in shown),
        *(f"± {name}" for name in shown),
    )
    positions = [
        [scale * float(value) for value in values]
        for (_, scale), values in zip(units, found.positions, strict=True)
    ]
    values = zip(found.total.reshape(-1, 6), found.grid_errors.reshape(-1, 6), strict=True)
    rows = tuple(
        (
            *place,
            *(find_known(-MICRO * float(size)) for size in moved),
            *(find_known(MICRO * float(size)) for size in bound),
        )
        for place, (moved, bound) in zip(product(*positions), values, strict=True)
    )
    return PlainTable(f"compensation_{file_stem(found.point)}", headings, rows)


def _encode_compensations(run: Results) -> dict[str, bytes]:
    """Return the file of LinuxCNC for each linear axis along x, y or z: nominal position, and where the
    axis really is going forward and back [mm], rising, at most 256 lines without comments.

    Source: LinuxCNC, ``usrmotLoadComp`` of the motion controller with ``COMP_FILE_TYPE = 0``.
    """
    files = {}
    for volume in run.find(VolumetricAnswer):
        for line in volume.lines:
            if line.along is None or np.isnan(line.motions[:, line.along]).any():
                continue
            sign = math.copysign(1.0, line.travel[line.along])
            count = min(len(line.positions), MOST_LINES)
            kept = np.unique(np.linspace(0, len(line.positions) - 1, count).round().astype(int))
            nominal = 1e3 * line.positions[kept]
            actual = nominal + 1e3 * sign * line.motions[kept, line.along]
            files[f"{file_stem(volume.point)}_{file_stem(line.axis)}.comp"] = "".join(
                f"{place:.6f} {moved:.7f} {moved:.7f}\n"
                for place, moved in zip(nominal, actual, strict=True)
            ).encode()
    return files


def _list_tables(run: Results) -> Iterator[PlainTable]:
    for volume in run.find(VolumetricAnswer):
        stem = file_stem(volume.point)
        yield _tabulate_map(f"volumetric_{stem}", volume)
        yield _tabulate_corrections(volume)
        yield tabulate(f"error_motions_{stem}", LINE_COLUMNS, _list_lines(volume))
        yield tabulate_budget(f"volumetric_budget_{stem}", volume.budget)


def _list_parts(run: Results) -> Iterator[TerminalPart]:
    for volume in run.find(VolumetricAnswer):
        title = f"Position error of {volume.point} over {' × '.join(volume.axes)}: range by source"
        yield Listing(title, DEVIATION_COLUMNS, _list_ranges(volume))
        yield from (f"  {words}" for words in _volumetric_words(volume))
        yield ""
        title = "Error motions along each axis: straightness, positioning, angles"
        yield Listing(title, LINE_COLUMNS, _list_lines(volume))
        if volume.squareness:
            yield Listing("Squareness", SQUARENESS_COLUMNS, _list_squareness(volume))
        for direction, shares in volume.budget.items():
            yield Shares(direction, shares)
        yield ""


VIEW = View(
    tables=_list_tables,
    files=_encode_compensations,
    terminal=_list_parts,
    section=lambda run: Section(
        "volumetric",
        "Volumetric errors",
        template="views/volumetric.html",
        names={
            "answers": run.find(VolumetricAnswer),
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
            "list_squareness": _list_squareness,
            "map_layers": map_layers,
            "volumetric_words": _volumetric_words,
        },
    ),
)
