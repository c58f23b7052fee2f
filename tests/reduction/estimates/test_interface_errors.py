"""How far a response may be off between a machine that is too stiff and one that is too soft."""

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.reduction.estimates.model_errors import FormResponse, bound_response_changes
from headstock.solvers.second_order import ComplexArray

ZETA = 0.004


def receptance(squares: FloatArray, lines_hz: FloatArray) -> ComplexArray:
    """Of two unit masses side by side, ``(n, 1, 1)``."""
    own = np.sqrt(squares)
    omega = 2.0 * np.pi * lines_hz[:, None]
    return np.asarray((1.0 / (squares - omega**2 + 2j * ZETA * own * omega)).sum(axis=1))[
        :, None, None
    ]


def in_form(squares: FloatArray, lines_hz: FloatArray) -> FormResponse:
    peaks = np.sqrt(squares) / (2.0 * np.pi)
    return FormResponse(receptance(squares, lines_hz), peaks, receptance(squares, peaks))


def test_whatever_lies_between_both_forms_lies_within_the_bound() -> None:
    lines = np.linspace(1.0, 160.0, 400, dtype=np.float64)
    stiff, soft = ((2.0 * np.pi * np.array(hz)) ** 2 for hz in ((97.0, 140.0), (90.0, 138.0)))
    plain = receptance((2.0 * np.pi * np.array([110.0, 150.0])) ** 2, lines)
    bounds = bound_response_changes(plain, lines, [in_form(stiff, lines), in_form(soft, lines)])
    between = [stiff + share * (soft - stiff) for share in np.linspace(0.0, 1.0, 41)]
    changes = [np.abs(receptance(squares, lines) - plain) for squares in between]
    assert (np.max(changes, axis=0) <= 1.02 * bounds).all()
    # away from peaks that move it is the larger of both changes
    far = (lines < 85.0) | (lines > 145.0)
    ends = [np.abs(receptance(squares, lines) - plain) for squares in (stiff, soft)]
    np.testing.assert_allclose(bounds[far], np.maximum(*ends)[far])


def test_an_undamped_peak_that_passes_leaves_no_bound() -> None:
    lines = np.array([10.0, 93.0, 120.0])
    forms = [
        FormResponse(np.ones((3, 1, 1), dtype=complex), np.array([hz]), np.full((1, 1, 1), np.nan))
        for hz in (97.0, 90.0)
    ]
    bounds = bound_response_changes(np.zeros((3, 1, 1), dtype=complex), lines, forms)
    np.testing.assert_array_equal(np.isnan(bounds[:, 0, 0]), [False, True, False])
