"""Loops closed by python-control around the same machine: an independent method, where pip could
install it (``environment/tests.txt``).
"""

import dataclasses
from typing import Any

import numpy as np
import pytest

from common import approx
from headstock.geometry.machine.drives import Cascade, LinearBlock
from headstock.solvers.control.drive_loops import close_loops, open_plant
from headstock.solvers.control.drive_trains import DriveTrain, free_motors
from headstock.solvers.control.margins import find_margins
from headstock.solvers.control.sampled_loops import compare_sampled
from headstock.solvers.control.stability import find_loop_poles
from headstock.solvers.second_order import SecondOrderSystem
from headstock.solvers.state_spaces.state_space import StateSpace
from headstock.validation.machines.drive_cases import LOAD, _TwoMasses, make_drive

control = pytest.importorskip("control")

GAINS = Cascade(position_gain=40.0, velocity_gain=2e4, integral_time=0.02, current_lag=3e-4)


def to_control(space: StateSpace) -> Any:
    return control.ss(space.a, space.b, space.c, space.d)


def plant_and_controller() -> tuple[SecondOrderSystem, DriveTrain, Any, Any]:
    """Force to motor position by python-control, and the controller as transfer functions."""
    system, train = make_drive(_TwoMasses(), GAINS)
    plant = to_control(open_plant(system, [train], outputs=[LOAD]))
    motor = control.ss(plant.A, plant.B, plant.C[1:2], 0.0)
    pi = control.tf(
        [GAINS.velocity_gain * GAINS.integral_time, GAINS.velocity_gain], [GAINS.integral_time, 0.0]
    )
    lag = control.tf([1.0], [GAINS.current_lag, 1.0])
    return system, train, motor, pi * lag


def test_margins_are_those_of_python_control() -> None:
    system, train, motor, inner = plant_and_controller()
    loop = control.tf([1.0, GAINS.position_gain], [1.0]) * inner * control.tf(motor)
    gain, phase, _, gain_at, phase_at, _ = control.stability_margins(loop)
    (ours,) = find_margins(system, [train], to_hz=1000.0)
    assert ours.phase_deg == approx(phase, rel=1e-3)
    assert ours.phase_hz == approx(phase_at / (2.0 * np.pi), rel=1e-3)
    # python-control names the crossing nearest to one: here gains may fall, and how far is what it
    # tells
    assert gain < 1.0
    assert ours.lowest_gain == approx(gain, rel=1e-3)
    assert gain_at > 0.0


def test_two_axes_on_one_machine_closed_one_after_the_other_are_those_closed_at_once() -> None:
    system, train = make_drive(_TwoMasses(), GAINS)
    fixed = dataclasses.replace(
        system,
        mass=np.diag([120.0, 60.0]),
        damping=np.diag([20.0, 30.0]),
        stiffness=np.array([[9e7, -4e7], [-4e7, 9e7]]),
        inputs={LOAD: np.eye(2)[0]},
        outputs={LOAD: np.eye(2)[0]},
        labels=("a", "b"),
    )
    trains = [
        dataclasses.replace(
            train,
            name=name,
            axis=name,
            stretch=row,
            slide=row,
            scale=row,
            stator=np.zeros(2),
            damping=0.0,
        )
        for name, row in (("X", np.array([1.0, 0.0])), ("Y", np.array([0.0, 1.0])))
    ]
    free = free_motors(fixed, trains)
    plant = to_control(open_plant(free, trains))
    # outputs: encoders, motors, slides; close X, then Y around the result
    rates = control.tf([1.0, GAINS.position_gain], [1.0])
    pi = control.tf(
        [GAINS.velocity_gain * GAINS.integral_time, GAINS.velocity_gain], [GAINS.integral_time, 0.0]
    )
    lag = control.tf([1.0], [GAINS.current_lag, 1.0])
    each = control.ss(rates * pi * lag)
    both = control.append(each, each)
    loop = control.feedback(control.ss(plant.A, plant.B, plant.C[:2], np.zeros((2, 2))), both)
    theirs = loop.poles()
    ours = find_loop_poles(close_loops(free, trains)).poles
    assert len(ours) == (theirs.imag >= 0.0).sum()  # one of each pair
    for pole in ours:
        assert np.abs(theirs - pole).min() < 1e-5 * abs(pole)


@pytest.mark.parametrize("step", [2e-4, 2e-3])
def test_a_sampled_loop_has_the_poles_of_that_of_python_control(step: float) -> None:
    system, train = make_drive(_TwoMasses(), GAINS)
    proportional, integral = GAINS.velocity_gain, GAINS.velocity_gain / GAINS.integral_time
    # forward rule: the integrator adds what it has seen one step before
    law = LinearBlock(
        np.ones((1, 1)),
        np.array([[step]]),
        np.array([[integral]]),
        np.array([[proportional]]),
        step,
    )
    sampled = dataclasses.replace(
        train, control=dataclasses.replace(train.control, law=law, dead_time=0.5 * step)
    )
    poles = find_loop_poles(close_loops(system, [sampled]))
    found = compare_sampled(system, [sampled], poles)
    assert found is not None and found.stable
    # what python-control says of the same loop: the lag is behind the hold
    _, _, motor, _ = plant_and_controller()
    lag = control.tf([1.0], [GAINS.current_lag, 1.0])
    moved = control.ss(motor.A, motor.B, np.vstack([motor.C, motor.C @ motor.A]), np.zeros((2, 1)))
    held = control.sample_system(control.ss(moved * control.ss(lag)), step, "zoh")
    gains = np.array([[GAINS.position_gain, 1.0]])
    outside = control.ss(law.a, law.b @ gains, law.c, law.d @ gains, step)
    theirs = np.log(control.feedback(held, outside).poles() + 0j) / step
    near = poles.poles[np.abs(poles.poles) <= 2.0 * np.pi * found.up_to_hz]
    assert len(near) > 1
    distances = np.abs(near[:, None] - theirs).min(axis=1) / np.abs(near)
    assert found.share == approx(float(distances.max()), rel=1e-6)
    # of second order in the step, and a few per cent at a tenth of its rate
    assert 1e-5 < found.share < 0.1
