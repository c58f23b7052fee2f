"""Rows of natural modes."""

from dataclasses import dataclass

from headstock.app.tables.table import PlainTable
from headstock.app.texts.bounded_values import bound_size
from headstock.pipeline.answers.modal import ModesSummary
from headstock.pipeline.numbers.estimates import known_part
from headstock.pipeline.results.mode_files import file_stem


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


def list_modes(modes: ModesSummary) -> list[ModeRow]:
    """The modes of a pose, from the lowest or from the first in a window of frequencies."""
    below = modes.get("modes_below", 0)
    shares = modes.get("error_share") or [{}] * len(modes["frequencies_hz"])
    spreads = modes.get("interface_spread_hz") or [None] * len(modes["frequencies_hz"])
    return [
        ModeRow(
            number=below + place + 1,
            rigid=place < modes["rigid_count"],
            hz=hz,
            error_hz=modes["error_hz"][place],
            known_hz=known_part(shares[place]),
            damped_hz=modes["damped_hz"][place],
            damped_error_hz=modes["damped_error_hz"][place],
            damping_ratio=modes["damping_ratio"][place],
            damping_error=modes["damping_error"][place],
            name=modes["mode_names"][place],
            energy_share=modes["energy_share"][place],
            spread_hz=spreads[place],
        )
        for place, hz in enumerate(modes["frequencies_hz"])
    ]


def tabulate_modes(modes: ModesSummary) -> PlainTable:
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
    return PlainTable(f"modes_{file_stem(modes['pose_name'])}", headings, rows)
