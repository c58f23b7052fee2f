"""Responses of machines under control against transfer functions written by hand: a driven mass,
and one leg of a mechanism.
"""

import dataclasses
import math

import numpy as np
import pytest

from common import approx
from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.drives import Cascade, Drive, GuideFriction
from headstock.geometry.mechanisms.mechanism import Marker, Mechanism, prismatic
from headstock.reduction.coupling.drives import find_moved_mass, make_rigid_train
from headstock.solvers.control.closed_response import control_forces, prepare_closed_frf
from headstock.solvers.control.drive_loops import close_loops
from headstock.solvers.control.drive_trains import DriveTrain, free_motors
from headstock.solvers.control.stability import find_loop_poles
from headstock.solvers.errors import UnstableControlError
from headstock.solvers.linear.frequency_response import evaluate_frf
from headstock.solvers.mechanisms.dynamics import CompliantMechanism, LumpedSprings, MechanismBody
from headstock.solvers.mechanisms.modes import linearise_poses, marker_motion, pose_system
from headstock.solvers.motion.driven_motion import solve_motion
from headstock.solvers.motion.friction_loop import friction_channels
from headstock.solvers.second_order import (
    ComplexArray,
    SecondOrderSystem,
    input_columns,
    output_rows,
)

LEAD = 0.01
PITCH = LEAD / (2.0 * math.pi)
BEAM, PLATFORM, SPRING, MOTOR = 65.0, 200.0, 1.5e8, 2e-3
TIP = ("tip", "z")
LINES = np.concatenate([[0.0], np.geomspace(0.3, 900.0, 80)])
CASCADE = Cascade(30.0, 2e5, integral_time=0.02, dead_time=3.75e-4, current_lag=3e-4)


def drive_of_leg(control: Cascade = CASCADE, friction: GuideFriction | None = None) -> Drive:
    return Drive("leg", "q", "", MOTOR, LEAD, control.control, friction=friction)


def make_leg(drive: Drive, anchor: float = 0.0) -> tuple[SecondOrderSystem, DriveTrain]:
    """A vertical leg that grows, a beam on it, and a platform on a spring at its end."""
    chain = (prismatic("z", "q"), Marker("beam"), prismatic("z", "d"), Marker("tip"))
    mechanism = Mechanism("leg", chains=(chain,), closures=(), driven=("q",), compliant=("d",))
    model = CompliantMechanism(
        mechanism,
        (MechanismBody("beam", "beam", BEAM), MechanismBody("platform", "tip", PLATFORM)),
        LumpedSprings(np.array([1.0 / SPRING]), np.zeros(1), np.array([0]), ("spring",)),
        tool="tip",
    )
    motions = linearise_poses(model, np.array([1.0, 0.0]), released=["q"])
    free = pose_system(model, motions, {"tip": marker_motion(model, motions, "tip")})
    slide = np.array([0.0, 1.0])
    train = make_rigid_train(
        drive,
        slide=slide,
        scale=np.array([1.0, 1.0]),
        stator=np.zeros(2),
        moved_mass=float(find_moved_mass(free, slide[None])[0]),
    )
    train = dataclasses.replace(train, anchor=anchor)
    return free_motors(free, [train]), train


def laplace_leg(control: Cascade, omega: FloatArray, *, at_scale: bool = False) -> ComplexArray:
    """Motion of the platform per force on it: ``m2 s^2 x = k (q - x) + f`` and ``m1 s^2 q = k (x -
    q) - G (kv y + s q)``.
    """
    s = 1j * omega
    mass = BEAM + MOTOR / PITCH**2
    gain = (
        control.velocity_gain
        * (1.0 + 1.0 / (control.integral_time * s))
        * np.exp(-s * control.dead_time)
        / (1.0 + s * control.current_lag)
    )
    # the equations as [[a, b], [c, d]] (x, q) = (f, 0)
    a, b = PLATFORM * s**2 + SPRING, -SPRING
    seen_x, seen_q = (control.position_gain, 0.0) if at_scale else (0.0, control.position_gain)
    c = -SPRING + gain * seen_x
    d = mass * s**2 + SPRING + gain * (seen_q + s)
    return np.asarray(d / (a * d - b * c))


@pytest.mark.parametrize("encoder", ["motor", "scale"])
def test_a_leg_under_control_responds_as_its_transfer_function_says(encoder: str) -> None:
    control = dataclasses.replace(CASCADE, encoder=encoder)  # type: ignore[arg-type]
    system, train = make_leg(drive_of_leg(control))
    model = prepare_closed_frf(system, [train], inputs=[TIP], outputs=[TIP])
    found = evaluate_frf(model, LINES).receptance[:, 0, 0]
    expected = laplace_leg(control, 2.0 * np.pi * LINES[1:], at_scale=encoder == "scale")
    np.testing.assert_allclose(found[1:], expected, rtol=1e-9)
    # the integrator holds what it sees where it is
    at_rest = 1.0 / SPRING if encoder == "motor" else 0.0
    assert found[0].real == approx(at_rest, rel=1e-9, abs=1e-9 / SPRING)
    assert train.control.acceleration_feed_forward == 0.0


@pytest.mark.parametrize("encoder", ["motor", "scale"])
def test_what_control_adds_to_the_dynamic_stiffness_gives_the_same_response(encoder: str) -> None:
    control = dataclasses.replace(CASCADE, encoder=encoder)  # type: ignore[arg-type]
    # the spring that anchors a motor is taken off again
    system, train = make_leg(drive_of_leg(control), anchor=1e7)
    omega = 2.0 * np.pi * LINES[1:]
    free = system.stiffness - omega[:, None, None] ** 2 * system.mass
    dynamic = free + control_forces(system, [train]).dynamic_stiffness(omega)
    moved = np.linalg.solve(dynamic, input_columns(system, [TIP]).astype(complex))
    found = (output_rows(system, [TIP]) @ moved)[:, 0, 0]
    expected = laplace_leg(control, omega, at_scale=encoder == "scale")
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_feed_forward_carries_all_that_the_motor_of_a_leg_moves() -> None:
    drive = dataclasses.replace(drive_of_leg(), acceleration_share=1.0)
    _, train = make_leg(drive)
    moved = BEAM + PLATFORM + MOTOR / PITCH**2
    assert train.control.acceleration_feed_forward == approx(moved, rel=1e-12)


def test_poles_of_a_leg_are_the_roots_of_its_characteristic_polynomial() -> None:
    control = Cascade(30.0, 2e5, integral_time=0.02)
    system, train = make_leg(drive_of_leg(control))
    found = find_loop_poles(close_loops(system, [train])).poles
    mass, kp, kv = BEAM + MOTOR / PITCH**2, control.velocity_gain, control.position_gain
    poly = np.polynomial.polynomial
    fed = kp * poly.polymul([1.0 / control.integral_time, 1.0], [kv, 1.0])
    spring = np.array([SPRING, 0.0, PLATFORM])
    whole = poly.polysub(
        poly.polymul(spring, poly.polyadd([0.0, SPRING, 0.0, mass], fed)), [0.0, SPRING**2]
    )
    roots = poly.polyroots(whole)
    for pole in found:
        assert np.abs(roots - pole).min() < 1e-9 * abs(pole)
    assert 2 * len(found) - np.count_nonzero(np.abs(found.imag) == 0.0) == len(roots)


def test_an_unstable_loop_has_no_response() -> None:
    system, train = make_leg(drive_of_leg(dataclasses.replace(CASCADE, position_gain=5e3)))
    with pytest.raises(UnstableControlError, match="largest stable kv"):
        prepare_closed_frf(system, [train], inputs=[TIP], outputs=[TIP])


def test_a_leg_that_rubs_balances_its_energy() -> None:
    friction = GuideFriction(coulomb=150.0, breakaway=200.0, viscous=1e3, smoothing=1e-3)
    control = Cascade(30.0, 2e6, integral_time=0.02, velocity_feed_forward=1.0)
    system, train = make_leg(drive_of_leg(control, friction))
    loop = close_loops(system, [train], outputs=[TIP], inputs=friction_channels((train,)))
    times: FloatArray = np.asarray(np.linspace(0.0, 0.25, 251), dtype=float)
    rate = 2.0 * math.pi * 8.0

    def given(instants: FloatArray) -> FloatArray:
        sine, cosine = np.sin(rate * instants), np.cos(rate * instants)
        return 1e-3 * np.column_stack([1.0 - cosine, rate * sine, rate**2 * cosine])

    found = solve_motion(loop, given, times)
    assert found.energy.error < 1e-6
    # what it dissipates, from its force and the way that the leg slides
    slide = found.outputs[:, loop.space.outputs.index(("leg", "slide"))]
    lost = float(np.trapezoid(found.friction[:, 0], slide))
    assert float(found.energy.friction[-1]) == approx(lost, rel=1e-3)
