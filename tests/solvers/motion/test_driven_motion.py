"""Controlled motion with friction in time: the linear limit, an integrator of a library, and the
balance of energy.
"""

import dataclasses

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from common import approx
from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.drives import Cascade, GuideFriction
from headstock.solvers.control.drive_loops import ClosedLoop, close_loops
from headstock.solvers.errors import ModelError
from headstock.solvers.motion.driven_motion import solve_motion
from headstock.solvers.motion.friction import friction_force, friction_slope
from headstock.solvers.motion.friction_loop import friction_channels, make_friction_loop
from headstock.solvers.state_spaces.time_response import solve_stepped_response, solve_time_response
from headstock.validation.machines.drive_cases import LOAD, _TwoMasses, make_drive

pytestmark = pytest.mark.slow

CONTROL = Cascade(
    position_gain=40.0, velocity_gain=2e4, integral_time=0.02, dead_time=2e-4, current_lag=1e-4
)
LAW = GuideFriction(
    coulomb=50.0, breakaway=80.0, stribeck_speed=1e-3, viscous=100.0, smoothing=1e-4
)
TIMES = np.linspace(0.0, 0.2, 201, dtype=np.float64)


def loop_with(law: GuideFriction | None) -> ClosedLoop:
    system, train = make_drive(_TwoMasses(), CONTROL, law)
    return close_loops(system, [train], inputs=[LOAD, *friction_channels((train,))], outputs=[LOAD])


def push(instants: FloatArray) -> FloatArray:
    """A set point that accelerates at a constant rate, and a load that swings."""
    still = np.full_like(instants, 0.5)
    load = 30.0 * np.sin(400.0 * instants)
    return np.column_stack([0.25 * instants**2, 0.5 * instants, still, load])


def test_without_friction_it_is_the_exact_discretisation() -> None:
    loop = loop_with(None)
    found = solve_motion(loop, push, TIMES[:51], longest=2e-4)
    fine = 1e-5 * np.arange(5001, dtype=np.float64)
    exact = solve_time_response(loop.space, push(fine), 1e-5).outputs[::100]
    # the loads of the exact one are straight between its samples
    np.testing.assert_allclose(
        found.outputs[:, :4], exact[:, :4], atol=2e-8 * np.abs(exact[:, :4]).max()
    )


def test_a_load_that_bends_and_jumps_inside_steps_acts_as_it_is() -> None:
    """A triangle and a step that begin and end between the samples, unannounced."""

    def kick(instants: FloatArray) -> FloatArray:
        still = np.zeros((len(instants), 3))
        corners = np.array([0.00137, 0.00291, 0.00353])
        triangle = np.interp(instants, corners, [0.0, 40.0, 0.0])
        step = np.where((instants >= 0.01123) & (instants < 0.01377), 25.0, 0.0)
        return np.column_stack([still, triangle + step])

    loop, times = loop_with(None), 1e-3 * np.arange(31, dtype=np.float64)
    found = solve_motion(loop, kick, times)
    fine = 1e-5 * np.arange(3001, dtype=np.float64)
    ends = np.stack([kick(fine[:-1] + 1e-9), kick(fine[1:] - 1e-9)], axis=1)
    exact = solve_stepped_response(loop.space, fine, ends).outputs[::100]
    size = np.abs(exact).max(axis=0)
    assert (np.abs(found.outputs - exact)[:, :4] <= 2e-5 * size[:4]).all()
    assert found.energy.error < 1e-6


def integrate(law: GuideFriction, times: FloatArray) -> FloatArray:
    """States of the loop by an integrator of a library."""
    model = make_friction_loop(loop_with(law))
    space = model.loop.space

    def rate(time: float, state: FloatArray) -> FloatArray:
        rubbed = friction_force(law, model.slides @ state)
        pushed = model.b @ push(np.array([time]))[0]
        return np.asarray(space.a @ state + pushed - model.drag @ rubbed)

    start = np.zeros(model.size)
    solved = solve_ivp(rate, (0.0, float(times[-1])), start, "LSODA", times, rtol=1e-11, atol=1e-13)
    return np.asarray(solved.y.T)


@pytest.mark.parametrize(
    "smoothing",
    [
        pytest.param(1e-3, marks=pytest.mark.trials),
        pytest.param(1e-4, marks=pytest.mark.trials),
        1e-5,
    ],
)
def test_it_follows_an_integrator_of_a_library_and_balances_its_energy(smoothing: float) -> None:
    law = dataclasses.replace(LAW, smoothing=smoothing)
    found = solve_motion(loop_with(law), push, TIMES, longest=5e-4)
    expected = integrate(law, TIMES)
    size = np.abs(expected).max(axis=0)
    assert (np.abs(found.right - expected) <= 1e-6 * size).all()
    # two steps a sample, and more only where friction changes quickly
    assert 400 <= found.steps < 800
    energy = found.energy
    assert energy.error < 1e-7
    # everything moves and takes its part
    for part in (energy.drives, energy.loads, energy.damping, energy.friction):
        assert np.abs(part).max() > 0.0


@pytest.mark.parametrize("speed", [-1e-2, -3e-4, 0.0, 2e-5, 1e-3, 0.5])
def test_the_slope_of_friction_is_its_derivative(speed: float) -> None:
    step = 1e-9
    around = friction_force(LAW, np.array([speed - step, speed + step]))
    assert friction_slope(LAW, np.array(speed)) == approx(
        np.diff(around)[0] / (2.0 * step), rel=1e-5, abs=1e-3
    )


def test_friction_is_breakaway_at_rest_and_coulomb_with_viscous_when_fast() -> None:
    law = dataclasses.replace(LAW, smoothing=1e-7)
    assert friction_force(law, np.array(1e-5)) == approx(80.0, rel=1e-3)
    assert friction_force(law, np.array(-0.1)) == approx(-60.0, rel=1e-9)


def test_a_loop_closed_without_its_friction_is_refused() -> None:
    system, train = make_drive(_TwoMasses(), CONTROL, LAW)
    with pytest.raises(ValueError, match="among its inputs"):
        make_friction_loop(close_loops(system, [train]))


def test_a_port_that_does_not_exist_is_named() -> None:
    system, train = make_drive(_TwoMasses(), CONTROL)
    with pytest.raises(ModelError, match="no input"):
        close_loops(system, [train], inputs=[("nose", "x")])
