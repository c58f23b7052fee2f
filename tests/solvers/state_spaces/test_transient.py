"""Transient response against closed forms of one degree of freedom and of a bar, and against a stiff
integrator of a library.
"""

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from common import approx
from headstock.geometry.frames import FloatArray
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.damping import add_modal_damping
from headstock.solvers.linear.modal_analysis import solve_modal
from headstock.solvers.second_order import Channel, SecondOrderSystem
from headstock.solvers.state_spaces.load_history import (
    LoadHistory,
    half_sine_load,
    impulse_load,
    ramp_load,
    recorded_load,
    released_load,
    sine_load,
    step_load,
    step_loads,
)
from headstock.solvers.state_spaces.state_space import to_state_space
from headstock.solvers.state_spaces.transient import (
    Response,
    TransientFigures,
    find_energy,
    find_figures,
    read_response,
    rest_positions,
    soften_system,
    solve_transient,
)

MASS, HZ, ZETA = 2.0, 50.0, 0.05
OMEGA = 2.0 * np.pi * HZ
STIFFNESS = MASS * OMEGA**2
MOVING = OMEGA * np.sqrt(1.0 - ZETA**2)
X = ("mass", "x")


def oscillator(zeta: float = ZETA) -> SecondOrderSystem:
    row: dict[Channel, FloatArray] = {X: np.ones(1)}
    return SecondOrderSystem(
        np.array([[MASS]]),
        np.array([[2.0 * zeta * OMEGA * MASS]]),
        np.array([[STIFFNESS]]),
        row,
        row,
        ("x",),
    )


def chain(size: int = 4) -> SecondOrderSystem:
    """Masses on springs to ground, a damper between two of them that couples the modes."""
    stiffness = 1e6 * (2.0 * np.eye(size) - np.eye(size, k=1) - np.eye(size, k=-1))
    between = np.zeros(size)
    between[:2] = 1.0, -1.0
    rows = {("a", "x"): np.eye(size)[0], ("b", "x"): np.eye(size)[-1]}
    mass = np.diag(np.linspace(1.0, 2.0, size))
    return SecondOrderSystem(
        mass, 60.0 * np.outer(between, between), stiffness, rows, rows, ("q",) * size
    )


def respond(
    system: SecondOrderSystem,
    load: LoadHistory,
    *,
    duration: float = 0.1,
    sampling_hz: float = 1000.0,
    at: tuple[str, str] = X,
) -> Response:
    model = to_state_space(system, inputs=[at], outputs=[at], up_to_hz=None, little_mass=True)
    _, _, state = rest_positions(model, [load], duration)
    return read_response(
        model, solve_transient(model, step_loads([load], duration, sampling_hz), state)
    )


def figures_of(system: SecondOrderSystem, load: LoadHistory, duration: float) -> TransientFigures:
    model = to_state_space(system, inputs=[X], outputs=[X], up_to_hz=None, little_mass=True)
    start, final, state = rest_positions(model, [load], duration)
    stepped = step_loads([load], duration, 20.0 * HZ)
    response = read_response(model, solve_transient(model, stepped, state))
    return find_figures(response, start=start, final=final, near=0.02)[0]


def step_response(times: FloatArray) -> FloatArray:
    """Of a unit force (Timoshenko, Young and Weaver 1974, section 1.10)."""
    decay = np.exp(-ZETA * OMEGA * times)
    swing = np.cos(MOVING * times) + ZETA * OMEGA / MOVING * np.sin(MOVING * times)
    return np.asarray((1.0 - decay * swing) / STIFFNESS)


def impulse_response(times: FloatArray) -> FloatArray:
    return np.asarray(np.exp(-ZETA * OMEGA * times) * np.sin(MOVING * times) / (MASS * MOVING))


CLOSED_FORMS: dict[str, tuple[LoadHistory, Callable[[FloatArray], FloatArray]]] = {
    "step": (step_load(3.0), lambda t: 3.0 * step_response(t)),
    "impulse": (impulse_load(0.2), lambda t: 0.2 * impulse_response(t)),
    "release": (released_load(5.0), lambda t: 5.0 * (1.0 / STIFFNESS - step_response(t))),
    "late step": (
        step_load(1.0, 0.01234),
        lambda t: np.where(t > 0.01234, step_response(np.maximum(t - 0.01234, 0.0)), 0.0),
    ),
    "late impulse": (
        impulse_load(1.0, 0.00777),
        lambda t: np.where(t > 0.00777, impulse_response(np.maximum(t - 0.00777, 0.0)), 0.0),
    ),
    "pulse": (
        step_load(1.0, 0.0, 0.0123),
        lambda t: (
            step_response(t) - np.where(t > 0.0123, step_response(np.maximum(t - 0.0123, 0.0)), 0.0)
        ),
    ),
}


@pytest.mark.parametrize("name", list(CLOSED_FORMS))
def test_one_degree_of_freedom_follows_its_closed_form(name: str) -> None:
    load, expected = CLOSED_FORMS[name]
    times, found = respond(oscillator(), load).sample()
    exact = expected(times)
    assert np.allclose(found[:, 0], exact, rtol=0.0, atol=1e-12 * np.abs(exact).max())


def test_a_sine_in_resonance_grows_evenly_without_damping() -> None:
    # x = (sin wt - wt cos wt) / (2 k): no steady state to subtract
    times, found = respond(oscillator(0.0), sine_load(1.0, 0.0, HZ), duration=0.4).sample()
    exact = (np.sin(OMEGA * times) - OMEGA * times * np.cos(OMEGA * times)) / (2.0 * STIFFNESS)
    assert np.allclose(found[:, 0], exact, rtol=0.0, atol=1e-11 * np.abs(exact).max())


@pytest.mark.parametrize("ratio", [0.3, 0.8, 1.5, 3.2])
def test_half_sine_pulses_give_the_undamped_shock_spectrum(ratio: float) -> None:
    # duration over period; Ayre (1961), Harris and Crede, Shock and Vibration Handbook, ch. 8:
    # after the pulse 2 b cos(pi r) / (1 - b^2) of the static deflection, b = 1 / (2 r), and while
    # it lasts sin(2 n pi / (1 + 1/b)) / (1 - b) at best, for r > 1/2
    duration, b = ratio / HZ, 1.0 / (2.0 * ratio)
    after = abs(2.0 * b * np.cos(np.pi * ratio) / (1.0 - b * b))
    number = np.arange(1, 10)
    inner = np.sin(2.0 * np.pi * number / (1.0 + 1.0 / b)) / (1.0 - b)
    reached = 2.0 * np.pi * number / (1.0 + 1.0 / b) < np.pi
    spectrum = max([after, *np.abs(inner[reached])])
    found = figures_of(oscillator(0.0), half_sine_load(1.0, 0.0, duration), duration + 2.0 / HZ)
    assert abs(found.peak) * STIFFNESS == approx(spectrum, rel=1e-4)


def test_figures_of_a_step_are_those_of_control_engineering() -> None:
    found = figures_of(oscillator(), step_load(1.0), 0.5)
    assert found.final == approx(1.0 / STIFFNESS, rel=1e-12)
    overshoot = np.exp(-np.pi * ZETA / np.sqrt(1.0 - ZETA**2))
    assert found.overshoot == approx(overshoot, rel=1e-4)
    assert found.peak_time == approx(np.pi / MOVING, rel=1e-3)
    fine: FloatArray = np.asarray(np.linspace(0.0, 0.5, 200_001), dtype=float)
    off = np.abs(step_response(fine) * STIFFNESS - 1.0) > 0.02
    # to the end of the step of 1/20 period in which it settles
    settled = float(fine[off].max())
    assert found.settling is not None and 0.0 <= found.settling - settled <= 1.0 / (20.0 * HZ)


def test_what_still_moves_has_not_settled() -> None:
    assert figures_of(oscillator(), step_load(1.0), 0.05).settling is None
    assert figures_of(oscillator(), sine_load(1.0, 0.0, 10.0), 0.5).final is None


LOADS = {
    "ramp": ramp_load(2.0, 0.0031, 0.0077),
    "half sine": half_sine_load(3.0, 0.002, 0.0053),
    "burst": sine_load(1.0, 0.0012, 170.0, 2.0),
    "record": recorded_load(np.array([0.0, 0.004, 0.009, 0.02]), np.array([0.0, 2.0, -1.0, 0.5])),
}


@pytest.mark.parametrize("name", list(LOADS))
def test_coupled_modes_agree_with_an_integrator(name: str) -> None:
    system, load = chain(), LOADS[name]
    damping = np.zeros_like(system.mass) if system.damping is None else system.damping
    push = system.inputs["a", "x"]
    inverse = np.linalg.inv(system.mass)

    def value(time: float) -> float:
        piece = int(np.searchsorted(load.begins, time, side="right")) - 1
        if piece < 0 or time >= load.ends[piece]:
            return 0.0
        since = time - load.begins[piece]
        sine = load.amplitudes[piece] * np.sin(load.omegas[piece] * since)
        return float(load.values[piece] + load.slopes[piece] * since + sine)

    def rate(time: float, state: FloatArray) -> FloatArray:
        q, v = state[:4], state[4:]
        force = push * value(time) - system.stiffness @ q - damping @ v
        return np.concatenate([v, inverse @ force])

    response = respond(system, load, duration=0.03, sampling_hz=2000.0, at=("a", "x"))
    times, found = response.sample()
    state, at, expected = np.zeros(8), 0.0, [0.0]
    marks = load.instants[(load.instants > 0.0) & (load.instants < 0.03)]
    for time in np.unique(np.round(np.concatenate([times[1:], marks]), 12)):
        solved = solve_ivp(rate, (at, time - 1e-15), state, rtol=1e-11, atol=1e-16, method="DOP853")
        state, at = solved.y[:, -1], float(time)
        if np.isclose(times, time, rtol=0.0, atol=1e-12).any():
            expected.append(float(state[0]))
    exact = np.array(expected)
    assert np.abs(exact).max() > 0.0
    assert np.allclose(found[:, 0], exact, rtol=0.0, atol=1e-8 * np.abs(exact).max())


@pytest.mark.parametrize("name", [*LOADS, "step", "impulse"])
def test_energy_adds_up(name: str) -> None:
    load = LOADS[name] if name in LOADS else CLOSED_FORMS[name][0]
    model = to_state_space(
        chain(), inputs=[("a", "x")], outputs=[("b", "x")], up_to_hz=None, little_mass=True
    )
    stepped = step_loads([load], 0.05, 20_000.0)
    motion = solve_transient(model, stepped, np.zeros(len(model.a)))
    balance = find_energy(model, motion)
    assert balance is not None and balance.dissipated > 0.0 and balance.largest > 0.0
    assert balance.error < 1e-6


def test_modes_left_out_follow_at_once_so_that_a_step_ends_where_all_modes_end() -> None:
    system = add_modal_damping(chain(8), [0.05])
    ends = []
    for limit in (None, 80.0):
        model = to_state_space(
            system, inputs=[("a", "x")], outputs=[("a", "x")], up_to_hz=limit, little_mass=True
        )
        ends.append(rest_positions(model, [step_load(1.0)], 1.0)[1])
    assert ends[0] is not None and ends[1] is not None
    assert ends[1] == approx(ends[0], rel=1e-10)
    assert ends[0][0] == approx(np.linalg.inv(system.stiffness)[0, 0], rel=1e-10)


def test_a_softer_oscillator_has_the_stiffness_of_its_frequency_and_the_same_damper() -> None:
    softer = soften_system(oscillator(), solve_modal(oscillator()), np.array([0.9]))
    assert softer.stiffness == approx(np.array([[0.81 * STIFFNESS]]), rel=1e-12)
    assert softer.damping == oscillator().damping


def test_a_softer_system_keeps_its_shapes_and_its_other_frequencies() -> None:
    system = chain(8)
    modes = solve_modal(system)
    softer = solve_modal(soften_system(system, modes, np.array([0.99, 1.0, 0.97])))
    factors = np.concatenate([[0.99, 1.0, 0.97], np.ones(5)])
    np.testing.assert_allclose(softer.frequencies_hz, factors * modes.frequencies_hz, rtol=1e-10)
    np.testing.assert_allclose(softer.shapes, modes.shapes, rtol=0.0, atol=1e-8)


def test_a_step_on_a_free_body_has_no_rest_position_and_moves_it_evenly_faster() -> None:
    free = dataclasses.replace(oscillator(), stiffness=np.zeros((1, 1)), damping=None)
    times, found = respond(free, step_load(1.0)).sample()
    assert np.allclose(found[:, 0], 0.5 * times**2 / MASS, rtol=1e-12, atol=1e-18)
    model = to_state_space(free, inputs=[X], outputs=[X], up_to_hz=None, little_mass=True)
    assert rest_positions(model, [step_load(1.0)], 1.0)[1] is None
    with pytest.raises(ModelError, match="nothing holds"):
        rest_positions(model, [released_load(1.0)], 1.0)


def test_a_damper_without_mass_is_no_obstacle() -> None:
    # a Maxwell element: spring and damper in series hold the mass
    mass, stiffness = np.diag([1.0, 0.0]), np.array([[2e4, -1e4], [-1e4, 1e4]])
    damping = np.diag([0.0, 100.0])
    rows = {X: np.array([1.0, 0.0])}
    system = SecondOrderSystem(mass, damping, stiffness, rows, rows, ("a", "b"))
    times, found = respond(system, step_load(1.0), duration=0.3).sample()

    def rate(_: float, state: FloatArray) -> FloatArray:
        x, v, z = state
        return np.array([v, 1.0 - 2e4 * x + 1e4 * z, (1e4 * x - 1e4 * z) / 100.0])

    solved = solve_ivp(rate, (0.0, 0.3), np.zeros(3), t_eval=times, rtol=1e-11, atol=1e-16)
    assert np.allclose(found[:, 0], solved.y[0], rtol=0.0, atol=2e-5 * np.abs(solved.y[0]).max())
