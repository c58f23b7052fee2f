"""Limit depths of cut over the speed of the spindle."""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

from headstock.app.drawings.lobes import draw_lobes
from headstock.app.tables.table import Column, Listing, PlainTable, show_percent, tabulate
from headstock.app.texts.bounded_values import limit_error_words, show_best_depth
from headstock.app.views.view import FinishedRun, Section, TerminalPart, View
from headstock.pipeline.answers.lobes import (
    DirectionSummary,
    LobesSummary,
    LobeSummary,
)
from headstock.pipeline.results.mode_files import file_stem


class _LobeRow(NamedTuple):
    """A lobe of a direction of travel in a pose."""

    pose: str
    direction: DirectionSummary
    lobe: LobeSummary


def _list_lowest_lobes(lobes: Mapping[str, LobesSummary]) -> list[_LobeRow]:
    """The lowest limit of every pose and direction of travel."""
    return [
        _LobeRow(pose, direction, direction["lowest"])
        for pose, found in lobes.items()
        for direction in found["directions"]
        if direction["lowest"] is not None
    ]


def _show_speed(value: float) -> str:
    return f"{value:.0f}"


def _tell_best(direction: DirectionSummary) -> str | None:
    best = direction["best_speeds"][:1]
    return f"{show_best_depth(best[0])} at {best[0]['rpm']:.0f}" if best else None


LOWEST_LOBE_COLUMNS: tuple[Column[_LobeRow], ...] = (
    Column(lambda row: row.pose, screen="pose", report="Pose"),
    Column(lambda row: row.direction["name"], screen="<travel", report="Travel"),
    Column(
        lambda row: row.lobe["limit_depth_mm"],
        screen=">lowest mm",
        report="Lowest limit [mm]",
        digits=3,
        error=lambda row: row.direction["lowest_error_mm"],
    ),
    Column(
        lambda row: row.lobe["rpm"],
        screen=">at rpm",
        report="at [rpm]",
        show=_show_speed,
    ),
    Column(
        lambda row: row.lobe["chatter_hz"],
        screen=">chatter Hz",
        report="Chatter [Hz]",
        digits=4,
        error=lambda row: row.direction["chatter_error_hz"],
    ),
    Column(lambda row: row.lobe["mode"], screen="<mode", report="Mode"),
    Column(lambda row: row.lobe["part"], report="Part"),
    Column(
        lambda row: _tell_best(row.direction), screen="<best mm, rpm", report="Best [mm at rpm]"
    ),
)

LOBE_COLUMNS: tuple[Column[_LobeRow], ...] = (
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


def _list_lobes(pose: str, found: LobesSummary, most: int | None = None) -> list[_LobeRow]:
    """Lobes of a pose, direction by direction, rising in speed.

    Args:
        most: The widest so many of each direction only.
    """
    rows = []
    for direction in found["directions"]:
        lobes = direction["lobes"]
        if most is not None and len(lobes) > most:
            widest = sorted(lobes, key=lambda lobe: lobe["from_rpm"] - lobe["to_rpm"])[:most]
            lobes = sorted(widest, key=lambda lobe: lobe["from_rpm"])
        rows += [_LobeRow(pose, direction, lobe) for lobe in lobes]
    return rows


def _tabulate_limits(pose: str, found: LobesSummary) -> PlainTable:
    """Tabulate a row per direction and speed."""
    rows = [
        (direction["name"], *values, None if lobe is None else direction["lobes"][lobe]["mode"])
        for direction in found["directions"]
        for *values, lobe in zip(
            direction["series"]["rpm"],
            direction["series"]["limit_depth_mm"],
            direction["series"]["error_mm"],
            direction["series"]["limited"],
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
        "± [mm]",
        "limited",
        "zeroth order [mm]",
        "chatter [Hz]",
        "mode",
    )
    return PlainTable(f"limits_{file_stem(pose)}", headings, tuple(rows))


def _list_tables(run: FinishedRun) -> Iterator[PlainTable]:
    for pose, lobes in run.summary["lobes"].items():
        yield tabulate(f"lobes_{file_stem(pose)}", LOBE_COLUMNS, _list_lobes(pose, lobes))
        yield _tabulate_limits(pose, lobes)


def _list_parts(run: FinishedRun) -> Iterator[TerminalPart]:
    lobes = run.summary["lobes"]
    yield Listing(_title(lobes), LOWEST_LOBE_COLUMNS, _list_lowest_lobes(lobes))
    yield from (f"  {words}" for words in limit_error_words(lobes))


def _title(lobes: Mapping[str, LobesSummary]) -> str:
    first = next(iter(lobes.values()))
    return (
        f"Limit depth of cut in {first['material']}, {first['teeth']} teeth on {first['diameter_mm']:g} mm,"
        f" {first['radial_depth_mm']:g} mm wide"
    )


VIEW = View(
    tables=_list_tables,
    terminal=_list_parts,
    section=Section(
        "lobes",
        "Stability lobes",
        "Lobes",
        template="views/lobes.html",
        names={
            "columns": {"lobes": LOBE_COLUMNS, "lowest_lobes": LOWEST_LOBE_COLUMNS},
            "draw_lobes": draw_lobes,
            "limit_error_words": limit_error_words,
            "list_lobes": _list_lobes,
            "list_lowest_lobes": _list_lowest_lobes,
        },
    ),
)
