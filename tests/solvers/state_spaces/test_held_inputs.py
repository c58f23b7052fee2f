"""A state space at a step with held inputs is exact, in pairs of states where it can be."""

import numpy as np
import pytest
import scipy.linalg

from common import approx
from headstock.geometry.frames import FloatArray
from headstock.solvers.state_spaces.held_inputs import HeldSystem, hold_inputs
from headstock.solvers.state_spaces.state_space import StateSpace

STEP = 1e-3
FREQUENCIES = np.array([0.0, 20.0, 50.0, 51.0, 300.0])


def space(coupling: FloatArray | None = None) -> StateSpace:
    """Five modes, one of them rigid, whose damping may couple the middle three."""
    random, omega = np.random.default_rng(1), 2.0 * np.pi * FREQUENCIES
    damping = np.diag(0.04 * omega)
    if coupling is not None:
        damping[1:4, 1:4] += coupling
    first, second = np.arange(0, 10, 2), np.arange(1, 10, 2)
    scales = np.where(omega > 0.0, omega, 1.0)
    a, b, c = np.zeros((10, 10)), np.zeros((10, 2)), np.zeros((3, 10))
    a[first, second], a[second, first] = scales, -(omega**2) / scales
    a[np.ix_(second, second)] = -damping
    b[second] = random.standard_normal((5, 2))
    c[:, first] = random.standard_normal((3, 5)) / scales
    channels = tuple(("p", axis) for axis in "xyz")
    return StateSpace(a, b, c, random.standard_normal((3, 2)), channels[:2], channels, ())


def follow(held: HeldSystem, inputs: FloatArray) -> FloatArray:
    """Outputs after each step from rest."""
    state, outputs = np.zeros(len(held.a)), []
    for given in inputs:
        state = held.a @ state + held.b @ given
        outputs.append(held.c @ state + held.d @ given)
    return np.array(outputs)


def follow_exactly(plant: StateSpace, inputs: FloatArray) -> FloatArray:
    """The same by one exponential of the whole."""
    size, count = len(plant.a), len(plant.inputs)
    whole = np.zeros((size + count, size + count))
    whole[:size] = np.hstack([plant.a, plant.b])
    power = scipy.linalg.expm(whole * STEP)
    state, outputs = np.zeros(size), []
    for held in inputs:
        state = power[:size, :size] @ state + power[:size, size:] @ held
        outputs.append(plant.c @ state + plant.d @ held)
    return np.array(outputs)


@pytest.mark.parametrize(
    ("coupling", "pairs"),
    [
        (None, 5),
        (np.array([[30.0, 5.0, 2.0], [5.0, 20.0, 4.0], [2.0, 4.0, 10.0]]), 5),
        # critically damped: eigenvectors fall together
        (np.diag([2.0 * 0.98 * 2.0 * np.pi * 20.0, 0.0, 0.0]) + 1e-9 * np.ones((3, 3)), 2),
    ],
)
def test_held_inputs_are_exact(coupling: FloatArray | None, pairs: int) -> None:
    plant = space(coupling)
    held = hold_inputs(plant, STEP)
    inputs = np.random.default_rng(2).standard_normal((500, 2))
    exact = follow_exactly(plant, inputs)
    assert held.pairs == pairs
    assert follow(held, inputs) == approx(exact, abs=1e-11 * np.abs(exact).max())


def test_what_cannot_be_taken_apart_stays_one_block() -> None:
    plant = space()
    a = plant.a.copy()
    a[:3, :3] = [[-5.0, 1.0, 0.0], [0.0, -5.0, 1.0], [0.0, 0.0, -5.0]]  # a Jordan block
    plant = StateSpace(a, plant.b, plant.c, plant.d, plant.inputs, plant.outputs, ())
    held = hold_inputs(plant, STEP)
    inputs = np.random.default_rng(3).standard_normal((200, 2))
    exact = follow_exactly(plant, inputs)
    assert 2 * held.pairs < len(held.a)
    assert follow(held, inputs) == approx(exact, abs=1e-11 * np.abs(exact).max())
