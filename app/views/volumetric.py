"""Position errors of points over a volume of poses."""

from collections.abc import Iterator

from headstock.app.drawings.figures import draw_budget, draw_map, map_layers
from headstock.app.drawings.volumetric import draw_motions, draw_volume, list_maps
from headstock.app.tables.map import tabulate_map
from headstock.app.tables.static import DEVIATION_COLUMNS, merge_families, tabulate_budget
from headstock.app.tables.table import PlainTable, tabulate
from headstock.app.tables.volumetric import (
    LINE_COLUMNS,
    SQUARENESS_COLUMNS,
    list_lines,
    list_ranges,
    volumetric_words,
)
from headstock.app.views.view import FinishedRun, Listing, Section, Shares, TerminalPart, View
from headstock.pipeline.results.mode_files import file_stem


def _list_tables(run: FinishedRun) -> Iterator[PlainTable]:
    for point, volume in run.summary["volumetric"].items():
        stem = file_stem(point)
        yield tabulate_map(f"volumetric_{stem}", volume)
        yield tabulate(f"error_motions_{stem}", LINE_COLUMNS, list_lines(volume))
        yield tabulate_budget(f"volumetric_budget_{stem}", volume["budget"])


def _list_parts(run: FinishedRun) -> Iterator[TerminalPart]:
    for point, volume in run.summary["volumetric"].items():
        title = f"Position error of {point} over {' × '.join(volume['axes'])}: range by source"
        yield Listing(title, DEVIATION_COLUMNS, list_ranges(volume))
        yield from (f"  {words}" for words in volumetric_words(volume))
        yield ""
        title = "Error motions along each axis: straightness, positioning, angles"
        yield Listing(title, LINE_COLUMNS, list_lines(volume))
        if volume["squareness"]:
            yield Listing("Squareness", SQUARENESS_COLUMNS, volume["squareness"])
        for direction, shares in volume["budget"].items():
            yield Shares(direction, merge_families(shares))
        yield ""


def _write_section(_: FinishedRun) -> Section:
    names = {
        "columns": {
            "deviations": DEVIATION_COLUMNS,
            "lines": LINE_COLUMNS,
            "squareness": SQUARENESS_COLUMNS,
        },
        "draw_budget": draw_budget,
        "draw_map": draw_map,
        "draw_motions": draw_motions,
        "draw_volume": draw_volume,
        "list_lines": list_lines,
        "list_maps": list_maps,
        "list_ranges": list_ranges,
        "map_layers": map_layers,
        "merge_families": merge_families,
        "volumetric_words": volumetric_words,
    }
    template = "views/volumetric.html"
    return Section("volumetric", "Volumetric errors", template=template, names=names)


VIEW = View(tables=_list_tables, terminal=_list_parts, section=_write_section)
