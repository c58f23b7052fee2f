"""Poles are found by number, close ones apart, from one reference or in a part of the band; noise has
none, and ± holds the error.
"""

from typing import Any

import numpy as np
import pytest
from built_responses import KnownModes, add_noise, draw_modes, space_lines

from common import approx
from headstock.geometry.frames import FloatArray
from headstock.scene.test_data.records import ComplexArray
from headstock.solvers.modal_fitting.candidates import find_candidates
from headstock.solvers.modal_fitting.pole_fit import PoleFit, _split_bands, fit_poles
from headstock.solvers.modal_fitting.stabilisation import damping_ratios, label_poles

LINES = space_lines(20.0, 300.0, 400)


def respond(
    known: KnownModes, noise: float, forces: int, lines: FloatArray = LINES
) -> ComplexArray:
    return add_noise(known.respond(lines, forces), noise, 0)


def found_hz(fit: PoleFit, low: float = 0.0, high: float = np.inf) -> FloatArray:
    hz = np.abs(fit.model.poles) / (2.0 * np.pi)
    return hz[(hz > low) & (hz < high)]


def apart(low: float, high: float) -> KnownModes:
    """Two modes within 0.3 %, narrower apart than each is wide, between two others."""
    hz = np.array([low, 150.0, 150.45, high])
    shapes = np.random.default_rng(5).normal(size=(20, 4))
    return KnownModes(hz, np.array([0.01, 0.008, 0.012, 0.02]), shapes)


@pytest.mark.parametrize(("noise", "forces"), [(0.01, 2), (0.05, 2), (0.01, 1)])
def test_two_modes_within_three_per_mille_are_told_apart(noise: float, forces: int) -> None:
    known = apart(90.0, 220.0)
    fit = fit_poles(LINES, respond(known, noise, forces), order=24)
    assert len(fit.model.poles) == 4
    assert np.abs(found_hz(fit) / known.hz - 1.0).max() < 1e-3
    assert np.abs(damping_ratios(fit.model.poles) / known.damping - 1.0).max() < 0.15


def test_repeated_poles_have_two_shapes() -> None:
    known = apart(90.0, 220.0)
    same = KnownModes(np.array([90.0, 150.0, 150.0, 220.0]), np.full(4, 0.01), known.shapes)
    fit = fit_poles(LINES, respond(same, 0.01, 2), order=24)
    assert found_hz(fit) == approx(same.hz, rel=1e-3)
    pair = np.linalg.qr(fit.model.shapes[:, 1:3])[0]
    true = np.linalg.qr(known.shapes[:, 1:3])[0]
    assert np.linalg.svd(pair.conj().T @ true, compute_uv=False).min() > 0.99


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_a_band_that_cuts_through_modes_has_those_within_it(noise: float) -> None:
    known = draw_modes(1)
    lines = space_lines(100.0, 200.0, 250)
    fit = fit_poles(lines, respond(known, noise, 3, lines), order=24)
    inside = known.hz[(known.hz > 100.0) & (known.hz < 200.0)]
    assert found_hz(fit, 100.0, 200.0) == approx(inside, rel=1e-3)


@pytest.mark.parametrize("shape", [(400, 20, 3), (300, 1, 1)])
def test_noise_alone_has_no_modes(shape: tuple[int, int, int]) -> None:
    random = np.random.default_rng(3)
    values = random.normal(size=shape) + 1j * random.normal(size=shape)
    fit = fit_poles(space_lines(20.0, 300.0, shape[0]), values, order=20)
    assert len(fit.model.poles) == 0


def test_intervals_hold_the_errors(  # 60 numbers: of 95 %, at most 7 are outside with chance 0.02
) -> None:
    known, outside, count = draw_modes(4, 5), 0, 0
    lines = space_lines(20.0, 300.0, 250)
    for seed in range(12):
        values = add_noise(known.respond(lines, 2), 0.03, seed)
        fit = fit_poles(lines, values, order=16)
        errors = fit.model.poles.imag - 2.0 * np.pi * known.hz * np.sqrt(1.0 - known.damping**2)
        outside += int(np.sum(np.abs(errors) > 1.96 * np.sqrt(fit.covariances[:, 1, 1])))
        count += len(errors)
    assert count == 60
    assert outside <= 7


def test_known_noise_decides_the_intervals() -> None:
    known = draw_modes(4, 5)
    clean, values = known.respond(LINES, 2), respond(known, 0.02, 2)
    sizes = 0.02 * np.sqrt(np.mean(np.abs(clean) ** 2, axis=0)) * np.ones((len(LINES), 1, 1))
    fits = [fit_poles(LINES, values, order=20, deviations=factor * sizes) for factor in (2.0, 4.0)]
    first, second = (np.sqrt(fit.covariances[:, 1, 1]) for fit in fits)
    assert second == approx(2.0 * first, rel=0.02)


def test_a_pair_that_was_not_measured_is_left_out() -> None:
    known = draw_modes(2, 5)
    values = respond(known, 0.01, 2)
    values[:, 7, 1] = np.nan
    fit = fit_poles(LINES, values, order=20)
    assert found_hz(fit) == approx(known.hz, rel=1e-3)


def test_lines_that_mains_disturb_are_no_modes_and_hide_none() -> None:
    known = draw_modes(2, 5)
    values = respond(known, 0.01, 2)
    for line in (42, 185, 328):  # near 50, 150 and 250 Hz
        values[line - 1 : line + 2] += 0.3 * np.abs(values).max()
    fit = fit_poles(LINES, values, order=20)
    assert found_hz(fit) == approx(known.hz, rel=1e-3)


def test_responses_of_zero_have_no_modes() -> None:
    fit = fit_poles(LINES, np.zeros((len(LINES), 4, 2), dtype=np.complex128), order=8)
    assert len(fit.model.poles) == 0


def test_computational_poles_are_unstable_and_true_ones_are_labelled_stable() -> None:
    known = draw_modes(0)
    steps = find_candidates(LINES, respond(known, 0.01, 3), order=30)
    labels: Any = label_poles(steps)
    stable = np.abs(steps[-1].poles[labels[-1] == 4]) / (2.0 * np.pi)
    assert len(steps) == 30
    assert len(steps[-1].poles) > 3 * len(known.hz)
    assert 5 <= len(stable) <= len(known.hz) + 1
    distance = np.abs(stable[:, None] / known.hz - 1.0).min(axis=1)
    assert np.median(distance) < 0.01


def test_bands_cover_all_lines_once() -> None:
    bands = _split_bands(space_lines(5.0, 2000.0, 1600))
    assert len(bands) > 1
    assert bands[0][0] == 0
    assert bands[-1][1] == 1600
    assert [begin for begin, _ in bands[1:]] == [end for _, end in bands[:-1]]
    assert _split_bands(LINES[:100]) == [(0, 100)]
