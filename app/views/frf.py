"""Frequency responses of each pose, with the stress at probes."""

from collections.abc import Iterator

from headstock.app.drawings.frf import draw_overlay, draw_probes, draw_response, has_more_fields
from headstock.app.tables.frf import (
    DRIVE_POINT_COLUMNS,
    HEIGHT_COLUMNS,
    list_drive_points,
    list_heights,
    tabulate_response,
)
from headstock.app.tables.probes import PROBE_PEAK_COLUMNS, list_probe_peaks, tabulate_probes
from headstock.app.tables.table import Listing, PlainTable, tabulate
from headstock.app.texts.bounded_values import response_error_words
from headstock.app.texts.curves import overlaid_responses
from headstock.app.views.view import Section, TerminalPart, View
from headstock.pipeline.answers.frf import PoseResponse
from headstock.pipeline.results.mode_files import file_stem
from headstock.pipeline.results.results import Results

CURSOR = "response_cursor.js"


def _list_tables(run: Results) -> Iterator[PlainTable]:
    responses = [response.curves for response in run.find(PoseResponse)]
    for curves in responses:
        if peaks := list_probe_peaks(curves):
            yield tabulate(f"probe_peaks_{file_stem(curves.pose)}", PROBE_PEAK_COLUMNS, peaks)
    for curves in responses:
        yield tabulate_response(curves)
        if curves.probes:
            yield tabulate_probes(curves)


def _list_parts(run: Results) -> Iterator[TerminalPart]:
    for response in run.find(PoseResponse):
        pose = response.curves.pose
        if driven := list_drive_points(response):
            yield Listing(f"Frequency response in pose {pose}", DRIVE_POINT_COLUMNS, driven)
        else:
            yield f"Frequency response in pose {pose}: curves in tables/ and the report"
        if heights := list_heights(response):
            title = f"Peaks and static compliances of responses in pose {pose}"
            yield Listing(title, HEIGHT_COLUMNS, heights)
        yield from (f"  {words}" for words in response_error_words(response))
        if peaks := list_probe_peaks(response.curves):
            title = f"Largest stress over frequency at probes in pose {pose}"
            yield Listing(title, PROBE_PEAK_COLUMNS, peaks)
        yield ""


def _write_section(run: Results) -> Section:
    responses = run.find(PoseResponse)
    names = {
        "responses": responses,
        "overlaid": overlaid_responses([response.curves for response in responses]),
        "columns": {
            "drive_points": DRIVE_POINT_COLUMNS,
            "heights": HEIGHT_COLUMNS,
            "probe_peaks": PROBE_PEAK_COLUMNS,
        },
        "draw_overlay": draw_overlay,
        "draw_probes": draw_probes,
        "draw_response": draw_response,
        "has_more_fields": has_more_fields,
        "list_drive_points": list_drive_points,
        "list_heights": list_heights,
        "list_probe_peaks": list_probe_peaks,
        "response_error_words": response_error_words,
    }
    return Section(
        "frf", "Frequency response", template="views/frf.html", names=names, script=CURSOR
    )


VIEW = View(tables=_list_tables, terminal=_list_parts, section=_write_section)
