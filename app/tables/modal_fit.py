"""Modes of a test in rows."""

from headstock.app.tables.table import Column, Listing
from headstock.app.texts.bounded_values import show_bound, show_damping_error
from headstock.studies.correlation.modal_fit import FittedMode, ModalFit

type _Row = tuple[int, FittedMode]  # with its number


def _show_share(value: float) -> str:
    return f"{value:.3f}"


def _show_damping(row: _Row) -> tuple[str, str]:
    """Damping ratio and its ± as they are written."""
    return show_damping_error(row[1].damping_ratio, row[1].damping_error, rigid=False)


_COLUMNS: tuple[Column[_Row], ...] = (
    Column(lambda row: row[0], "mode", ">mode"),
    Column(
        lambda row: row[1].frequency_hz,
        "undamped [Hz]",
        ">undamped Hz",
        error=lambda row: row[1].frequency_error_hz,
    ),
    Column(lambda row: show_bound(row[1].frequency_hz, row[1].frequency_error_hz), screen="<± Hz"),
    Column(lambda row: row[1].frequency_error_hz, "± [Hz]"),
    Column(lambda row: _show_damping(row)[0], screen=">damping"),
    Column(lambda row: _show_damping(row)[1], screen="<±"),
    Column(lambda row: row[1].damping_ratio, "damping ratio"),
    Column(lambda row: row[1].damping_error, "± of damping ratio"),
    Column(
        lambda row: row[1].phase_collinearity,
        "phase collinearity",
        ">phase collinearity",
        show=_show_share,
    ),
    Column(lambda row: row[1].one_shape, "share of one shape", ">one shape", show=_show_share),
)


def list_fitted_modes(fit: ModalFit) -> Listing[_Row]:
    """Return the modes of a fit as a table."""
    rows = list(enumerate(fit.list_modes(), 1))
    return Listing("Modes of the test, ± at 95 %", _COLUMNS, rows, "modes")
