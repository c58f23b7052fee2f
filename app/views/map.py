"""Quantities of a mechanism over its workspace."""

from headstock.app.drawings.figures import draw_map, map_layers
from headstock.app.tables.map import tabulate_map
from headstock.app.views.view import FinishedRun, Section, View


def _write_section(_: FinishedRun) -> Section:
    names = {"draw_map": draw_map, "map_layers": map_layers}
    return Section("map", "Workspace map", template="views/map.html", names=names)


VIEW = View(
    tables=lambda run: [tabulate_map("map", run.summary["map"])],
    section=_write_section,
)
