"""Loops closed around free motors: poles, response and lag are those derived by hand."""

import dataclasses
import math
from functools import partial

import numpy as np
import pytest

from common import approx, present
from headstock.geometry.machine.drives import Cascade
from headstock.solvers.control.drive_loops import (
    ENCODER,
    close_loops,
    find_velocity_lag,
)
from headstock.solvers.control.drive_trains import DriveTrain, free_motors
from headstock.solvers.control.linear_blocks import LARGEST_ANGLE, make_dead_time
from headstock.solvers.control.margins import find_margins
from headstock.solvers.control.stability import find_loop_poles
from headstock.solvers.linear.modal_analysis import solve_modal
from headstock.solvers.second_order import ComplexArray, SecondOrderSystem
from headstock.solvers.state_spaces.time_response import solve_time_response
from headstock.validation.machines.drive_cases import (
    LOAD,
    _closed_loop_poles,
    _delayed_pole,
    _step_response,
    _TwoMasses,
    make_drive,
)

MASSES = _TwoMasses()
CONTROL = Cascade(position_gain=40.0, velocity_gain=2e4, integral_time=0.02)
change = partial(dataclasses.replace, CONTROL)


def upper(poles: ComplexArray) -> ComplexArray:
    return np.sort_complex(poles[poles.imag >= 0.0])


def test_a_free_motor_leaves_one_motion_at_exactly_zero_hertz() -> None:
    system, _ = make_drive(MASSES, CONTROL)
    modes = solve_modal(system)
    assert modes.rigid_count == 1
    assert modes.frequencies_hz[1] == approx(MASSES.free_hz, rel=1e-12)


def test_damping_in_proportion_to_stiffness_stays_in_proportion_when_motors_are_let_go() -> None:
    beta, stretch = 2e-5, np.array([1.0, -0.1])
    stiffness = 3e7 * np.outer(stretch, stretch)
    system = SecondOrderSystem(
        np.diag([40.0, 3.0]), beta * stiffness, stiffness, {}, {}, ("table", "nut")
    )
    train = DriveTrain(
        name="X", axis="X", joint="screw", control=CONTROL.control, stretch=stretch, stiffness=3e7,
        thread=6e7, slide=np.array([1.0, 0.0]), scale=np.array([1.0, 0.0]), stator=np.zeros(2),
        motor_mass=50.0, beta=beta, screw_mass=20.0, coupling=6e7,
    )  # fmt: skip
    for drive in (train, dataclasses.replace(train, screw_mass=0.0)):
        freed = free_motors(system, [drive])
        np.testing.assert_allclose(present(freed.damping), beta * freed.stiffness, rtol=1e-12)


@pytest.mark.parametrize("encoder", ["motor", "scale"])
def test_poles_are_the_roots_of_the_polynomial_derived_by_hand(encoder: str) -> None:
    control = change(encoder=encoder)
    system, train = make_drive(MASSES, control)
    found = find_loop_poles(close_loops(system, [train])).poles
    np.testing.assert_allclose(
        np.sort_complex(found), upper(_closed_loop_poles(MASSES, control)), rtol=1e-8
    )


def test_poles_with_dead_time_solve_the_transcendental_equation() -> None:
    control = change(dead_time=4e-4)
    system, train = make_drive(MASSES, control)
    poles = find_loop_poles(close_loops(system, [train]))
    inside = poles.poles[np.abs(poles.poles) * control.dead_time < LARGEST_ANGLE]
    assert len(inside) == 4
    for pole in inside:
        assert abs(_delayed_pole(MASSES, control, pole) - pole) < 2e-6 * abs(pole)


def test_the_dead_time_has_gain_one_and_the_right_phase_as_far_as_it_promises() -> None:
    block = make_dead_time(2.0)
    angles = np.linspace(0.1, LARGEST_ANGLE, 20)
    resolvent = 0.5j * angles[:, None, None] * np.eye(len(block.a)) - block.a
    values = (block.c @ np.linalg.solve(resolvent, block.b[None]) + block.d)[:, 0, 0]
    np.testing.assert_allclose(np.abs(values), 1.0, rtol=0.0, atol=1e-13)
    assert np.abs(np.angle(values * np.exp(1j * angles))).max() < 1e-4


def test_the_step_response_is_the_sum_of_residues() -> None:
    system, train = make_drive(MASSES, CONTROL)
    loop = close_loops(system, [train], outputs=[LOAD])
    loads = np.zeros((2001, 3))
    loads[:, 0] = 1.0
    found = solve_time_response(loop.space, loads, 1e-4)
    np.testing.assert_allclose(
        found.outputs[:, 0], _step_response(MASSES, CONTROL, found.times), atol=1e-9
    )


@pytest.mark.parametrize("forward", [0.0, 0.6, 1.0])
def test_the_lag_at_constant_speed_is_the_speed_over_kv_less_feed_forward(forward: float) -> None:
    system, train = make_drive(MASSES, change(velocity_feed_forward=forward, dead_time=1e-3))
    lag, _ = find_velocity_lag(close_loops(system, [train]), "X")
    assert lag == approx((1.0 - forward) / CONTROL.position_gain, abs=1e-12)


def test_full_feed_forward_of_a_stiff_drive_follows_without_error() -> None:
    stiff = dataclasses.replace(MASSES, stiffness=1e12)
    control = change(velocity_feed_forward=1.0, acceleration_feed_forward=stiff.motor + stiff.load)
    system, train = make_drive(stiff, control)
    loop = close_loops(system, [train], outputs=[LOAD], up_to_hz=1000.0)
    times = 1e-4 * np.arange(3000)
    loads = np.column_stack(
        [1.0 - np.cos(20.0 * times), 20.0 * np.sin(20.0 * times), 400.0 * np.cos(20.0 * times)]
    )
    found = solve_time_response(loop.space, loads, 1e-4)
    assert np.abs(found.outputs[:, 0] - loads[:, 0]).max() < 1e-6


def test_a_coupling_without_a_screw_is_in_series_and_with_a_light_one_the_same() -> None:
    system, train = make_drive(MASSES, CONTROL)
    fixed = dataclasses.replace(
        system, mass=system.mass[:1, :1], damping=None, stiffness=system.stiffness[:1, :1]
    )
    fixed = dataclasses.replace(
        fixed, inputs={LOAD: np.ones(1)}, outputs={LOAD: np.ones(1)}, labels=("load",)
    )
    series = free_motors(fixed, [dataclasses.replace(train, coupling=2e7)])
    light = free_motors(fixed, [dataclasses.replace(train, coupling=2e7, screw_mass=1e-6)])
    expected = math.sqrt((1.0 / (1.0 / 5e7 + 1.0 / 2e7)) * (1.0 / 80.0 + 1.0 / 120.0)) / (
        2.0 * math.pi
    )
    assert solve_modal(series).frequencies_hz[1] == approx(expected, rel=1e-9)
    assert solve_modal(light).frequencies_hz[1] == approx(expected, rel=1e-6)


def test_two_drives_of_one_axis_share_its_set_point() -> None:
    system, train = make_drive(MASSES, CONTROL)
    fixed = dataclasses.replace(
        system, mass=system.mass[:1, :1], damping=None, stiffness=2.0 * system.stiffness[:1, :1]
    )
    fixed = dataclasses.replace(
        fixed, inputs={LOAD: np.ones(1)}, outputs={LOAD: np.ones(1)}, labels=("load",)
    )
    pair = [train, dataclasses.replace(train, name="X2")]
    loop = close_loops(free_motors(fixed, pair), pair, outputs=[LOAD])
    assert loop.space.inputs == (("X", "position"), ("X", "velocity"), ("X", "acceleration"))
    settled = -loop.space.c @ np.linalg.solve(loop.space.a, loop.space.b[:, 0])
    assert settled[loop.space.outputs.index(("X2", ENCODER))] == approx(1.0, rel=1e-9)


def test_margins_say_by_how_much_the_gains_may_rise() -> None:
    control = change(dead_time=1e-3)
    system, train = make_drive(MASSES, control)
    (margins,) = find_margins(system, [train], to_hz=2000.0)
    assert margins.gain is not None

    def grows(scale: float) -> int:
        changed = dataclasses.replace(
            train,
            control=change(dead_time=1e-3, velocity_gain=scale * CONTROL.velocity_gain).control,
        )
        return len(find_loop_poles(close_loops(system, [changed])).growing())

    # velocity_gain multiplies the whole loop
    assert not grows(0.995 * margins.gain)
    assert grows(1.005 * margins.gain)


def test_gains_may_fall_to_the_lowest_gain_and_no_further() -> None:
    system, train = make_drive(MASSES, CONTROL)
    (margins,) = find_margins(system, [train], to_hz=2000.0)
    assert margins.gain is None
    assert margins.lowest_gain is not None

    def grows(scale: float) -> bool:
        changed = dataclasses.replace(
            train, control=change(velocity_gain=scale * CONTROL.velocity_gain).control
        )
        return bool(find_loop_poles(close_loops(system, [changed])).growing())

    assert not grows(1.005 * margins.lowest_gain)
    assert grows(0.995 * margins.lowest_gain)
