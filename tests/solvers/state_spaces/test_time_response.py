"""Exact discretisation against closed forms and against a stiff integrator of a library."""

import dataclasses

import numpy as np
import pytest
import scipy.linalg
from scipy.integrate import solve_ivp

from headstock.geometry.frames import FloatArray
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.damping import add_modal_damping
from headstock.solvers.linear.frequency_response import solve_frf
from headstock.solvers.second_order import SecondOrderSystem
from headstock.solvers.state_spaces import time_response
from headstock.solvers.state_spaces.state_space import to_state_space
from headstock.solvers.state_spaces.time_response import solve_time_response

CHANNELS = (("a", "x"), ("b", "x"))


def make_system(size: int = 5, seed: int = 0) -> SecondOrderSystem:
    random = np.random.default_rng(seed)
    factor = random.standard_normal((size, size))
    rows = {channel: np.eye(size)[i] for i, channel in enumerate(CHANNELS)}
    stiffness = 1e4 * (factor @ factor.T + 0.1 * np.eye(size))
    return SecondOrderSystem(
        np.diag(random.uniform(0.5, 2.0, size)), None, stiffness, rows, rows, ("q",) * size
    )


def dashpots(size: int = 5, strength: float = 20.0) -> FloatArray:
    lines = np.random.default_rng(1).standard_normal((size, 2))
    return strength * lines @ lines.T


def unsymmetric(bare: SecondOrderSystem) -> SecondOrderSystem:
    skew = np.zeros_like(bare.stiffness)
    skew[0, 1] = 500.0
    return dataclasses.replace(
        bare, stiffness=bare.stiffness + skew, damping=np.eye(len(skew)) * 5.0
    )


SYSTEMS = {
    "undamped": make_system(),
    "modal": add_modal_damping(make_system(), [0.02]),
    "overdamped": add_modal_damping(make_system(), [2.0, 1.0, 0.3]),
    "coupled": dataclasses.replace(make_system(), damping=dashpots()),
    "unsymmetric": unsymmetric(make_system()),
}


@pytest.mark.parametrize("name", list(SYSTEMS))
@pytest.mark.parametrize("step", [1e-3, 0.02])
def test_every_step_agrees_with_radau(name: str, step: float) -> None:
    system = SYSTEMS[name]
    times = step * np.arange(6)
    loads = np.column_stack([np.sin(40.0 * times), np.where(times > 2.5 * step, 1.0, 0.3)])
    space = to_state_space(system, inputs=CHANNELS, outputs=CHANNELS)
    found = solve_time_response(space, loads, step).outputs
    state, expected = (
        np.zeros(len(space.a)),
        [space.c @ np.zeros(len(space.a)) + space.d @ loads[0]],
    )
    for number in range(5):
        slope = (loads[number + 1] - loads[number]) / step
        force = lambda t, x, u=loads[number], r=slope: space.a @ x + space.b @ (u + r * t)  # noqa: E731
        result = solve_ivp(
            force, (0.0, step), state, method="Radau", rtol=1e-10, atol=1e-14, jac=space.a
        )
        state = result.y[:, -1]
        expected.append(space.c @ state + space.d @ loads[number + 1])
    np.testing.assert_allclose(found, expected, atol=1e-8 * np.abs(expected).max())


def test_a_step_costs_an_exponential_of_states_and_loads(monkeypatch: pytest.MonkeyPatch) -> None:
    space = to_state_space(SYSTEMS["coupled"], inputs=CHANNELS, outputs=CHANNELS)
    sizes, expm = [], scipy.linalg.expm

    def record(matrix: FloatArray) -> FloatArray:
        sizes.append(len(matrix))
        return np.asarray(expm(matrix))

    monkeypatch.setattr(scipy.linalg, "expm", record)
    solve_time_response(space, np.ones((3, len(CHANNELS))), 1e-3)
    assert sizes == [len(space.a) + 2 * len(CHANNELS)]


def test_steps_in_blocks_are_those_one_by_one(monkeypatch: pytest.MonkeyPatch) -> None:
    space = to_state_space(SYSTEMS["coupled"], inputs=CHANNELS, outputs=CHANNELS)
    loads = np.random.default_rng(2).standard_normal((500, len(CHANNELS)))
    read: list[int] = []
    advance = time_response._Propagator.advance

    def count(propagator: time_response._Propagator, state: FloatArray) -> FloatArray:
        read.append(1)
        return advance(propagator, state)

    monkeypatch.setattr(time_response._Propagator, "advance", count)
    found = solve_time_response(space, loads, 1e-3)
    monkeypatch.setattr(time_response, "WORTH_BLOCKS", np.inf)
    single = solve_time_response(space, loads, 1e-3)
    assert len(read) == 499 % time_response.STEPS_OF_BLOCK + 499
    for block, alone in (
        (found.outputs, single.outputs),
        (found.final_state, single.final_state),
    ):
        np.testing.assert_allclose(block, alone, rtol=0.0, atol=1e-13 * np.abs(alone).max())


@pytest.mark.parametrize("name", list(SYSTEMS))
def test_the_state_space_has_the_frequency_response_of_the_system(name: str) -> None:
    frequencies = np.array([0.3, 7.0, 40.0, 200.0])
    expected = solve_frf(SYSTEMS[name], frequencies, inputs=CHANNELS, outputs=CHANNELS).receptance
    space = to_state_space(SYSTEMS[name], inputs=CHANNELS, outputs=CHANNELS)
    np.testing.assert_allclose(
        space.respond(2.0 * np.pi * frequencies), expected, atol=1e-9 * np.abs(expected).max()
    )
    assert (space.inputs, space.outputs) == (CHANNELS, CHANNELS)
    assert len(space.states) == len(space.a) == 10


def test_modes_left_out_of_a_state_space_stay_in_it_statically() -> None:
    space = to_state_space(SYSTEMS["modal"], inputs=CHANNELS, outputs=CHANNELS, up_to_hz=30.0)
    assert 2 <= len(space.a) < 10 and space.d.any()
    static = np.linalg.inv(SYSTEMS["modal"].stiffness)[:2, :2]
    np.testing.assert_allclose(
        space.d - space.c @ np.linalg.solve(space.a, space.b), static, rtol=1e-9
    )


def test_a_free_mass_falls_as_galileo_says() -> None:
    channel: dict[tuple[str, str], FloatArray] = {("a", "x"): np.ones(1)}
    space = to_state_space(
        SecondOrderSystem(np.eye(1) * 2.0, None, np.zeros((1, 1)), channel, channel, ("q",)),
        inputs=list(channel),
        outputs=list(channel),
    )
    times = 0.1 * np.arange(50)
    found = solve_time_response(space, np.full((50, 1), 6.0), 0.1)
    np.testing.assert_allclose(found.outputs[:, 0], 1.5 * times**2, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize(("step", "load"), [(0.0, 1.0), (-1.0, 1.0), (np.nan, 1.0), (0.1, np.inf)])
def test_senseless_steps_and_loads_are_refused(step: float, load: float) -> None:
    space = to_state_space(SYSTEMS["modal"], inputs=CHANNELS, outputs=CHANNELS)
    with pytest.raises(ModelError):
        solve_time_response(space, np.full((3, 2), load), step)
