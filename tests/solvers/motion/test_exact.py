"""Deviation from a path: a mass on a spring in closed form, whatever the sampling, and its
parts.
"""

import numpy as np
import pytest

from common import approx
from headstock.geometry.frames import FloatArray
from headstock.solvers.motion.deviation import LowPass, filter_deviation, measure_zones
from headstock.solvers.motion.exact import PathModel, solve_path
from headstock.solvers.motion.set_points import Ramp, SetPoint, sample_times
from headstock.solvers.second_order import SecondOrderSystem

SOURCE, TIP = ("path", "acceleration"), ("tip", "x")
MASS, HZ, ZETA = 35.0, 78.6, 0.02
OMEGA = 2.0 * np.pi * HZ
MOVE = SetPoint(0.08, 0.05, Ramp("linear", 0.1))
MODEL = PathModel(SOURCE, (TIP,), low_frequency_limit_hz=10.0)


def oscillator(zeta: float = ZETA, soft_hz: float | None = None) -> SecondOrderSystem:
    """A mass on a spring whose foot moves; with a soft frequency, on a second mass that is softly
    mounted.
    """
    stiffness = MASS * OMEGA**2
    if soft_hz is None:
        damping = np.array([[2.0 * zeta * MASS * OMEGA]]) if zeta else None
        row: FloatArray = np.ones(1)
        return SecondOrderSystem(
            np.array([[MASS]]),
            damping,
            np.array([[stiffness]]),
            {SOURCE: -MASS * row},
            {TIP: row},
            ("tip",),
        )
    base = 600.0
    mount = (base + MASS) * (2.0 * np.pi * soft_hz) ** 2
    matrix = np.array([[stiffness, -stiffness], [-stiffness, stiffness + mount]])
    load: FloatArray = np.array([-MASS, 0.0])
    row = np.array([1.0, -1.0])
    return SecondOrderSystem(
        np.diag([MASS, base]), None, matrix, {SOURCE: load}, {TIP: row}, ("tip", "base")
    )


def step_answer(times: FloatArray) -> FloatArray:
    """Closed form: each jump of the acceleration starts a damped oscillation around its new
    quasi-static place.
    """
    found = np.zeros_like(times)
    decay, turn = ZETA * OMEGA, OMEGA * np.sqrt(1.0 - ZETA**2)
    for begin, jump in zip((0.0, 0.1, 1.6, 1.7), (0.5, -0.5, -0.5, 0.5), strict=True):
        since = np.maximum(times - begin, 0.0)
        swing = np.exp(-decay * since) * (
            np.cos(turn * since) + decay / turn * np.sin(turn * since)
        )
        found -= np.where(times >= begin, jump / OMEGA**2 * (1.0 - swing), 0.0)
    return found


@pytest.mark.parametrize("sampling_hz", [2500.0, 1234.5, 77.0])
def test_a_mass_on_a_spring_follows_its_closed_form_whatever_the_sampling(
    sampling_hz: float,
) -> None:
    samples = sample_times(MOVE, sampling_hz, 0.3)
    found = solve_path(oscillator(), MODEL, MOVE, samples)
    np.testing.assert_allclose(found.total[:, 0], step_answer(samples), atol=1e-10 * 0.5 / OMEGA**2)


def test_the_parts_add_up_and_the_quasi_static_one_is_inertia_over_stiffness() -> None:
    found = solve_path(oscillator(soft_hz=1.2), MODEL, MOVE, sample_times(MOVE, 2500.0, 0.3))
    np.testing.assert_allclose(
        found.quasi_static + found.low_frequency + found.dynamic, found.total, atol=1e-22
    )
    # on the soft mount the base is accelerated too: the spring carries the reduced mass
    plateau = found.quasi_static[100, 0]
    assert plateau == approx(-0.5 * 600.0 / 635.0 / OMEGA**2, rel=1e-3)
    assert np.abs(found.low_frequency).max() > 0.0
    assert np.abs(solve_path(oscillator(), MODEL, MOVE, found.times).low_frequency).max() == 0.0


def test_figures_of_a_zone_are_those_of_the_closed_form() -> None:
    found = solve_path(oscillator(), MODEL, MOVE, sample_times(MOVE, 25_000.0, 0.6))
    first, second = measure_zones(found, found, MOVE, 0, 0.3)
    static = 0.5 / OMEGA**2
    overshoot = 1.0 + np.exp(-np.pi * ZETA / np.sqrt(1.0 - ZETA**2))
    assert first.ramp_peak == approx(-overshoot * static, rel=1e-4)
    assert first.quasi_static == approx(-static, rel=1e-12)
    assert (first.begin, first.ramp_end, first.end) == approx((0.0, 0.1, 0.4))
    assert second.quasi_static == approx(static, rel=1e-12)
    # the residual vibration of both jumps falls below 5 % of its largest value after ln(20) / (zeta
    # omega), within a swing or two
    assert first.settling == approx(np.log(20.0) / (ZETA * OMEGA), abs=2.0 / HZ)


def test_ringing_without_damping_never_settles() -> None:
    found = solve_path(oscillator(zeta=0.0), MODEL, MOVE, sample_times(MOVE, 2500.0, 0.3))
    assert measure_zones(found, found, MOVE, 0, 0.3)[0].settling is None


@pytest.mark.parametrize("kind", ["zero_phase", "causal"])
def test_a_low_pass_keeps_what_is_slow_and_takes_what_is_fast(kind: str) -> None:
    times = np.arange(5000) / 2500.0
    low_frequency, fast = (
        np.sin(2.0 * np.pi * 20.0 * times)[:, None],
        np.sin(2.0 * np.pi * 1000.0 * times)[:, None],
    )
    raw = solve_path(oscillator(), MODEL, MOVE, times)
    mixed = type(raw)(
        times, low_frequency + fast, low_frequency, np.zeros_like(low_frequency), fast
    )
    found = filter_deviation(mixed, LowPass(300.0, "causal" if kind == "causal" else "zero_phase"))
    middle = slice(500, -500)
    # a causal one delays by 2.6134 / (2 pi 300 Hz) = 1.39 ms
    late = low_frequency if kind == "zero_phase" else np.roll(low_frequency, 3, axis=0)
    np.testing.assert_allclose(found.total[middle], late[middle], atol=0.03)
    np.testing.assert_allclose(
        found.quasi_static + found.low_frequency + found.dynamic, found.total, atol=1e-15
    )
    assert np.abs(found.dynamic[middle]).max() < 5e-3
