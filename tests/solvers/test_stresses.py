"""Equivalent stresses at rest and over a cycle, and stresses in turned axes."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from common import approx
from headstock.geometry.frames import FloatArray
from headstock.solvers.stresses import largest_von_mises, pack_tensor, turn_stress

RANDOM = np.random.default_rng(7)


def equivalent(tensor: FloatArray) -> float:
    """By its principal stresses."""
    one, two, three = np.linalg.eigvalsh(tensor)
    return float(np.sqrt(0.5 * ((one - two) ** 2 + (two - three) ** 2 + (three - one) ** 2)))


def symmetric(*shape: int) -> FloatArray:
    tensor = RANDOM.normal(size=(*shape, 3, 3))
    return 0.5 * (tensor + tensor.swapaxes(-1, -2))


def test_the_equivalent_stress_at_rest_is_that_of_principal_stresses() -> None:
    tensors = symmetric(5)
    expected = [equivalent(tensor) for tensor in tensors]
    np.testing.assert_allclose(largest_von_mises(pack_tensor(tensors)), expected, rtol=1e-12)


@pytest.mark.parametrize("number", range(4))
def test_the_largest_equivalent_stress_over_a_cycle_is_that_of_a_fine_scan(number: int) -> None:
    real, imaginary = symmetric(2)
    phases = np.linspace(0.0, np.pi, 4001)
    scan = max(equivalent(np.cos(t) * real - np.sin(t) * imaginary) for t in phases[::4])
    found = float(largest_von_mises(pack_tensor(real) + 1j * pack_tensor(imaginary)))
    # a step of the scan turns its square by 1.6e-3 at most
    assert scan <= found * (1.0 + 1e-12)
    assert scan == approx(found, rel=1e-5)


def test_shear_that_turns_with_the_cycle_is_smaller_than_the_one_of_its_amplitudes() -> None:
    turning = np.array([0.0, 0.0, 0.0, 1.0, 1.0j, 0.0])
    assert float(largest_von_mises(turning)) == approx(np.sqrt(3.0))
    assert float(largest_von_mises(np.abs(turning))) == approx(np.sqrt(6.0))


def test_turned_axes_turn_the_tensor() -> None:
    turn, tensor = Rotation.from_rotvec([0.3, -0.8, 0.5]).as_matrix(), symmetric()
    expected = pack_tensor(turn @ tensor @ turn.T)
    np.testing.assert_allclose(turn_stress(turn) @ pack_tensor(tensor), expected, atol=1e-14)
