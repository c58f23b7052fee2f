"""an undamped response exactly on a resonance has no value and says so; next to it every digit
counts.
"""

import numpy as np
import pytest

from common import approx
from headstock.geometry.frames import FloatArray
from headstock.solvers.linear.frequency_response import (
    evaluate_frf,
    prepare_frf,
    refine_grid,
    solve_frf,
)
from headstock.solvers.linear.modal_analysis import solve_modal
from headstock.solvers.second_order import SecondOrderSystem

pytestmark = pytest.mark.hard("H26")

CHANNEL = ("mass", "x")


def oscillator(hz: float, mass: float = 3.0) -> SecondOrderSystem:
    row: dict[tuple[str, str], FloatArray] = {CHANNEL: np.ones(1)}
    return SecondOrderSystem(
        np.eye(1) * mass, None, np.eye(1) * mass * (2.0 * np.pi * hz) ** 2, row, row, ("q",)
    )


@pytest.mark.parametrize("hz", [1.3, 80.0, 12345.6])
def test_on_the_resonance_the_frequency_is_flagged_and_no_number_given(hz: float) -> None:
    found = solve_frf(oscillator(hz), np.array([0.5 * hz, hz]), inputs=[CHANNEL], outputs=[CHANNEL])
    assert found.singular[:, 0, 0].tolist() == [False, True]
    assert np.isnan(found.receptance[1, 0, 0]) and not found.free_body.any()


@pytest.mark.parametrize("distance", [1e-1, 1e-3, 1e-5, 1e-7, 1e-9])
def test_beside_the_resonance_the_response_is_that_of_the_closed_form(distance: float) -> None:
    system = oscillator(80.0)
    ratios = np.array([1.0 - distance, 1.0 + distance])
    found = solve_frf(system, 80.0 * ratios, inputs=[CHANNEL], outputs=[CHANNEL]).receptance[
        :, 0, 0
    ]
    omega = 2.0 * np.pi * 80.0 * ratios
    resonance = np.sqrt(system.stiffness[0, 0] / system.mass[0, 0])
    expected = 1.0 / (system.mass[0, 0] * (resonance - omega) * (resonance + omega))
    np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_a_resonance_that_does_not_reach_a_port_flags_only_the_others() -> None:
    stiffness = 1e6 * np.array([[2.0, -1.0], [-1.0, 2.0]])
    rows = {("both", "x"): np.array([1.0, 1.0]), ("first", "x"): np.array([1.0, 0.0])}
    system = SecondOrderSystem(np.eye(2), None, stiffness, rows, rows, ("a", "b"))
    second = solve_modal(system).frequencies_hz[1]
    found = solve_frf(system, np.array([second]), inputs=list(rows), outputs=list(rows))
    assert found.singular[0].tolist() == [[False, False], [False, True]]
    assert found.receptance[0, 0, 0] == approx(2.0 / (1e6 - 3e6), rel=1e-9)


def test_the_adaptive_grid_keeps_off_undamped_resonances() -> None:
    system = oscillator(80.0)
    model = prepare_frf(system, inputs=[CHANNEL], outputs=[CHANNEL])
    grid = refine_grid(np.linspace(0.0, 160.0, 17, dtype=np.float64), model.form.poles())
    found = evaluate_frf(model, grid)
    # 80 Hz is a point of the even grid
    assert found.singular.sum() == 1 and np.isfinite(found.receptance[~found.singular]).all()
    assert np.abs(np.delete(grid, np.flatnonzero(grid == 80.0)) / 80.0 - 1.0).min() == approx(
        1.25e-7, rel=1e-2
    )
