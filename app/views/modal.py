"""Natural modes of each pose, with their errors, damping and strain energy."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Literal

from markupsafe import Markup

from headstock.app.drawings.figures import draw_frequencies, draw_stack
from headstock.app.drawings.markup import typeset, write_data, write_error
from headstock.app.tables.static import top_shares
from headstock.app.tables.table import Column, Listing, PlainTable
from headstock.app.texts.bounded_values import (
    bound_size,
    error_words,
    largest_shares,
    share_words,
    shares_begin,
    show_bound,
    show_bounded,
    show_damped,
    show_damping_error,
    show_error,
    show_span,
)
from headstock.app.views.view import Section, TerminalPart, View
from headstock.geometry.machine.machine import show_position
from headstock.pipeline.answers.modal import DAMPED_FREQUENCY, DAMPING_RATIO, PoseModes
from headstock.pipeline.numbers.estimates import list_left_out
from headstock.pipeline.results.mode_files import file_stem
from headstock.pipeline.results.results import Results


@dataclass(frozen=True)
class ModeRow:
    """A natural mode as a row: unrounded, None where it is not known; a damped frequency of zero is
    an overdamped mode.
    """

    number: int
    rigid: bool
    hz: float
    error_hz: float | None
    known_hz: float | None
    damped_hz: float | None
    damped_error_hz: float | None
    damping_ratio: float | None
    damping_error: float | None
    name: str
    energy_share: dict[str, float]
    spread_hz: tuple[float, float] | None


def list_modes(modes: PoseModes) -> list[ModeRow]:
    """The modes of a pose, from the lowest or from the first in a window of frequencies."""
    errors = modes.list_errors()
    damped, ratios = modes.list_errors(DAMPED_FREQUENCY), modes.list_errors(DAMPING_RATIO)
    return [
        ModeRow(
            number=modes.below + place + 1,
            rigid=place < modes.rigid_count,
            hz=float(hz),
            error_hz=errors[place].total,
            known_hz=errors[place].known,
            damped_hz=modes.damped_hz[place] if modes.damped_hz else None,
            damped_error_hz=damped[place].total,
            damping_ratio=modes.damping_ratio[place],
            damping_error=ratios[place].total,
            name=modes.mode_names[place],
            energy_share=modes.energy_share[place],
            spread_hz=modes.spread_hz[place] if modes.spread_hz else None,
        )
        for place, hz in enumerate(modes.frequencies_hz)
    ]


def _tabulate_modes(modes: PoseModes) -> PlainTable:
    """Frequencies, errors, damping, names and energy shares."""
    found = list_modes(modes)
    parts = sorted({part for row in found for part in row.energy_share})
    partly = any(row.error_hz is None and row.known_hz is not None for row in found)
    headings = (
        *(
            "mode",
            "frequency [Hz]",
            "± [Hz]",
            *(["± known, unknown sources apart [Hz]"] if partly else []),
            "damped frequency [Hz]",
            "± damped [Hz]",
            "damping ratio",
            "± damping ratio",
            "name",
        ),
        *(f"strain energy in {part}" for part in parts),
    )
    rows = tuple(
        (
            *(row.number, row.hz, bound_size(row.hz, row.error_hz)),
            *([bound_size(row.hz, row.known_hz)] if partly else []),
            *(row.damped_hz, bound_size(row.damped_hz, row.damped_error_hz)),
            *(row.damping_ratio, bound_size(row.damping_ratio, row.damping_error), row.name),
            *(row.energy_share.get(part) for part in parts),
        )
        for row in found
    )
    return PlainTable(f"modes_{file_stem(modes.pose.name)}", headings, rows)


SHARES_SHOWN, SMALLEST_SHOWN = 3, 0.005  # on the terminal
SHARES_NAMED, SMALLEST_NAMED = 3, 0.02  # in the report


def _list_shares(modes: PoseModes) -> list[Mapping[str, float | None]]:
    """Return the parts of ± by source of every mode that is no rigid-body mode."""
    return [error.shares for error in modes.list_errors()[modes.rigid_count :]]


def _list_words(modes: PoseModes) -> list[str]:
    """Say which modes are listed, where damping comes from, and what is not in ±."""
    words = []
    if below := modes.below:
        words.append(
            f"{below} mode{'s' if below > 1 else ''} below the window of frequencies: not listed"
        )
    if len(modes.damping_from) > 1:
        words.append(f"damping ratios add up from {'; '.join(modes.damping_from)}")
    if modes.spread_hz:
        words.append("interfaces: lowest and highest with every interface averaging or rigid")
    return words + error_words(_list_shares(modes), list_left_out(modes.list_errors()))


def _list_parts(run: Results) -> Iterator[TerminalPart]:
    for modes in run.modal:
        yield _list_modes(modes)
        yield from (f"  {words}" for words in share_words(_list_shares(modes)))
        yield from (f"  {words}" for words in _list_words(modes))
        yield ""


def _list_positions(modes: PoseModes) -> list[tuple[str, float, str]]:
    """Return where the axes are in the pose of some modes, with units."""
    return [
        (axis, position, modes.pose_units[axis])
        for axis, position in modes.pose.positions.items()
        if axis in modes.pose_units
    ]


def _describe_position(modes: PoseModes) -> str:
    """Describe where the axes are in the pose of some modes: ``Y = 30 mm``."""
    return ", ".join(
        f"{axis} = {show_position(place, unit)}" for axis, place, unit in _list_positions(modes)
    )


def _show_bound(row: ModeRow) -> str:
    return "" if row.rigid else show_bound(row.hz, row.error_hz, row.known_hz)


def _show_parts(row: ModeRow) -> str:
    top = top_shares(row.energy_share, SHARES_SHOWN, SMALLEST_SHOWN)
    return ", ".join(f"{name} {100 * share:.0f} %" for name, share in top)


def _damped_column(heading: str, which: Literal[0, 1]) -> Column[ModeRow]:
    return Column(
        lambda row: show_damped(row.damped_hz, row.damped_error_hz, rigid=row.rigid)[which],
        screen=heading,
    )


def _damping_column(heading: str, which: Literal[0, 1]) -> Column[ModeRow]:
    return Column(
        lambda row: show_damping_error(row.damping_ratio, row.damping_error, rigid=row.rigid)[
            which
        ],
        screen=heading,
    )


DAMPED_COLUMNS = (
    _damped_column(">damped Hz", 0),
    _damped_column("<± Hz", 1),
    _damping_column(">damping", 0),
    _damping_column("<±", 1),
)


def _list_modes(modes: PoseModes) -> Listing[ModeRow]:
    rows = list_modes(modes)
    damped = any(row.damping_ratio is not None for row in rows)
    known = any(
        row.error_hz is not None or row.known_hz is not None for row in rows if not row.rigid
    )
    columns: list[Column[ModeRow]] = [
        Column(lambda row: str(row.number), screen=">no."),
        Column(
            lambda row: "0" if row.rigid else show_bounded(row.hz, row.error_hz),
            screen=">undamped Hz" if damped else ">Hz",
        ),
    ]
    if known:
        columns.append(Column(_show_bound, screen="<± Hz"))
    if damped:
        columns += DAMPED_COLUMNS
    if modes.spread_hz:
        columns.append(Column(lambda row: show_span(row.spread_hz), screen="<interfaces Hz"))
    columns.append(Column(lambda row: row.name, screen="mode"))
    if any(len(row.energy_share) > 1 for row in rows):
        columns.append(Column(_show_parts, screen="strain energy in"))
    positions = _describe_position(modes)
    pose = modes.pose.name + (f" ({positions})" if positions else "")
    return Listing(f"Natural modes in pose {pose}", columns, rows)


def _write_damping(mode: ModeRow) -> tuple[Markup, Markup]:
    """Write damping ratio of a mode, and its ±."""
    shown, bound = show_damping_error(mode.damping_ratio, mode.damping_error, rigid=mode.rigid)
    value = (
        Markup("–")
        if mode.damping_ratio is None
        else write_data(mode.damping_ratio, typeset(shown))
    )
    return value, write_error(mode.damping_error, bound)


def _write_damped(mode: ModeRow) -> tuple[Markup, Markup]:
    """Write frequency of the damped oscillation of a mode, and its ±."""
    shown, bound = show_damped(mode.damped_hz, mode.damped_error_hz, rigid=mode.rigid)
    value = (
        Markup("–")
        if mode.damped_hz is None
        else write_data(mode.damped_hz, typeset(shown) if mode.damped_hz else shown)
    )
    return value, write_error(mode.damped_error_hz, bound)


VIEW = View(
    tables=lambda run: map(_tabulate_modes, run.modal),
    terminal=_list_parts,
    section=lambda run: Section(
        "modes",
        "Natural modes",
        template="views/modal.html",
        names={
            "modal": run.modal,
            "list_modes": list_modes,
            "list_positions": _list_positions,
            "draw_frequencies": draw_frequencies,
            "draw_stack": draw_stack,
            "damped_cells": _write_damped,
            "damping_cells": _write_damping,
            "size": lambda error: Markup('<data class="bound" value="{}">{}</data>').format(
                repr(error), typeset(show_error(error))
            ),
            "top": lambda shares: top_shares(shares, SHARES_NAMED, SMALLEST_NAMED),
            "largest_shares": largest_shares,
            "shares_begin": shares_begin,
            "list_shares": _list_shares,
            "list_words": _list_words,
        },
    ),
)
