"""Modes of a test in rows."""

from typing import NamedTuple

from headstock.app.tables.table import Column, Listing, find_known
from headstock.app.texts.bounded_values import show_bound, show_damping_error
from headstock.studies.correlation.modal_fit import ModalFit


class _ModeRow(NamedTuple):
    """A mode of a fit."""

    fit: ModalFit
    place: int

    @property
    def hz(self) -> float:
        """Undamped natural frequency [Hz]."""
        return float(self.fit.modes.frequencies_hz[self.place])

    @property
    def error_hz(self) -> float | None:
        """± of it [Hz]."""
        return find_known(self.fit.frequency_errors[self.place])

    @property
    def damping(self) -> float | None:
        """Damping ratio."""
        return find_known(self.fit.modes.damping[self.place])

    @property
    def damping_error(self) -> float | None:
        """± of it."""
        return find_known(self.fit.damping_errors[self.place])

    @property
    def damping_texts(self) -> tuple[str, str]:
        """Damping ratio and its ± as they are written."""
        return show_damping_error(self.damping, self.damping_error, rigid=False)


def _show_share(value: float) -> str:
    return f"{value:.3f}"


_COLUMNS: tuple[Column[_ModeRow], ...] = (
    Column(lambda row: row.place + 1, "mode", ">mode"),
    Column(lambda row: row.hz, "undamped [Hz]", ">undamped Hz", error=lambda row: row.error_hz),
    Column(lambda row: show_bound(row.hz, row.error_hz), screen="<± Hz"),
    Column(lambda row: row.error_hz, "± [Hz]"),
    Column(lambda row: row.damping_texts[0], screen=">damping"),
    Column(lambda row: row.damping_texts[1], screen="<±"),
    Column(lambda row: row.damping, "damping ratio"),
    Column(lambda row: row.damping_error, "± of damping ratio"),
    Column(
        lambda row: float(row.fit.collinearity[row.place]),
        "phase collinearity",
        ">phase collinearity",
        show=_show_share,
    ),
    Column(
        lambda row: find_known(row.fit.one_shape[row.place]),
        "share of one shape",
        ">one shape",
        show=_show_share,
    ),
)


def list_modes(fit: ModalFit) -> Listing[_ModeRow]:
    """Return the modes of a fit as a table."""
    rows = [_ModeRow(fit, place) for place in range(len(fit.modes.frequencies_hz))]
    return Listing("Modes of the test, ± at 95 %", _COLUMNS, rows, "modes")
