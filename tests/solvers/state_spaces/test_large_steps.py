"""steps far longer than the shortest period: nothing blows up, nothing rings that should not,
energy stays.
"""

import numpy as np
import pytest

from common import approx, present
from headstock.solvers.linear.damping import add_modal_damping
from headstock.solvers.linear.modal_analysis import solve_modal
from headstock.solvers.second_order import SecondOrderSystem
from headstock.solvers.state_spaces.state_space import StateSpace, to_state_space
from headstock.solvers.state_spaces.time_response import make_propagator, solve_time_response

pytestmark = pytest.mark.hard("H32")

CHANNEL = ("end", "x")


def chain(stiff: float) -> SecondOrderSystem:
    """Two soft masses and one on a spring so stiff that its period is far below any step."""
    stiffness = np.array([[3e4, -1e4, 0.0], [-1e4, 1e4 + stiff, -stiff], [0.0, -stiff, stiff]])
    row = {CHANNEL: np.eye(3)[0]}
    return SecondOrderSystem(np.diag([1.0, 1.5, 0.5]), None, stiffness, row, row, ("a", "b", "c"))


def space_of(system: SecondOrderSystem) -> StateSpace:
    return to_state_space(system, inputs=[CHANNEL], outputs=[CHANNEL])


@pytest.mark.parametrize("stiff", [1e9, 1e12])
def test_resolved_modes_are_right_at_steps_ten_times_the_shortest_period_and_longer(
    stiff: float,
) -> None:
    system = chain(stiff)
    modes = solve_modal(system)
    step = 1.0 / modes.frequencies_hz[1] / 20.0
    assert step * modes.frequencies_hz[2] > 10.0
    times = step * np.arange(400)
    found = solve_time_response(space_of(system), np.ones((400, 1)), step).outputs[:, 0]
    omega = 2.0 * np.pi * modes.frequencies_hz
    shares = modes.shapes[0] ** 2 / omega**2
    expected = ((1.0 - np.cos(np.outer(times, omega))) * shares).sum(axis=1)
    assert np.abs(found - expected).max() < 1e-6 * np.abs(expected).max()


@pytest.mark.parametrize("angle", [0.3, 1e3])
def test_energy_neither_grows_nor_falls_over_a_million_steps(angle: float) -> None:
    space = space_of(chain(1e8))
    mode = 1
    propagator = make_propagator(space, angle / np.sqrt(present(space.pairs).eigenvalues[mode]))
    (a, b), (c, d) = propagator.transition[mode].tolist()
    # the states of a mode are (omega p, p'), so that their squares add up to twice the energy
    x, y = 0.6, 0.8
    for _ in range(1_000_000):
        x, y = a * x + b * y, c * x + d * y
    assert x * x + y * y == approx(1.0, rel=1e-8)


def test_with_coupled_damping_energy_never_grows_at_any_step() -> None:
    system = chain(1e8)
    system = SecondOrderSystem(
        system.mass,
        np.diag([3.0, 0.0, 0.0]),
        system.stiffness,
        system.inputs,
        system.outputs,
        system.labels,
    )
    space = space_of(system)
    assert space.pairs is None
    for step in (1e-5, 1e-3, 0.1, 3.0):
        largest = np.linalg.svd(make_propagator(space, step).transition, compute_uv=False)[0]
        assert largest <= 1.0 + 1e-10


def test_fast_damped_modes_die_out_and_leave_the_static_answer() -> None:
    system = add_modal_damping(chain(1e10), [0.0, 0.0, 0.1])
    space = space_of(system)
    step = 1e-3
    found = solve_time_response(space, np.ones((50, 1)), step)
    assert np.abs(found.final_state[-2:]).max() < 1e-6 * np.abs(found.final_state).max()
