"""Loads over time with friction: a mass on a spring that dry friction stops, in closed form; the
linear limit; impulses; and an integrator of a library in absolute coordinates.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
import pytest

from common import approx
from direct_integration import integrate_pieces
from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.drives import Cascade, GuideFriction
from headstock.solvers.control.drive_loops import close_loops
from headstock.solvers.motion.driven_motion import (
    FrictionTransient,
    sharpen_friction,
    solve_friction_transient,
)
from headstock.solvers.motion.friction import friction_force
from headstock.solvers.motion.friction_loop import friction_channels
from headstock.solvers.state_spaces.load_history import (
    LoadHistory,
    half_sine_load,
    impulse_load,
    recorded_load,
    released_load,
    sine_load,
    step_load,
    step_loads,
)
from headstock.solvers.state_spaces.transient import (
    Response,
    read_response,
    rest_positions,
    solve_transient,
)
from headstock.validation.machines.drive_cases import LOAD, _TwoMasses, make_drive

MASSES = _TwoMasses(motor=80.0, load=120.0, stiffness=5e7, damping=2e3)
CONTROL = Cascade(position_gain=40.0, velocity_gain=2e4, integral_time=0.02)
LAW = GuideFriction(
    coulomb=50.0, breakaway=80.0, stribeck_speed=1e-3, viscous=100.0, smoothing=1e-4
)
PLACES: FloatArray = np.arange(9, dtype=np.float64)
RECORD = recorded_load(0.01 + 2.5e-3 * PLACES, 300.0 * np.sin(1.1 * PLACES))


def respond(
    masses: _TwoMasses,
    control: Cascade,
    law: GuideFriction,
    loads: Sequence[LoadHistory],
    duration: float,
    rate: float,
    *,
    share: float = 1.0,
    up_to_hz: float | None = None,
) -> tuple[FrictionTransient, Response]:
    """Motion of the load with friction, and without."""
    system, train = make_drive(masses, control, law)
    inputs = [(f"push {number}", "x") for number in range(len(loads))]
    system = dataclasses.replace(
        system, inputs={**system.inputs, **dict.fromkeys(inputs, system.inputs[LOAD])}
    )
    channels = friction_channels((train,))
    loop = close_loops(
        system, [train], inputs=[*inputs, *channels], outputs=[LOAD], up_to_hz=up_to_hz
    )
    space = loop.space.select(inputs, [LOAD])
    stepped = step_loads(loads, duration, rate)
    _, _, state = rest_positions(space, loads, duration)
    free = solve_transient(space, stepped, state)
    found = solve_friction_transient(
        sharpen_friction(loop, share), stepped, free, inputs=inputs, outputs=[LOAD]
    )
    return found, read_response(space, free)


def test_dry_friction_takes_the_same_way_in_every_period_and_stops_a_mass() -> None:
    """Amplitudes fall by 4 F / k a period, and the mass stops where the spring is too weak to move
    it.

    Source: Den Hartog (1956), Mechanical Vibrations, section 8.2.
    """
    mass, stiffness, dry, released = 2.0, 2e5, 30.0, 200.0
    # the motor weighs so much that it is the wall, which 200 N move by 2 nm; a stuck mass creeps by 3 nm
    masses = _TwoMasses(motor=1e11, load=mass, stiffness=stiffness, damping=0.0)
    control = Cascade(position_gain=0.5, velocity_gain=2e11)
    law = GuideFriction(coulomb=dry, breakaway=dry, smoothing=1e-7)
    period = 2.0 * np.pi * np.sqrt(mass / stiffness)
    found, free = respond(
        masses, control, law, [released_load(released)], 3.5 * period, 100.0 / period
    )
    times, moved = found.response.sample()
    lost, start = dry / stiffness, released / stiffness
    # half periods turn about +- F / k: 1.0, 0.7, 0.4, 0.1 mm, and there the spring is weaker than 30 N
    for number in range(3):
        half = slice(50 * number, 50 * (number + 1) + 1)
        sign = (-1.0) ** number
        middle = sign * lost
        swing = start - 2.0 * number * lost - lost
        expected = middle + sign * swing * np.cos(
            2.0 * np.pi * (times[half] - times[half][0]) / period
        )
        np.testing.assert_allclose(moved[half, 0], expected, atol=1e-5 * start)
    rest = -(start - 6.0 * lost)
    assert abs(rest) < lost
    np.testing.assert_allclose(moved[151:, 0], rest, atol=1e-5 * start)
    without = free.sample()[1]
    assert abs(without[300, 0]) > 0.99 * start
    assert found.motion.energy.error < 1e-6
    # the spring's energy has gone into the guide
    assert found.energy.initial == approx(0.5 * stiffness * start**2, rel=1e-6)
    gone = 0.5 * stiffness * (start**2 - rest**2)
    assert found.energy.dissipated == approx(gone, rel=1e-3)


def test_without_friction_it_is_the_exact_motion() -> None:
    loads = [
        half_sine_load(100.0, 2e-3, 4e-3),
        step_load(40.0, 0.0123, 0.0171),
        impulse_load(0.3, 0.0201),
        impulse_load(-0.2, 0.0),
        sine_load(20.0, 0.005, 170.0),
        RECORD,
    ]
    found, free = respond(MASSES, CONTROL, GuideFriction(), loads, 0.04, 20e3)
    for part in ("begins", "ends", "begin_speeds", "end_speeds"):
        own, exact = getattr(found.response, part), getattr(free, part)
        np.testing.assert_allclose(own, exact, atol=1e-7 * np.abs(exact).max(), err_msg=part)
    assert found.motion.energy.error < 1e-7
    energy = found.energy
    assert energy.initial + energy.work - energy.dissipated == approx(energy.final, rel=1e-6)


def integrate(law: GuideFriction, times: FloatArray) -> FloatArray:
    """Motion of the load under a step of 150 N from 3 ms on and an impulse of 0.5 N s at 10 ms: motor
    and load in absolute coordinates, then the integrator.
    """

    def rate(time: float, state: FloatArray) -> FloatArray:
        motor, load, motor_speed, speed, total = state
        force = MASSES.stiffness * (motor - load) + MASSES.damping * (motor_speed - speed)
        error = -CONTROL.position_gain * motor - motor_speed
        drive = CONTROL.velocity_gain * error + total
        push = (150.0 if time >= 3e-3 else 0.0) - float(friction_force(law, np.array(speed)))
        return np.array(
            [
                motor_speed,
                speed,
                (drive - force) / MASSES.motor,
                (force + push) / MASSES.load,
                CONTROL.velocity_gain / CONTROL.integral_time * error,
            ]
        )

    kick = np.array([0.0, 0.0, 0.0, 0.5 / MASSES.load, 0.0])
    found = integrate_pieces(
        rate,
        (0.0, 3e-3, 1e-2, float(times[-1])),
        np.zeros(5),
        times,
        method="LSODA",
        rtol=1e-9,
        atol=1e-13,
        kicks={1e-2: kick},
    )
    return found[:, 1]


def test_a_driven_mass_moves_as_an_integrator_of_a_library_says() -> None:
    loads = [step_load(150.0, 3e-3), impulse_load(0.5, 1e-2)]
    found, free = respond(MASSES, CONTROL, LAW, loads, 0.03, 10e3)
    times, moved = found.response.sample()
    expected = integrate(LAW, times)
    size = np.abs(expected).max()
    np.testing.assert_allclose(moved[:, 0], expected, atol=1e-6 * size)
    assert np.abs(free.sample()[1][:, 0] - expected).max() > 0.1 * size
    # the cubic between samples needs speeds that are the slopes
    response = found.response
    mean = (response.ends - response.begins) / np.diff(response.times)[:, None]
    off = mean - 0.5 * (response.begin_speeds + response.end_speeds)
    assert np.abs(off).max() < 1e-2 * np.abs(response.begin_speeds).max()
    assert found.motion.energy.error < 1e-6


def test_energy_balances_where_friction_moves_modes_that_are_left_out() -> None:
    """Friction turns the motor at once by the flexibility of a mode above the range, and the controller
    answers.
    """
    loads = [half_sine_load(600.0, 2e-3, 8e-3)]
    found, _ = respond(MASSES, CONTROL, LAW, loads, 0.03, 10e3, up_to_hz=100.0)
    assert found.motion.energy.error < 1e-7
    assert found.energy.error < 1e-7


@pytest.mark.parametrize("share", [1.0, 0.5])
def test_a_sharper_law_creeps_half_as_fast(share: float) -> None:
    """A force below breakaway makes a smooth law creep at atanh(P / F) times its smoothing."""
    wall = _TwoMasses(motor=1.0, load=120.0, stiffness=5e7, damping=2e3)
    weak = Cascade(position_gain=0.0, velocity_gain=1e-6)
    law = GuideFriction(coulomb=80.0, breakaway=80.0, smoothing=1e-4)
    found, _ = respond(wall, weak, law, [step_load(40.0)], 0.05, 2e3, share=share)
    _, moved = found.response.sample()
    crept = (moved[-1, 0] - moved[50, 0]) / 0.025
    assert crept == approx(share * 1e-4 * np.arctanh(0.5), rel=1e-3)
