"""Quantities of a mechanism over its workspace."""

from itertools import product

from headstock.app.drawings.figures import draw_map, map_layers
from headstock.app.tables.table import PlainTable
from headstock.app.views.view import Section, View
from headstock.pipeline.answers.map import Grid, GridSummary


def tabulate_map(stem: str, found: GridSummary) -> PlainTable:
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


VIEW = View(
    tables=lambda run: [tabulate_map("map", run.summary["map"])],
    section=Section(
        "map",
        "Workspace map",
        template="views/map.html",
        names={"draw_map": draw_map, "map_layers": map_layers},
    ),
)
