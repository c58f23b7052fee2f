"""gyroscopic and control terms are found by a test and never symmetrised away."""

import dataclasses

import numpy as np
import pytest

from headstock.geometry.frames import FloatArray
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.damping import solve_damped
from headstock.solvers.linear.frequency_response import solve_frf
from headstock.solvers.linear.modal_analysis import solve_modal
from headstock.solvers.linear.response_forms import _find_poles
from headstock.solvers.linear.symmetric_matrices import SYMMETRY_TOLERANCE, is_symmetric
from headstock.solvers.second_order import SecondOrderSystem

pytestmark = pytest.mark.hard("H30")

CHANNELS = [("disk", "rx"), ("disk", "ry")]


def rotor(spin: float, *, damping: float = 0.0, circulation: float = 0.0) -> SecondOrderSystem:
    """A disk that tilts on springs and spins: polar inertia 2, diametral 1, tilting stiffness
    1e4.
    """
    gyro = 2.0 * spin * np.array([[0.0, 1.0], [-1.0, 0.0]])
    stiffness = 1e4 * np.eye(2) + circulation * np.array([[0.0, 1.0], [-1.0, 0.0]])
    rows = {channel: np.eye(2)[i] for i, channel in enumerate(CHANNELS)}
    return SecondOrderSystem(
        np.eye(2), gyro + damping * np.eye(2), stiffness, rows, rows, ("rx", "ry")
    )


def whirl(spin: float) -> FloatArray:
    """Backward and forward whirl: omega^2 +- 2 spin omega - 1e4 = 0."""
    return np.array([-spin + np.sqrt(spin**2 + 1e4), spin + np.sqrt(spin**2 + 1e4)])


@pytest.mark.parametrize("spin", [0.0, 1.0, 40.0, 300.0])
def test_gyroscopic_whirl_splits_as_the_closed_form_says(spin: float) -> None:
    found = solve_damped(rotor(spin))
    np.testing.assert_allclose(np.sort(found.poles.imag), whirl(spin), rtol=1e-9)
    assert np.abs(found.poles.real).max() <= 1e-9 * np.abs(found.poles).max()


def test_the_response_of_a_spinning_disk_is_not_reciprocal() -> None:
    system = rotor(40.0, damping=3.0)
    frequencies = np.array([0.0, 5.0, 12.0])
    found = solve_frf(system, frequencies, inputs=CHANNELS, outputs=CHANNELS)
    assert found.method == "direct"
    for hz, value in zip(frequencies, found.receptance, strict=True):
        omega = 2.0 * np.pi * hz
        expected = np.linalg.inv(
            system.stiffness - omega**2 * system.mass + 1j * omega * system.damping
        )
        np.testing.assert_allclose(value, expected, rtol=1e-12, atol=1e-12 * np.abs(expected).max())
    assert abs(found.receptance[1, 0, 1] + found.receptance[1, 1, 0]) < 1e-12 * abs(
        found.receptance[1, 0, 1]
    )


def test_circulating_forces_make_one_whirl_grow_and_it_is_seen() -> None:
    system = rotor(0.0, damping=2.0, circulation=500.0)
    found = solve_damped(system)
    exact = np.roots([1.0, 2.0, 1e4 + 500.0j])
    expected = sorted({complex(root.real, abs(root.imag)) for root in exact}, key=abs)
    np.testing.assert_allclose(
        found.poles[np.argsort(np.abs(found.poles))], np.array(expected), rtol=1e-9
    )
    assert found.damping_ratios.min() < 0.0
    np.testing.assert_allclose(
        np.sort(_find_poles(system).real),
        np.sort(np.concatenate([exact.real, exact.real])),
        rtol=1e-8,
    )


def test_a_symmetric_solver_refuses_what_is_not() -> None:
    with pytest.raises(ModelError, match="not symmetric"):
        solve_modal(rotor(0.0, circulation=1.0))


@pytest.mark.parametrize(("share", "symmetric"), [(0.5, True), (2.0, False)])
def test_the_test_is_as_sharp_as_it_says(share: float, symmetric: bool) -> None:
    matrix = np.diag([1e4, 2e4])
    matrix[0, 1] = share * SYMMETRY_TOLERANCE * 2e4
    assert is_symmetric(matrix) == symmetric


def test_a_feedback_force_makes_the_road_general_even_without_dampers() -> None:
    system = rotor(0.0)
    fed_back = dataclasses.replace(
        system, damping=None, stiffness=system.stiffness + np.array([[0.0, 300.0], [0.0, 0.0]])
    )
    found = solve_frf(fed_back, np.array([3.0]), inputs=CHANNELS, outputs=CHANNELS)
    expected = np.linalg.inv(fed_back.stiffness - (6.0 * np.pi) ** 2 * np.eye(2))
    np.testing.assert_allclose(found.receptance[0], expected, rtol=1e-12)
