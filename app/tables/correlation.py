"""A measured machine beside its model in rows: modes, channels, responses."""

import dataclasses
import itertools
import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from headstock.app.tables.table import (
    Column,
    Listing,
    show_percent,
)
from headstock.app.texts.bounded_values import show_bound, show_damping
from headstock.studies.correlation.correlation import (
    ComparedChannel,
    CorrelatedMode,
    Correlation,
)
from headstock.studies.correlation.responses import ComparedResponses, response_channel

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
    Column(lambda row: row.name, "mode", "mode", "Mode shape"),
    Column(lambda row: row.remark, "remark", "remark", "Remark"),
)


_CHANNEL_COLUMNS: tuple[Column[ComparedChannel], ...] = (
    Column(lambda row: response_channel(row.channel)[0], "point", "point", "Point"),
    Column(lambda row: response_channel(row.channel)[1], "direction", "direction", "Direction"),
    Column(lambda row: row.comac, "CoMAC", ">CoMAC", "CoMAC", show=_show_mac),
    Column(lambda row: row.ecomac, "eCoMAC", ">eCoMAC", "eCoMAC", show=_show_mac),
    Column(
        lambda row: None if row.distance_m is None else 1e3 * row.distance_m,
        "distance from the surface [mm]",
        ">off the surface mm",
        "Off the surface [mm]",
        digits=3,
    ),
)


type _ResponseRow = tuple[str, str, float, float]  # motion, force, FRAC, share


_RESPONSE_COLUMNS: tuple[Column[_ResponseRow], ...] = (
    Column(lambda row: row[0], "motion", "motion", "Motion"),
    Column(lambda row: row[1], "force", "force", "Force"),
    Column(lambda row: row[2], "FRAC", ">FRAC", "FRAC", show=_show_mac),
    Column(lambda row: row[3], "size", ">size", "Size", show=show_percent),
)


def _list_responses(found: Correlation) -> list[_ResponseRow]:
    """Return the measured responses, each with its root mean square over the largest one under the same
    force, the one that agrees least first.
    """
    if found.responses is None:
        return []
    curves, frac, shares = found.responses.measured, found.responses.frac, found.responses.shares
    rows = [
        (" ".join(output), " ".join(given), float(frac[place]), float(shares[place]))
        for place, (output, given) in zip(
            np.ndindex(frac.shape), itertools.product(curves.outputs, curves.inputs), strict=True
        )
        if math.isfinite(frac[place])
    ]
    return sorted(rows, key=lambda row: (row[3] < LEAST_SHARE, row[2]))


def describe_response_errors(responses: ComparedResponses) -> str:
    """Say how large ± of the computed responses is, and what it is without."""
    shares = responses.error_shares
    without = "; ".join(responses.left_out)
    if not len(shares):
        return f"± of computed responses is not known ({without or 'nothing has a mesh'})"
    half, most = (f"{100.0 * share:.2g} %" for share in np.percentile(shares, (50, 95)))
    text = f"± of computed responses: at most {half} on half of the lines, {most} on 95 %"
    return f"{text}; without {without}" if without else text


def shorten(listing: Listing[Any]) -> tuple[Listing[Any], int]:
    """Return a table as it is shown: columns that say something, and of those that begin with the worst the
    first rows; and how many rows are left out.
    """
    rows = list(listing.rows)
    columns = [
        column
        for column in listing.columns
        if any(column.value(row) not in (None, "") for row in rows)
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
        channels = sorted(found.list_channels(), key=lambda row: -(row.ecomac or 0.0))
        yield Listing("Channels that agree least", _CHANNEL_COLUMNS, channels, "channels")
    if responses := _list_responses(found):
        yield Listing(
            "Frequency responses that agree least", _RESPONSE_COLUMNS, responses, "responses"
        )
