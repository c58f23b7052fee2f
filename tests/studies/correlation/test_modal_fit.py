"""Modes fitted to responses are the true ones, no more and no fewer, with true intervals."""

import dataclasses

import numpy as np
import pytest
from built_responses import KnownModes, draw_modes, measure

from common import approx
from headstock.geometry.errors import HeadstockError
from headstock.solvers.pairing.mode_pairing import correlate_modes
from headstock.studies.correlation.modal_fit import ModalFit, _fit_responses


def compare(fit: ModalFit, known: KnownModes, *, most_hz: float, most_damping: float) -> None:
    """Check that a fit has all modes and no others, within shares of frequency and damping."""
    assert len(fit.modes.frequencies_hz) == len(known.hz)
    assert np.abs(fit.modes.frequencies_hz / known.hz - 1.0).max() < most_hz
    assert np.abs(fit.modes.damping / known.damping - 1.0).max() < most_damping


@pytest.mark.parametrize("seed", range(3))
def test_nine_modes_of_sixty_noisy_responses_are_found(seed: int) -> None:
    known = draw_modes(seed)
    fit = _fit_responses(measure(known, noise=0.01, seed=seed), order=30)
    compare(fit, known, most_hz=1e-3, most_damping=0.15)
    assert fit.modes.scaled
    assert np.diag(correlate_modes(fit.modes.shapes, known.shapes)).min() > 0.99
    turned = fit.modes.shapes * np.sign(np.sum(fit.modes.shapes.real * known.shapes, axis=0))
    assert np.abs(turned - known.shapes).max() < 0.1 * np.abs(known.shapes).max()
    assert fit.collinearity.min() > 0.95
    assert np.abs(fit.mean_phases).max() < 0.1
    assert fit.one_shape.min() > 0.95
    assert fit.assurance is not None
    assert fit.assurance.min() > 0.99


def test_a_test_with_one_motion_has_shapes_at_its_forces() -> None:
    known = draw_modes(1)
    given = measure(known, noise=0.01, seed=1)
    turned = dataclasses.replace(
        given, motions=given.forces, forces=given.motions, values=given.values.transpose(0, 2, 1)
    )
    fit = _fit_responses(turned, order=30)
    compare(fit, known, most_hz=1e-3, most_damping=0.15)
    assert fit.modes.channels == given.motions
    assert fit.synthesised is not None
    assert fit.synthesised.shape == turned.values.shape


def test_a_force_that_is_measured_against_its_direction_gives_the_same_shapes() -> None:
    known = draw_modes(2)
    given = measure(known, noise=0.01, seed=2, forces=2)
    against = dataclasses.replace(given.forces[0], direction=(0.0, 0.0, -1.0))
    values = given.values * np.array([-1.0, 1.0])
    turned = dataclasses.replace(given, forces=(against, given.forces[1]), values=values)
    fits = [_fit_responses(each, order=24) for each in (given, turned)]
    first, second = (fit.modes.shapes for fit in fits)
    assert first == approx(second, abs=1e-3 * np.abs(first).max())


def test_a_mode_that_hardly_moves_the_driving_point_has_a_doubtful_scale() -> None:
    known = draw_modes(3, 4)
    known.shapes[0] = np.where(np.arange(4) == 1, 0.02, 1.0)
    fit = _fit_responses(measure(known, noise=0.02, seed=3, forces=1), order=24)
    (remark,) = fit.remarks
    assert remark.startswith("mode 2 at 84.")
    assert "hardly moves the driving points: its scale is known to ±" in remark


def test_without_a_driving_point_shapes_have_no_scale() -> None:
    given = measure(draw_modes(0), noise=0.01, seed=0)
    elsewhere = dataclasses.replace(given, motions=given.motions[3:], values=given.values[:, 3:])
    fit = _fit_responses(elsewhere, order=24)
    assert not fit.modes.scaled
    assert np.abs(fit.modes.shapes).max(axis=0) == approx(1.0)
    assert "no driving point: shapes have no scale, their largest motion is 1" in fit.remarks


def test_few_lines_are_refused_by_name() -> None:
    with pytest.raises(HeadstockError, match="4 lines from 80 to 82 Hz, and a fit needs 20"):
        _fit_responses(measure(draw_modes(0), noise=0.01, seed=0), band=(80.0, 82.0))
