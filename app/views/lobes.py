"""Limit depths of cut over the speed of the spindle."""

from collections.abc import Iterator, Mapping

from headstock.app.drawings.lobes import draw_lobes
from headstock.app.tables.lobes import (
    LOBE_COLUMNS,
    LOWEST_LOBE_COLUMNS,
    list_lobes,
    list_lowest_lobes,
    tabulate_limits,
)
from headstock.app.tables.table import PlainTable, tabulate
from headstock.app.texts.bounded_values import limit_error_words
from headstock.app.views.view import FinishedRun, Listing, Section, TerminalPart, View
from headstock.pipeline.answers.lobes import LobesSummary
from headstock.pipeline.results.mode_files import file_stem


def _list_tables(run: FinishedRun) -> Iterator[PlainTable]:
    for pose, lobes in run.summary["lobes"].items():
        yield tabulate(f"lobes_{file_stem(pose)}", LOBE_COLUMNS, list_lobes(pose, lobes))
        yield tabulate_limits(pose, lobes)


def _list_parts(run: FinishedRun) -> Iterator[TerminalPart]:
    lobes = run.summary["lobes"]
    yield Listing(_title(lobes), LOWEST_LOBE_COLUMNS, list_lowest_lobes(lobes))
    yield from (f"  {words}" for words in limit_error_words(lobes))


def _title(lobes: Mapping[str, LobesSummary]) -> str:
    first = next(iter(lobes.values()))
    return (
        f"Limit depth of cut in {first['material']}, {first['teeth']} teeth on {first['diameter_mm']:g} mm,"
        f" {first['radial_depth_mm']:g} mm wide"
    )


def _write_section(_: FinishedRun) -> Section:
    names = {
        "columns": {"lobes": LOBE_COLUMNS, "lowest_lobes": LOWEST_LOBE_COLUMNS},
        "draw_lobes": draw_lobes,
        "limit_error_words": limit_error_words,
        "list_lobes": list_lobes,
        "list_lowest_lobes": list_lowest_lobes,
    }
    return Section("lobes", "Stability lobes", "Lobes", template="views/lobes.html", names=names)


VIEW = View(tables=_list_tables, terminal=_list_parts, section=_write_section)
