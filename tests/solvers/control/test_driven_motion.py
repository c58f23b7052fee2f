"""Controlled motion with friction in time: the linear limit, two integrators, and the balance of
energy.
"""

import dataclasses

import numpy as np
import pytest

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.drives import AxisControl, GuideFriction
from headstock.solvers.control.drive_loops import ClosedLoop, close_loops
from headstock.solvers.control.driven_motion import solve_motion
from headstock.solvers.control.friction_loop import (
    WORKS,
    friction_channels,
    friction_force,
    friction_slope,
    make_rubbing_loop,
)
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.time_response import solve_time_response
from headstock.validation.machines.drive_cases import LOAD, TwoMasses, make_drive

CONTROL = AxisControl(
    position_gain=40.0, velocity_gain=2e4, integral_time=0.02, dead_time=2e-4, current_lag=1e-4
)
LAW = GuideFriction(
    coulomb=50.0, breakaway=80.0, stribeck_speed=1e-3, viscous=100.0, smoothing=1e-4
)
TIMES = np.linspace(0.0, 0.2, 201, dtype=np.float64)


def loop_with(law: GuideFriction | None) -> ClosedLoop:
    system, train = make_drive(TwoMasses(), CONTROL, law)
    return close_loops(system, [train], inputs=[LOAD, *friction_channels((train,))], outputs=[LOAD])


def push(instant: float) -> FloatArray:
    """A set point that accelerates at a constant rate, and a load that swings."""
    return np.array([0.25 * instant**2, 0.5 * instant, 0.5, 30.0 * np.sin(400.0 * instant)])


def test_without_friction_it_is_the_exact_discretisation() -> None:
    loop = loop_with(None)
    found = solve_motion(loop, push, TIMES[:51], tolerance=1e-9)
    fine = 1e-5 * np.arange(5001)
    exact = solve_time_response(
        loop.space, np.array([push(instant) for instant in fine]), 1e-5
    ).outputs[::100]
    # the loads of the exact one are straight between its samples
    np.testing.assert_allclose(
        found.outputs[:, :4], exact[:, :4], atol=2e-8 * np.abs(exact[:, :4]).max()
    )


def test_energy_balances_and_two_integrators_agree() -> None:
    radau = solve_motion(loop_with(LAW), push, TIMES, method="Radau")
    bdf = solve_motion(loop_with(LAW), push, TIMES, method="BDF")
    assert radau.energy.error < 1e-6
    assert bdf.energy.error < 1e-6
    np.testing.assert_allclose(
        radau.outputs[:, 0], bdf.outputs[:, 0], atol=1e-6 * radau.outputs[:, 0].max()
    )
    # everything moves and takes its part
    for part in (
        radau.energy.drives,
        radau.energy.loads,
        radau.energy.damping,
        radau.energy.friction,
    ):
        assert np.abs(part).max() > 0.0


def test_the_jacobian_is_the_derivative_of_the_rate() -> None:
    rng = np.random.default_rng(3)
    model = make_rubbing_loop(loop_with(LAW))
    change = rng.normal(size=model.weights.shape)
    model = dataclasses.replace(model, guides=np.array([2e-4]), weight_rates=change + change.T)
    full, given = rng.normal(size=model.size + WORKS), np.append(rng.normal(size=3), 20.0)
    full[: model.loop.plant_size] *= 1e-3
    exact = model.jacobian(full, given)
    for column in range(len(full)):
        step = 1e-5 * max(abs(full[column]), 1e-4)
        ahead, behind = full.copy(), full.copy()
        ahead[column] += step
        behind[column] -= step
        slope = (model.rate(ahead, given) - model.rate(behind, given)) / (2.0 * step)
        np.testing.assert_allclose(
            exact[:, column], slope, rtol=1e-4, atol=1e-4 * max(np.abs(slope).max(), 1.0)
        )


@pytest.mark.parametrize("speed", [-1e-2, -3e-4, 0.0, 2e-5, 1e-3, 0.5])
def test_the_slope_of_friction_is_its_derivative(speed: float) -> None:
    step = 1e-9
    around = friction_force(LAW, np.array([speed - step, speed + step]))
    assert friction_slope(LAW, np.array(speed)) == pytest.approx(
        np.diff(around)[0] / (2.0 * step), rel=1e-5, abs=1e-3
    )


def test_friction_is_breakaway_at_rest_and_coulomb_with_viscous_when_fast() -> None:
    law = dataclasses.replace(LAW, smoothing=1e-7)
    assert friction_force(law, np.array(1e-5)) == pytest.approx(80.0, rel=1e-3)
    assert friction_force(law, np.array(-0.1)) == pytest.approx(-60.0, rel=1e-9)


def test_a_loop_closed_without_its_friction_is_refused() -> None:
    system, train = make_drive(TwoMasses(), CONTROL, LAW)
    with pytest.raises(ValueError, match="last inputs"):
        make_rubbing_loop(close_loops(system, [train]))


def test_a_port_that_does_not_exist_is_named() -> None:
    system, train = make_drive(TwoMasses(), CONTROL)
    with pytest.raises(ModelError, match="no input"):
        close_loops(system, [train], inputs=[("nose", "x")])
