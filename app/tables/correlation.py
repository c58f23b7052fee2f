"""A measured machine beside its model in rows: modes, channels, responses."""

import dataclasses
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from headstock.app.tables.table import Column, Listing, find_known, show_percent
from headstock.app.texts.bounded_values import show_bound, show_damping
from headstock.studies.correlation.correlation import CorrelatedMode, Correlation
from headstock.studies.correlation.responses import response_channel

NO_BREAK = "\u00a0"
MOST_ROWS = 12  # of tables that begin with the worst, on the screen and in the page; files have all
LEAST_SHARE = 0.03  # of the largest motion under a force: smaller responses are listed last


@dataclass(frozen=True, eq=False)
class ModeLine:
    """A measured mode, a computed one, or a pair, as a row: None where there is no number."""

    of: Correlation
    mode: CorrelatedMode

    @property
    def name(self) -> str | None:
        """Name of the measured mode; None without one."""
        place = self.mode.measured
        return None if place is None else self.of.mode_names[place] or None

    @property
    def measured_hz(self) -> float | None:
        """Measured frequency [Hz]."""
        place = self.mode.measured
        return None if place is None else float(self.of.measured.frequencies_hz[place])

    @property
    def measured_error_hz(self) -> float | None:
        """± of the measured frequency [Hz]."""
        place = self.mode.measured
        return None if place is None else find_known(self.of.fit.frequency_errors[place])

    @property
    def collinearity(self) -> float | None:
        """Modal phase collinearity of the measured shape."""
        place = self.mode.measured
        return None if place is None else find_known(self.of.fit.collinearity[place])

    @property
    def measured_damping(self) -> float | None:
        """Measured damping ratio."""
        place = self.mode.measured
        return None if place is None else find_known(self.of.measured.damping[place])

    @property
    def number(self) -> int | None:
        """Number of the computed mode, from 1."""
        place = self.mode.computed
        return None if place is None else self.of.number(place)

    @property
    def computed_hz(self) -> float | None:
        """Computed frequency [Hz]."""
        place = self.mode.computed
        return None if place is None else float(self.of.computed.frequencies_hz[place])

    @property
    def error_hz(self) -> float | None:
        """± of the computed frequency [Hz]; None where a source has no bound."""
        place = self.mode.computed
        return None if place is None else self.of.computed.error_hz[place]

    @property
    def error_text(self) -> str | None:
        """The same as it is written behind the frequency, with what is known of it."""
        place = self.mode.computed
        if place is None:
            return None
        known = self.of.computed.list_errors()[place].known
        return show_bound(self.computed_hz, self.error_hz, known).replace(" ", NO_BREAK)

    @property
    def measured_error_text(self) -> str | None:
        """± of the measured frequency as it is written behind it."""
        error = self.measured_error_hz
        return None if error is None else show_bound(self.measured_hz, error).replace(" ", NO_BREAK)

    @property
    def computed_damping(self) -> float | None:
        """Computed damping ratio."""
        place = self.mode.computed
        return None if place is None else self.of.computed.damping_ratio[place]

    @property
    def orthogonality(self) -> float | None:
        """Cross-orthogonality of a pair."""
        table, first, second = self.of.orthogonality, self.mode.measured, self.mode.computed
        return None if table is None or first is None or second is None else table[first, second]

    @property
    def text(self) -> str:
        """Name of the computed mode, and what is to be said of the pair."""
        name = "" if self.mode.computed is None else self.of.computed.mode_names[self.mode.computed]
        if self.mode.computed is None:
            return "missing in the model"
        if self.mode.measured is None:
            return f"{name}: not measured"
        return "; ".join([name, *self.mode.doubts])


def _show_hz(value: float) -> str:
    return f"{value:.5g}"


def _show_mac(value: float) -> str:
    return f"{value:.3f}"


def _show_signed(share: float) -> str:
    return f"{100.0 * share:+.2f} %"


_MODE_COLUMNS: tuple[Column[ModeLine], ...] = (
    Column(lambda row: row.name, "name", "name", "Name"),
    Column(
        lambda row: row.measured_hz, "measured [Hz]", ">measured Hz", "Measured [Hz]", show=_show_hz
    ),
    Column(lambda row: row.measured_error_text, screen="<±", report="±"),
    Column(lambda row: row.measured_error_hz, "measured ± [Hz]"),
    Column(lambda row: row.number, "computed mode", ">mode", "Mode"),
    Column(
        lambda row: row.computed_hz, "computed [Hz]", ">computed Hz", "Computed [Hz]", show=_show_hz
    ),
    Column(lambda row: row.error_text, screen="<±", report="±"),
    Column(lambda row: row.error_hz, "computed ± [Hz]"),
    Column(
        lambda row: row.mode.deviation, "deviation", ">deviation", "Deviation", show=_show_signed
    ),
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
    Column(lambda row: row.collinearity, "MPC", "", "MPC", show=_show_mac),
    Column(lambda row: row.mode.mac, "MAC", ">MAC", "MAC", show=_show_mac),
    Column(
        lambda row: row.orthogonality,
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


def list_mode_lines(found: Correlation) -> list[ModeLine]:
    """Return the pairs, then what is missing on either side."""
    return [ModeLine(found, mode) for mode in found.modes]


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
        list_mode_lines(found),
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
