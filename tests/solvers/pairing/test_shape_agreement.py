"""Measured shapes and responses are compared with computed ones by channel, mode and frequency."""

import numpy as np
import scipy.linalg

from common import approx
from headstock.geometry.frames import FloatArray
from headstock.solvers.pairing.mode_pairing import ModeSet, correlate_modes, pair_modes
from headstock.solvers.pairing.shape_agreement import (
    agree_by_channel,
    cross_orthogonality,
    domain_assurance,
    fit_scale,
    response_assurance,
)
from headstock.solvers.pairing.shape_expansion import expand_by_modes, expand_by_stiffness
from headstock.solvers.second_order import ComplexArray


def chain(count: int = 20) -> tuple[FloatArray, FloatArray]:
    """Stiffness and mass of a chain of unequal masses, fixed at one end."""
    stiffness = 2e6 * np.eye(count) - 1e6 * (np.eye(count, k=1) + np.eye(count, k=-1))
    stiffness[-1, -1] = 1e6
    return stiffness, np.diag(np.linspace(1.0, 2.0, count))


def solve_modes(stiffness: FloatArray, mass: FloatArray) -> tuple[FloatArray, FloatArray]:
    squares, shapes = scipy.linalg.eigh(stiffness, mass)
    return np.sqrt(squares) / (2.0 * np.pi), shapes


def spread(shapes: FloatArray, seed: int = 1) -> ComplexArray:
    """The same shapes, each of another size and phase."""
    random = np.random.default_rng(seed)
    count = shapes.shape[1]
    return shapes * (random.uniform(0.2, 5.0, count) * np.exp(1j * random.uniform(0, 6, count)))


def test_complex_shapes_pair_whatever_their_size_and_phase() -> None:
    hz, shapes = solve_modes(*chain())
    order = [2, 0, 1, 3]
    measured = spread(shapes[:, order])
    pairs = pair_modes(ModeSet(hz[:4] * 1.1, measured), ModeSet(hz[:6], shapes[:, :6]))
    assert [(pair.first, pair.second) for pair in pairs] == list(enumerate(order))
    assert [pair.correlation for pair in pairs] == approx([1.0] * 4)
    assert np.diag(correlate_modes(shapes, shapes)) == approx(np.ones(20))


def test_scale_factor_brings_a_shape_back() -> None:
    _, shapes = solve_modes(*chain())
    measured = spread(shapes[:, :5])
    assert measured * fit_scale(measured, shapes[:, :5]) == approx(shapes[:, :5])


def test_a_turned_channel_shows_in_the_enhanced_criterion_and_a_scaled_one_in_both() -> None:
    _, shapes = solve_modes(*chain())
    measured = spread(shapes[:, :6])
    comac, ecomac = agree_by_channel(measured, shapes[:, :6])
    assert comac == approx(np.ones(20))
    assert ecomac == approx(np.zeros(20), abs=1e-12)
    measured[7] *= -1.0
    _, ecomac = agree_by_channel(measured, shapes[:, :6])
    assert np.argmax(ecomac) == 7
    assert ecomac[7] > 0.9
    swapped = spread(shapes[:, :6])
    swapped[[3, 15]] = swapped[[15, 3]]
    worst = np.argsort(agree_by_channel(swapped, shapes[:, :6])[0])[:2]
    assert set(worst) == {3, 15}


def test_expansion_by_modes_gives_modes_back_from_few_channels() -> None:
    _, shapes = solve_modes(*chain())
    rows = np.eye(20)[[2, 5, 9, 13, 19]]
    expanded = expand_by_modes(rows @ spread(shapes[:, :3]), rows, shapes[:, :4])
    assert np.diag(correlate_modes(expanded, shapes[:, :3])) == approx(np.ones(3))


def test_static_expansion_is_that_of_guyan_and_dynamic_expansion_is_exact_for_modes() -> None:
    stiffness, mass = chain()
    hz, shapes = solve_modes(stiffness, mass)
    kept, left = np.array([3, 8, 14, 19]), np.setdiff1d(np.arange(20), [3, 8, 14, 19])
    rows = np.eye(20)[kept]
    measured = spread(shapes[:, :3])[kept]
    guyan = -np.linalg.solve(
        stiffness[np.ix_(left, left)], stiffness[np.ix_(left, kept)] @ measured
    )
    static = expand_by_stiffness(measured, rows, stiffness, mass, frequencies_hz=hz[:3])
    assert static[kept] == approx(measured)
    assert static[left] == approx(guyan, rel=1e-5)
    dynamic = expand_by_stiffness(
        measured, rows, stiffness, mass, frequencies_hz=hz[:3], dynamic=True
    )
    assert dynamic == approx(spread(shapes[:, :3]), rel=1e-7)


def test_channels_that_others_imply_and_free_motions_do_not_spoil_an_expansion() -> None:
    stiffness, mass = chain()
    stiffness[0, 0] = 1e6  # nothing holds the chain
    hz, shapes = solve_modes(stiffness, mass)
    rows = np.eye(20)[[0, 0, 5, 10, 14, 14, 19]]
    measured = rows @ shapes[:, 1:3]
    static = expand_by_stiffness(measured, rows, stiffness, mass, frequencies_hz=hz[1:3])
    assert rows @ static == approx(measured, abs=1e-9)
    assert np.diag(correlate_modes(static, shapes[:, 1:3])).min() > 0.98


def test_cross_orthogonality_is_one_on_the_pairs_and_small_beside_them() -> None:
    stiffness, mass = chain()
    hz, shapes = solve_modes(stiffness, mass)
    table = cross_orthogonality(spread(shapes[:, :4]), shapes[:, :6], mass)
    assert table == approx(np.eye(4, 6), abs=1e-10)
    rows = np.eye(20)[[2, 5, 9, 13, 16, 19]]
    expanded = expand_by_stiffness(
        rows @ shapes[:, :4], rows, stiffness, mass, frequencies_hz=hz[:4]
    )
    table = cross_orthogonality(expanded, shapes[:, :6], mass)
    assert np.diag(table).min() > 0.97
    assert (table - np.diag(np.diag(table)) @ np.eye(4, 6)).max() < 0.2


def respond(hz: FloatArray, shapes: FloatArray, lines: FloatArray) -> ComplexArray:
    """Receptances of all coordinates to forces at the first and the last one."""
    squares, omega = (2 * np.pi * hz) ** 2, 2 * np.pi * lines
    poles = 1.0 / (squares * (1 + 0.02j) - omega[:, None] ** 2)
    return np.asarray(np.einsum("ik,lk,jk->lij", shapes, poles, shapes[[0, -1]]), dtype=complex)


def test_response_criteria_are_one_for_equal_curves_and_leave_out_what_was_not_measured() -> None:
    hz, shapes = solve_modes(*chain())
    lines: FloatArray = np.linspace(5.0, 60.0, 80, dtype=np.float64)
    computed = respond(hz, shapes, lines)
    measured = computed * 0.7
    measured[:, 4, 1] = np.nan
    table = response_assurance(measured, computed)
    assert np.isnan(table[4, 1])
    assert np.delete(table.ravel(), 9) == approx(np.ones(39))
    assert np.diag(domain_assurance(measured, computed)) == approx(np.ones(80))
    # a softer machine: the same operating shapes at lower lines
    softer = respond(0.9 * hz, shapes, lines) * 1.3
    assert response_assurance(softer, computed).max() < 0.9
    ridge = domain_assurance(softer, computed)
    peak = int(np.argmin(np.abs(lines - hz[2])))
    assert lines[np.argmax(ridge[:, peak])] == approx(0.9 * lines[peak], rel=0.02)
