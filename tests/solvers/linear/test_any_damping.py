"""damping that couples modes, overdamped pairs and dashpots that swallow every wave.

Closed forms of one and two masses are in ``tests/solvers/linear/test_damping.py``.
"""

import dataclasses
import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common import approx, present
from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Material
from headstock.solvers.linear.damping import solve_damped
from headstock.solvers.linear.frequency_response import solve_frf
from headstock.solvers.second_order import SecondOrderSystem
from headstock.validation.parts.line_elements import TIP, rod_system
from headstock.validation.references.beam_theory import PrismaticBeam

pytestmark = pytest.mark.hard("H29")

ROD = PrismaticBeam(1.0, 0.05, 0.05, Material("nu0", 210e9, 0.0, 7850.0))
SPEED = np.sqrt(210e9 / 7850.0)
IMPEDANCE = ROD.area * np.sqrt(210e9 * 7850.0)


def plain_system(
    mass: FloatArray, damping: FloatArray | None, stiffness: FloatArray
) -> SecondOrderSystem:
    return SecondOrderSystem(mass, damping, stiffness, {}, {}, ("q",) * len(mass))


def test_only_the_diagonal_of_the_damping_would_give_other_poles() -> None:
    mass, stiffness = np.eye(2), np.array([[2e4, -1e4], [-1e4, 2e4]])
    damping = np.diag([200.0, 0.0])
    found = solve_damped(plain_system(mass, damping, stiffness)).poles
    characteristic = np.poly1d([1.0, 200.0, 2e4]) * np.poly1d([1.0, 0.0, 2e4]) - np.poly1d([1e8])
    expected = sorted((root for root in characteristic.roots if root.imag > 0.0), key=abs)
    np.testing.assert_allclose(found, expected, rtol=1e-6)
    diagonal = [complex(-50.0, np.sqrt(square - 2500.0)) for square in (1e4, 3e4)]
    assert min(float(abs(pole - other)) for pole, other in itertools.product(found, diagonal)) > 5.0


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6), st.floats(0.0, 1e4))
def test_conjugates_are_exact_overdamped_roots_are_kept_and_nothing_grows(
    seed: int, strength: float
) -> None:
    random = np.random.default_rng(seed)
    factor, lines = random.standard_normal((4, 4)), random.standard_normal((4, 2))
    system = plain_system(
        np.diag(random.uniform(0.5, 5.0, 4)),
        strength * lines @ lines.T,
        1e6 * (factor @ factor.T + np.eye(4)),
    )
    found = solve_damped(system)
    pairs, real = int((found.frequencies_hz > 0.0).sum()), int((found.frequencies_hz == 0.0).sum())
    assert 2 * pairs + real == 8
    assert found.poles.real.max() <= 1e-9 * np.abs(found.poles).max()
    assert (found.poles[found.frequencies_hz == 0.0].imag == 0.0).all()
    # the poles are those of the characteristic polynomial: their sum is the trace, minus M^-1 C
    total = (
        2.0 * found.poles[found.frequencies_hz > 0.0].real.sum()
        + found.poles[found.frequencies_hz == 0.0].real.sum()
    )
    expected = -np.trace(np.linalg.solve(system.mass, present(system.damping)))
    assert total == approx(expected, rel=1e-6, abs=1e-6 * np.abs(found.poles).max())


def test_a_dashpot_of_the_rod_s_impedance_swallows_every_wave() -> None:
    frequencies = np.array([50.0, 400.0, 1500.0, 3000.0])
    expected = 1.0 / (2j * np.pi * frequencies * IMPEDANCE)
    errors = []
    for elements in (20, 40):
        system = rod_system(ROD, elements, clamped=False, end_dashpot=IMPEDANCE)
        found = solve_frf(system, frequencies, inputs=[TIP], outputs=[TIP])
        assert found.method == "dampers"
        errors.append(np.abs(found.receptance[:, 0, 0] / expected - 1.0).max())
    assert errors[1] < 1e-5 and errors[0] / errors[1] > 12.0


@pytest.mark.parametrize("share", [0.1, 0.5, 2.0, 10.0])
def test_another_dashpot_reflects_as_the_difference_of_impedances_says(share: float) -> None:
    # standing waves with one loss per round trip: exp(2 s L / c) = (1 - share) / (1 + share) at a
    # free tip
    system = rod_system(ROD, 60, clamped=False, end_dashpot=share * IMPEDANCE)
    poles = solve_damped(system).poles
    decay = SPEED / (2.0 * ROD.length) * np.log(abs((1.0 - share) / (1.0 + share)))
    first = poles[poles.imag > 1.0][:3]
    np.testing.assert_allclose(first.real, decay, rtol=1e-3)
    orders = np.arange(1, 4) if share < 1.0 else np.arange(1, 4) - 0.5
    np.testing.assert_allclose(first.imag, orders * np.pi * SPEED / ROD.length, rtol=1e-3)


def test_structural_damping_must_become_viscous_before_it_has_poles() -> None:
    system = dataclasses.replace(plain_system(np.eye(1), None, np.eye(1)), hysteretic=np.eye(1))
    with pytest.raises(Exception, match="equivalent_viscous"):
        solve_damped(system)
