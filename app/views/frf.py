"""Frequency responses of each pose, with the stress at probes."""

from collections.abc import Iterator

from headstock.app.drawings.frf import draw_overlay, draw_probes, draw_response, has_more_fields
from headstock.app.tables.frf import (
    DRIVE_POINT_COLUMNS,
    NUMBER_COLUMNS,
    list_channels,
    list_numbers,
    tabulate_response,
)
from headstock.app.tables.probes import PROBE_PEAK_COLUMNS, list_probe_peaks, tabulate_probes
from headstock.app.tables.table import Listing, PlainTable, tabulate
from headstock.app.texts.bounded_values import response_error_words
from headstock.app.texts.curves import overlaid_responses
from headstock.app.views.view import FinishedRun, Section, TerminalPart, View
from headstock.pipeline.answers.frf import PoseResponse
from headstock.pipeline.results.mode_files import file_stem

CURSOR = "response_cursor.js"


def _list_tables(run: FinishedRun) -> Iterator[PlainTable]:
    for pose, response in run.summary["frf"].items():
        if peaks := list_probe_peaks(response):
            yield tabulate(f"probe_peaks_{file_stem(pose)}", PROBE_PEAK_COLUMNS, peaks)
    for curves in (response.curves for response in run.find_answers(PoseResponse)):
        yield tabulate_response(curves)
        if curves.probes:
            yield tabulate_probes(curves)


def _list_parts(run: FinishedRun) -> Iterator[TerminalPart]:
    for pose, response in run.summary["frf"].items():
        if driven := list_channels(response):
            yield Listing(f"Frequency response in pose {pose}", DRIVE_POINT_COLUMNS, driven)
        else:
            yield f"Frequency response in pose {pose}: curves in tables/ and the report"
        if numbers := list_numbers(response):
            title = f"Peaks and static compliances of responses in pose {pose}"
            yield Listing(title, NUMBER_COLUMNS, numbers)
        yield from (f"  {words}" for words in response_error_words(response))
        if peaks := list_probe_peaks(response):
            title = f"Largest stress over frequency at probes in pose {pose}"
            yield Listing(title, PROBE_PEAK_COLUMNS, peaks)


def _write_section(run: FinishedRun) -> Section | None:
    responses = {found.curves.pose: found.curves for found in run.find_answers(PoseResponse)}
    names = {
        "responses": responses,
        "columns": {
            "ports": DRIVE_POINT_COLUMNS,
            "numbers": NUMBER_COLUMNS,
            "probe_peaks": PROBE_PEAK_COLUMNS,
        },
        "draw_overlay": draw_overlay,
        "draw_probes": draw_probes,
        "draw_response": draw_response,
        "has_more_fields": has_more_fields,
        "list_numbers": list_numbers,
        "list_ports": list_channels,
        "list_probe_peaks": list_probe_peaks,
        "overlaid_responses": overlaid_responses,
        "response_error_words": response_error_words,
    }
    section = Section(
        "frf", "Frequency response", template="views/frf.html", names=names, script=CURSOR
    )
    return section if responses else None


VIEW = View(tables=_list_tables, terminal=_list_parts, section=_write_section)
