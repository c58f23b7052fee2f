"""Limit depths of cut over the speed of the spindle."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from headstock.app.drawings.lobes import draw_lobes
from headstock.app.tables.table import (
    Column,
    Listing,
    PlainTable,
    show_percent,
    tabulate,
)
from headstock.app.texts.bounded_values import limit_error_words, show_best_depth
from headstock.app.views.view import Section, TerminalPart, View
from headstock.pipeline.answers.lobes import HZ, MM, DirectionLobes, Lobe, PoseLobes
from headstock.pipeline.numbers.estimates import scale_total
from headstock.pipeline.results.mode_files import file_stem
from headstock.pipeline.results.results import Results
from headstock.pipeline.storage.json_texts import find_known


class _LobeRow(NamedTuple):
    """A lobe of a direction of travel in a pose."""

    found: PoseLobes
    direction: DirectionLobes
    lobe: Lobe

    def rpm(self, place: int) -> float:
        """Return a speed [rev/min]."""
        return float(self.found.rpm[place])

    @property
    def depth(self) -> float:
        """Its lowest limit [mm]."""
        return float(MM * self.direction.depths[self.lobe.place])

    @property
    def chatter(self) -> float:
        """Frequency of chatter there [Hz]."""
        return float(HZ * self.direction.chatter[self.lobe.place])


def _list_lowest_lobes(lobes: Sequence[PoseLobes]) -> list[_LobeRow]:
    """The lowest limit of every pose and direction of travel."""
    return [
        _LobeRow(found, direction, direction.lowest)
        for found in lobes
        for direction in found.directions
        if direction.lowest is not None
    ]


def _show_speed(value: float) -> str:
    return f"{value:.0f}"


def _describe_best(row: _LobeRow) -> str | None:
    best = row.direction.best[:1]
    return f"{show_best_depth(row.direction, best[0])} at {row.rpm(best[0]):.0f}" if best else None


LOWEST_LOBE_COLUMNS: tuple[Column[_LobeRow], ...] = (
    Column(lambda row: row.found.pose, screen="pose", report="Pose"),
    Column(lambda row: row.direction.name, screen="<travel", report="Travel"),
    Column(
        lambda row: row.depth,
        screen=">lowest mm",
        report="Lowest limit [mm]",
        digits=3,
        error=lambda row: scale_total(row.direction.lowest_errors[0], MM),
    ),
    Column(
        lambda row: row.rpm(row.lobe.place),
        screen=">at rpm",
        report="at [rpm]",
        show=_show_speed,
    ),
    Column(
        lambda row: row.chatter,
        screen=">chatter Hz",
        report="Chatter [Hz]",
        digits=4,
        error=lambda row: row.direction.lowest_errors[1].total,
    ),
    Column(lambda row: row.lobe.mode, screen="<mode", report="Mode"),
    Column(lambda row: row.lobe.part, report="Part"),
    Column(lambda row: _describe_best(row), screen="<best mm, rpm", report="Best [mm at rpm]"),
)

LOBE_COLUMNS: tuple[Column[_LobeRow], ...] = (
    Column(lambda row: row.found.pose, "pose"),
    Column(lambda row: row.direction.name, "travel", report="Travel"),
    Column(lambda row: row.lobe.waves, "waves", report="Waves"),
    Column(
        lambda row: row.rpm(row.lobe.first), "from [rpm]", report="from [rpm]", show=_show_speed
    ),
    Column(lambda row: row.rpm(row.lobe.last), "to [rpm]", report="to [rpm]", show=_show_speed),
    Column(
        lambda row: row.depth,
        "lowest limit [mm]",
        report="Lowest limit [mm]",
        digits=3,
    ),
    Column(lambda row: row.rpm(row.lobe.place), "at [rpm]", report="at [rpm]", show=_show_speed),
    Column(lambda row: row.chatter, "chatter [Hz]", report="Chatter [Hz]"),
    Column(lambda row: row.lobe.mode, "mode", report="Mode"),
    Column(lambda row: row.lobe.mode_hz, "mode [Hz]", report="Mode [Hz]"),
    Column(
        lambda row: row.lobe.mode_share, "share of the motion", report="Share", show=show_percent
    ),
    Column(lambda row: row.lobe.part, "part", report="Part"),
)


def _list_lobes(found: PoseLobes, most: int | None = None) -> list[_LobeRow]:
    """Lobes of a pose, direction by direction, rising in speed.

    Args:
        most: The widest so many of each direction only.
    """
    rows = []
    for direction in found.directions:
        lobes: Sequence[Lobe] = direction.lobes
        if most is not None and len(lobes) > most:
            rpm = found.rpm
            widest = sorted(lobes, key=lambda lobe: rpm[lobe.first] - rpm[lobe.last])[:most]
            lobes = sorted(widest, key=lambda lobe: rpm[lobe.first])
        rows += [_LobeRow(found, direction, lobe) for lobe in lobes]
    return rows


def _tabulate_limits(found: PoseLobes) -> PlainTable:
    """Tabulate a row per direction and speed."""
    rows = [
        (
            direction.name,
            float(speed),
            find_known(MM * direction.depths[place]),
            find_known(MM * errors[place]),
            bool(direction.limited[place]),
            float(MM * direction.zeroth[place]),
            find_known(HZ * direction.chatter[place]),
            None if owner < 0 else direction.lobes[owner].mode,
        )
        for direction in found.directions
        for errors in [direction.errors]
        for place, (speed, owner) in enumerate(zip(found.rpm, direction.owner, strict=True))
    ]
    headings = (
        "travel",
        "speed [rpm]",
        "limit depth [mm]",
        "± [mm]",
        "limited",
        "zeroth order [mm]",
        "chatter [Hz]",
        "mode",
    )
    return PlainTable(f"limits_{file_stem(found.pose)}", headings, tuple(rows))


def _list_tables(run: Results) -> Iterator[PlainTable]:
    for found in run.find(PoseLobes):
        yield tabulate(f"lobes_{file_stem(found.pose)}", LOBE_COLUMNS, _list_lobes(found))
        yield _tabulate_limits(found)


def _list_parts(run: Results) -> Iterator[TerminalPart]:
    lobes = run.find(PoseLobes)
    yield Listing(_title(lobes[0]), LOWEST_LOBE_COLUMNS, _list_lowest_lobes(lobes))
    yield from (f"  {words}" for words in limit_error_words(lobes))


def _title(first: PoseLobes) -> str:
    return (
        f"Limit depth of cut in {first.material}, {first.teeth} teeth on {MM * first.diameter:g} mm,"
        f" {MM * first.radial_depth:g} mm wide"
    )


VIEW = View(
    tables=_list_tables,
    terminal=_list_parts,
    section=lambda run: Section(
        "lobes",
        "Stability lobes",
        "Lobes",
        template="views/lobes.html",
        names={
            "answers": run.find(PoseLobes),
            "columns": {"lobes": LOBE_COLUMNS, "lowest_lobes": LOWEST_LOBE_COLUMNS},
            "draw_lobes": draw_lobes,
            "limit_error_words": limit_error_words,
            "list_lobes": _list_lobes,
            "list_lowest_lobes": _list_lowest_lobes,
        },
    ),
)
