"""A measured machine beside its model in rows: modes, channels, responses."""

import dataclasses
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from headstock.app.tables.table import (
    Column,
    Listing,
    show_percent,
)
from headstock.app.texts.bounded_values import show_bound, show_damping
from headstock.pipeline.storage.json_texts import find_known
from headstock.studies.correlation.correlation import CorrelatedMode, Correlation
from headstock.studies.correlation.responses import response_channel

NO_BREAK = "\u00a0"
MOST_ROWS = 12  # of tables that begin with the worst, on the screen and in the page; files have all
LEAST_SHARE = 0.03  # of the largest motion under a force: smaller responses are listed last


def _show_error(hz: float | None, error: float | None, known: float | None = None) -> str | None:
    """± of a frequency as it is written behind it."""
    return None if hz is None else show_bound(hz, error, known).replace(" ", NO_BREAK)


def _show_hz(value: float) -> str:
    return f"{value:.5g}"


def _show_mac(value: float) -> str:
    return f"{value:.3f}"


def _show_signed(share: float) -> str:
    return f"{100.0 * share:+.2f} %"


_MODE_COLUMNS: tuple[Column[CorrelatedMode], ...] = (
    Column(lambda row: row.label, "name", "name", "Name"),
    Column(
        lambda row: row.measured_hz, "measured [Hz]", ">measured Hz", "Measured [Hz]", show=_show_hz
    ),
    Column(
        lambda row: _show_error(
            row.measured_hz if row.measured_error_hz is not None else None, row.measured_error_hz
        ),
        screen="<±",
        report="±",
    ),
    Column(lambda row: row.measured_error_hz, "measured ± [Hz]"),
    Column(lambda row: row.number, "computed mode", ">mode", "Mode"),
    Column(
        lambda row: row.computed_hz, "computed [Hz]", ">computed Hz", "Computed [Hz]", show=_show_hz
    ),
    Column(
        lambda row: _show_error(row.computed_hz, row.computed_error_hz, row.computed_known_hz),
        screen="<±",
        report="±",
    ),
    Column(lambda row: row.computed_error_hz, "computed ± [Hz]"),
    Column(lambda row: row.deviation, "deviation", ">deviation", "Deviation", show=_show_signed),
    Column(
        lambda row: row.measured_damping,
        "measured damping ratio",
        ">damping, measured",
        "Damping, measured",
        show=show_damping,
    ),
    Column(
        lambda row: row.computed_damping,
        "computed damping ratio",
        ">computed",
        "Damping, computed",
        show=show_damping,
    ),
    Column(lambda row: row.phase_collinearity, "MPC", "", "MPC", show=_show_mac),
    Column(lambda row: row.mac, "MAC", ">MAC", "MAC", show=_show_mac),
    Column(
        lambda row: row.cross_orthogonality,
        "cross-orthogonality",
        ">cross-orth.",
        "Cross-orthogonality",
        show=_show_mac,
    ),
    Column(lambda row: row.text, "mode", "mode", "Mode shape"),
)


@dataclass(frozen=True)
class ChannelLine:
    """A channel as a row."""

    point: str
    direction: str
    comac: float | None
    ecomac: float | None
    distance: float | None


_CHANNEL_COLUMNS: tuple[Column[ChannelLine], ...] = (
    Column(lambda row: row.point, "point", "point", "Point"),
    Column(lambda row: row.direction, "direction", "direction", "Direction"),
    Column(lambda row: row.comac, "CoMAC", ">CoMAC", "CoMAC", show=_show_mac),
    Column(lambda row: row.ecomac, "eCoMAC", ">eCoMAC", "eCoMAC", show=_show_mac),
    Column(
        lambda row: None if row.distance is None else 1e3 * row.distance,
        "distance from the surface [mm]",
        ">off the surface mm",
        "Off the surface [mm]",
        digits=3,
    ),
)


def list_channels(found: Correlation) -> list[ChannelLine]:
    """Return the channels, the one that agrees least first."""
    agreement = found.agreement
    lines = [
        ChannelLine(
            *response_channel(channel),
            find_known(comac),
            find_known(ecomac),
            found.distances.get(channel.point),
        )
        for channel, comac, ecomac in zip(
            found.channels, agreement.comac, agreement.ecomac, strict=True
        )
    ]
    return sorted(lines, key=lambda line: -(line.ecomac or 0.0))


@dataclass(frozen=True)
class ResponseLine:
    """A frequency response as a row.

    Attributes:
        share: Its root mean square over the largest one under the same force.
    """

    motion: str
    force: str
    frac: float
    share: float


_RESPONSE_COLUMNS: tuple[Column[ResponseLine], ...] = (
    Column(lambda row: row.motion, "motion", "motion", "Motion"),
    Column(lambda row: row.force, "force", "force", "Force"),
    Column(lambda row: row.frac, "FRAC", ">FRAC", "FRAC", show=_show_mac),
    Column(lambda row: row.share, "size", ">size", "Size", show=show_percent),
)


def list_responses(found: Correlation) -> list[ResponseLine]:
    """Return the measured responses, the one that agrees least first."""
    if found.responses is None:
        return []
    curves, frac = found.responses.measured, found.responses.frac
    shares = found.responses.shares
    lines = [
        ResponseLine(
            " ".join(output), " ".join(given), float(frac[row, column]), float(shares[row, column])
        )
        for row, output in enumerate(curves.outputs)
        for column, given in enumerate(curves.inputs)
        if math.isfinite(frac[row, column])
    ]
    return sorted(lines, key=lambda line: (line.share < LEAST_SHARE, line.frac))


def shorten(listing: Listing[Any]) -> tuple[Listing[Any], int]:
    """Return a table as it is shown: columns that say something, and of those that begin with the worst the
    first rows; and how many rows are left out.
    """
    rows = list(listing.rows)
    columns = [
        column for column in listing.columns if any(column.value(row) is not None for row in rows)
    ]
    most = len(rows) if listing.name == "pairs" else MOST_ROWS
    shown = dataclasses.replace(listing, columns=columns, rows=rows[:most])
    return shown, max(0, len(rows) - most)


def list_correlation_tables(found: Correlation) -> Iterator[Listing[Any]]:
    """Yield what is tabled of a correlation, complete."""
    yield Listing(
        f"Measured modes of {found.test} and modes of {found.scene} in pose {found.pose}",
        _MODE_COLUMNS,
        found.modes,
        "pairs",
    )
    if found.pairs:
        yield Listing(
            "Channels that agree least", _CHANNEL_COLUMNS, list_channels(found), "channels"
        )
    if responses := list_responses(found):
        yield Listing(
            "Frequency responses that agree least", _RESPONSE_COLUMNS, responses, "responses"
        )
