"""Rational steps follow slow motions and forget fast ones."""

import numpy as np

from common import approx
from headstock.solvers.state_spaces.rational_steps import find_step_error, list_poles


def test_a_step_is_of_twelfth_order_and_close_at_half_the_sampling_rate() -> None:
    coarse, fine = find_step_error(2.0), find_step_error(1.0)
    assert np.log2(coarse / fine) == approx(12.0, abs=0.3)
    assert find_step_error(0.8 * np.pi) < 3e-7 and find_step_error(np.pi) < 5e-6


def test_no_motion_grows_and_a_fast_one_vanishes() -> None:
    angles = np.geomspace(1e-3, 1e5, 200)[:, None]
    poles = list_poles()
    assert len(poles) == 3
    at, share = poles[:, 0] + 1j * poles[:, 1], poles[:, 2] + 1j * poles[:, 3]
    factors = np.abs(
        (share / (1j * angles - at) + share.conj() / (1j * angles - at.conj())).sum(axis=1)
    )
    assert factors.max() < 1.0 + 1e-12 and factors[-1] < 1e-3
