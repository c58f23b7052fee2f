"""Gaps, milled faces, forces and stresses along a contour."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from headstock.app.drawings.milled_faces import draw_milled_faces
from headstock.app.drawings.path import draw_contour
from headstock.app.tables.contouring import (
    FACE_COLUMNS,
    contour_error_words,
    contour_words,
    limit_words,
    list_faces,
    tabulate_contour,
    tabulate_profiles,
)
from headstock.app.tables.probes import PROBE_MOTION_PEAKS
from headstock.app.tables.table import PlainTable
from headstock.app.views.view import FinishedRun, Listing, Section, TerminalPart, View


def _list_tables(run: FinishedRun) -> Iterator[PlainTable]:
    contour = run.summary["contouring"]
    yield tabulate_contour(contour)
    yield from (listing.tabulate() for listing in _list_listings(run))
    for face in contour.get("milled_faces", []):
        yield from tabulate_profiles(face)


def _list_listings(run: FinishedRun) -> Iterator[Listing[Any]]:
    contour = run.summary["contouring"]
    title = "Faces along the contour [µm]"
    yield Listing(title, FACE_COLUMNS, list_faces(contour), "contour_faces")
    if contour["probes"]:
        title, rows = "Largest stress at probes along the contour", contour["probes"].items()
        yield Listing(title, PROBE_MOTION_PEAKS, rows, "probes_contour")


def _list_parts(run: FinishedRun) -> Iterator[TerminalPart]:
    contour = run.summary["contouring"]
    faces, *probes = _list_listings(run)
    yield faces
    for words in (contour_words(contour), contour_error_words(contour), limit_words(contour)):
        if words:
            yield f"  {words}"
            yield ""
    yield from probes


def _write_section(_: FinishedRun) -> Section:
    names = {
        "columns": {"faces": FACE_COLUMNS, "probe_peaks_over_time": PROBE_MOTION_PEAKS},
        "draw_contour": draw_contour,
        "draw_milled_faces": draw_milled_faces,
        "list_faces": list_faces,
        "contour_words": contour_words,
        "contour_error_words": contour_error_words,
        "largest": _find_largest,
    }
    return Section("contour", "Contouring", template="views/contouring.html", names=names)


def _find_largest(rows: Iterable[Mapping[str, Sequence[float]]], *keys: str) -> float:
    """Return the largest magnitude in lists of the same unit: the scale of their roundoff."""
    return max(
        (abs(value) for row in rows for key in keys for value in row.get(key, ())), default=0.0
    )


VIEW = View(tables=_list_tables, terminal=_list_parts, section=_write_section)
