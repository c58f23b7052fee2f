"""Motors as coordinates along a path against the closed loop in state space, stepped exactly."""

import dataclasses
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.drives import Cascade, Encoder, GuideFriction
from headstock.solvers.control.drive_loops import close_loops
from headstock.solvers.control.drive_trains import DriveTrain
from headstock.solvers.motion.alpha import LinearMotion, ServoMotion, close_motors, integrate_linear
from headstock.solvers.motion.friction import CoordinateFriction, friction_force, stack_laws
from headstock.solvers.second_order import Channel, SecondOrderSystem
from headstock.solvers.state_spaces.time_response import solve_stepped_response

pytestmark = pytest.mark.slow

TABLE, SLIDE, SPRING, DAMPER = 200.0, 90.0, 5e7, 8e3
TIP, MOTOR = ("tip", "z"), ("leg", "force")
WHOLE = 0.3  # seconds


def make_plant() -> SecondOrderSystem:
    """A table on a spring before a slide that a motor moves: spring's stretch, then the slide."""
    mass = np.array([[TABLE, TABLE], [TABLE, TABLE + SLIDE]])
    tip: FloatArray = np.array([1.0, 1.0])
    slide: FloatArray = np.array([0.0, 1.0])
    rows: dict[Channel, FloatArray] = {TIP: tip, MOTOR: slide, ("leg", "motor"): slide}
    rows |= {("leg", "scale"): tip, ("leg", "slide"): slide}
    return SecondOrderSystem(
        mass, np.diag([DAMPER, 0.0]), np.diag([SPRING, 0.0]), rows, rows, ("spring", "slide")
    )


def set_points(times: FloatArray) -> FloatArray:
    """Position, speed and acceleration ``(3, n)`` of a move of 10 mm that starts and ends smoothly."""
    rate = math.pi / (0.6 * WHOLE)
    phase = np.minimum(times, 0.6 * WHOLE) * rate
    size = 0.01 / math.pi
    return np.array(
        [
            size * (phase - 0.5 * np.sin(2.0 * phase)),
            size * rate * (1.0 - np.cos(2.0 * phase)),
            2.0 * size * rate**2 * np.sin(2.0 * phase),
        ]
    )


def push(times: FloatArray) -> FloatArray:
    """Force on the table [N]."""
    return np.asarray(
        400.0 * np.sin(2.0 * math.pi * 35.0 * times) * np.minimum(1.0, 10.0 * times), dtype=float
    )


def close_table(
    control: Cascade, step: float, friction: GuideFriction | None = None
) -> tuple[ServoMotion, FloatArray]:
    """The table with its loop closed, and the force on it ``(n, 3)``."""
    times: FloatArray = np.asarray(np.arange(0.0, WHOLE, step), dtype=float)
    plant, nodes = make_plant(), np.array([0.0, WHOLE])
    tip = np.zeros((2, 3, 2))
    tip[:, 2] = plant.outputs[TIP]
    twice = (2, 2, 2)
    _, speeds, accelerations = set_points(times)
    free = LinearMotion(
        times=times,
        nodes=nodes,
        mass=np.broadcast_to(plant.mass, twice),
        damping=np.broadcast_to(np.diag([DAMPER, 0.0]), twice),
        stiffness=np.broadcast_to(plant.stiffness, twice),
        tool=tip,
        gravity_deflection=np.zeros((2, 2)),
        # the rigid machine is accelerated as the set point says
        load=-accelerations[:, None] * plant.mass[:, 1],
    )
    if friction is not None:
        slide, set_speeds = np.array([1], dtype=np.intp), speeds[:, None]
        rubbing = CoordinateFriction(slide, stack_laws([friction]), set_speeds)
        free = dataclasses.replace(free, friction=rubbing)
    servo = close_motors(
        free,
        [control.control],
        speeds=speeds[:, None],
        accelerations=accelerations[:, None],
        gravity=np.zeros((2, 2)),
        scales=np.broadcast_to(plant.outputs["leg", "scale"], (2, 1, 2)),
    )
    force = np.zeros((len(times), 3))
    force[:, 2] = push(times)
    return servo, force


def deviate(
    control: Cascade, step: float, friction: GuideFriction | None = None
) -> tuple[FloatArray, FloatArray]:
    """Deviation of the tip and force of the drive by generalised-α steps."""
    servo, force = close_table(control, step, friction)
    history = integrate_linear(servo.motion, servo.motion.load + servo.motion.tool_load(force))
    return servo.motion.tool_motion(history.compliant)[:, 2], servo.forces(history)[:, 0]


def deviate_exactly(control: Cascade, step: float) -> tuple[FloatArray, FloatArray]:
    """The same of the closed loop in absolute coordinates, by matrix exponentials."""
    times: FloatArray = np.asarray(np.arange(0.0, WHOLE, step), dtype=float)
    plant = make_plant()
    row = plant.outputs["leg", "slide"]
    train = DriveTrain(
        name="leg",
        axis="leg",
        joint="",
        control=control.control,
        stretch=row,
        stiffness=math.inf,
        thread=math.inf,
        slide=row,
        scale=plant.outputs["leg", "scale"],
        stator=np.zeros(2),
        motor_mass=0.0,
    )
    loop = close_loops(plant, [train], inputs=[TIP], outputs=[TIP])
    given = np.vstack([set_points(times), push(times)]).T
    steps = np.stack([given[:-1], given[1:]], axis=1)
    found = solve_stepped_response(loop.space, times, steps).outputs
    return found[:, 0] - given[:, 0], found[:, -1]


@pytest.mark.parametrize("encoder", ["motor", "scale"])
def test_a_move_and_a_force_deviate_as_the_closed_loop_in_absolute_coordinates(
    encoder: Encoder,
) -> None:
    control = Cascade(
        40.0,
        3e4,
        integral_time=0.02,
        velocity_feed_forward=0.9,
        acceleration_feed_forward=250.0,
        dead_time=3.75e-4,
        current_lag=5e-4,
        encoder=encoder,
    )
    misses = []
    for step in (2e-4, 1e-4):
        own, exact = deviate(control, step), deviate_exactly(control, step)
        misses.append(
            [
                float(np.abs(ours - theirs).max() / np.abs(theirs).max())
                for ours, theirs in zip(own, exact, strict=True)
            ]
        )
    assert max(misses[1]) < 2e-3
    # second order in the step
    for coarse, fine in zip(*misses, strict=True):
        assert 3.0 < coarse / fine < 5.0


RUBBED = Cascade(40.0, 3e4, integral_time=0.02, velocity_feed_forward=0.9)
STICKY = GuideFriction(150.0, 250.0, stribeck_speed=5e-3, viscous=800.0, smoothing=4e-4)


def rub_exactly(step: float) -> FloatArray:
    """Deviation of the tip with friction by equations of motion in absolute coordinates, written by
    hand.
    """
    gain, inverse = RUBBED.velocity_gain, np.linalg.inv(make_plant().mass)

    def rate(time: float, state: FloatArray) -> FloatArray:
        stretch, slide, speeds, held = state[0], state[1], state[2:4], state[4]
        now: FloatArray = np.array([time], dtype=float)
        place, speed, _ = set_points(now)[:, 0]
        wanted = RUBBED.position_gain * (place - slide) + 0.9 * speed - speeds[1]
        force = np.array(
            [
                -SPRING * stretch - DAMPER * speeds[0],
                gain * wanted + held - friction_force(STICKY, speeds[1:])[0],
            ]
        )
        force += push(now)[0]
        accelerations = inverse @ force
        return np.array([*speeds, *accelerations, gain / RUBBED.integral_time * wanted])

    times: FloatArray = np.asarray(np.arange(0.0, WHOLE, step), dtype=float)
    found = solve_ivp(
        rate, (0.0, times[-1]), np.zeros(5), "LSODA", times, rtol=1e-7, atol=1e-11, max_step=2e-3
    )
    return np.asarray(found.y[0] + found.y[1] - set_points(times)[0])


def test_friction_at_true_speeds_is_that_of_an_integration_in_absolute_coordinates() -> None:
    exact = rub_exactly(1e-4)
    found, _ = deviate(RUBBED, 1e-4, STICKY)
    size = np.abs(exact).max()
    assert np.abs(found - exact).max() < 5e-3 * size
    # the table stands at the end, where the push moves it to and fro within its friction
    plain, _ = deviate(RUBBED, 1e-4)
    assert np.abs(plain - exact).max() > 0.1 * size


def test_a_controller_without_integral_sags_under_weight() -> None:
    control = Cascade(40.0, 3e4)
    plant = make_plant()
    weight = -9.81 * plant.mass[:, 1]
    times: FloatArray = np.asarray(np.linspace(0.0, 0.01, 101), dtype=float)
    free = LinearMotion(
        times=times,
        nodes=times[[0, -1]],
        mass=np.broadcast_to(plant.mass, (2, 2, 2)),
        damping=np.zeros((2, 2, 2)),
        stiffness=np.broadcast_to(plant.stiffness, (2, 2, 2)),
        tool=np.zeros((2, 3, 2)),
        gravity_deflection=np.zeros((2, 2)),
        load=np.broadcast_to(weight, (len(times), 2)),
    )
    rest = np.zeros((len(times), 1))
    servo = close_motors(
        free,
        [control.control],
        speeds=rest,
        accelerations=rest,
        gravity=np.broadcast_to(weight, (2, 2)),
        scales=np.zeros((2, 1, 2)),
    )
    sag = [-9.81 * TABLE / SPRING, -9.81 * (TABLE + SLIDE) / (3e4 * 40.0)]
    np.testing.assert_allclose(servo.motion.gravity_deflection[0], sag, rtol=1e-9)
    held = integrate_linear(servo.motion, servo.motion.load)
    np.testing.assert_allclose(servo.forces(held), 9.81 * (TABLE + SLIDE), rtol=1e-9)
