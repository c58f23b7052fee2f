"""a peak a millionth as wide as its frequency is found in place and height, whatever grid was
asked for.
"""

import dataclasses

import numpy as np
import pytest

from common import approx
from headstock.solvers.linear.damping import solve_damped
from headstock.solvers.linear.frequency_response import (
    evaluate_frf,
    find_stability_figures,
    prepare_frf,
    refine_grid,
)
from headstock.solvers.second_order import SecondOrderSystem

pytestmark = pytest.mark.hard("H27")

CHANNEL = ("end", "x")
SIZE = 6


def chain(zeta: float) -> SecondOrderSystem:
    """Masses in a row, each on a spring and a damper of its own to ground, so that damping couples
    the modes.
    """
    springs = 1e6 * np.linspace(1.0, 3.0, SIZE)
    stiffness = np.diag(springs) + 4e6 * (
        2.0 * np.eye(SIZE) - np.eye(SIZE, k=1) - np.eye(SIZE, k=-1)
    )
    row = {CHANNEL: np.eye(SIZE)[-1]}
    dampers = 2.0 * zeta * np.diag(np.linspace(0.5, 1.5, SIZE)) * np.sqrt(4e6)
    return SecondOrderSystem(np.eye(SIZE), dampers, stiffness, row, row, ("q",) * SIZE)


@pytest.mark.parametrize("zeta", [1e-6, 1e-4, 1e-2])
@pytest.mark.parametrize("points", [11, 97])
def test_every_peak_stands_where_its_complex_mode_says_and_as_high(
    zeta: float, points: int
) -> None:
    system = chain(zeta)
    model = prepare_frf(system, inputs=[CHANNEL], outputs=[CHANNEL])
    assert model.form.evaluate(np.ones(1)).shape == (1, 1, 1)
    grid = refine_grid(np.linspace(0.0, 900.0, points, dtype=np.float64), model.form.poles())
    size = np.abs(evaluate_frf(model, grid).receptance[:, 0, 0])
    damped = solve_damped(system)
    for pole, hz in zip(damped.poles, damped.frequencies_hz, strict=True):
        width = -pole.real / (2.0 * np.pi)
        near = np.flatnonzero(np.abs(grid - hz) <= 5.0 * width)
        top = near[np.argmax(size[near])]
        fine = np.linspace(hz - 3.0 * width, hz + 3.0 * width, 501)
        height = np.abs(model.direct.evaluate(2.0 * np.pi * fine)[:, 0, 0]).max()
        assert size[top] == approx(height, rel=1e-2)
        assert grid[top] == approx(hz, rel=max(1e-4, zeta))


def test_the_even_grid_alone_misses_the_peak() -> None:
    model = prepare_frf(chain(1e-6), inputs=[CHANNEL], outputs=[CHANNEL])
    base = np.linspace(0.0, 900.0, 97, dtype=np.float64)
    even = np.abs(evaluate_frf(model, base).receptance).max()
    refined = np.abs(evaluate_frf(model, refine_grid(base, model.form.poles())).receptance).max()
    assert refined > 1000.0 * even


def test_peaks_of_structural_damping_are_found_as_well() -> None:
    eta = 2e-6
    system = chain(0.0)
    system = dataclasses.replace(system, damping=None, hysteretic=eta * system.stiffness)
    model = prepare_frf(system, inputs=[CHANNEL], outputs=[CHANNEL])
    grid = refine_grid(np.linspace(0.0, 900.0, 31, dtype=np.float64), model.form.poles())
    response = evaluate_frf(model, grid)
    (figures,) = find_stability_figures(model, response)
    eigenvalues, shapes = np.linalg.eigh(system.stiffness)
    heights = shapes[-1] ** 2 / (eta * eigenvalues)
    assert 1.0 / figures.minimum_dynamic_stiffness == approx(heights.max(), rel=1e-3)
    assert figures.most_negative_real == approx(-0.5 * heights.max(), rel=1e-3)
