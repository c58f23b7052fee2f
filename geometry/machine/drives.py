"""Drives of machine axes as data: motor, transmission, controller and friction."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from headstock.geometry.frames import FloatArray

Encoder = Literal["motor", "scale"]
# columns of what a controller gets: set position, speed, acceleration, measured position, motor speed
SET_SPEED, SET_ACCELERATION, MEASURED, MOTOR_SPEED = 1, 2, 3, 4
CONTROL_INPUTS = 5


@dataclass(frozen=True, eq=False)
class LinearBlock:
    """A linear system without names: ``x' = A x + B u``, at a step ``x+ = A x + B u``; ``y = C x +
    D u``.

    Attributes:
        a: ``(n, n)``.
        b: ``(n, n_inputs)``.
        c: ``(n_outputs, n)``.
        d: ``(n_outputs, n_inputs)``.
        step_s: Between two samples [s]; zero in continuous time.
    """

    a: FloatArray
    b: FloatArray
    c: FloatArray
    d: FloatArray
    step_s: float = 0.0

    @staticmethod
    def gain(*factors: float) -> "LinearBlock":
        """A weighted sum of inputs, without states."""
        count = len(factors)
        return LinearBlock(
            np.zeros((0, 0)),
            np.zeros((0, count)),
            np.zeros((1, 0)),
            np.array([factors], dtype=float),
        )


@dataclass(frozen=True, eq=False)
class AxisControl:
    """A linear controller of an axis, all as seen along the axis: errors make a force.

    Attributes:
        errors: ``(k, 5)`` each error per set position, speed and acceleration, measured position and
            motor speed. Positions count by their difference alone.
        law: From the errors to the force [N].
        acceleration_feed_forward: Force per commanded acceleration [kg].
        filters: Blocks that the force passes, one after the other.
        dead_time: From a measurement to the force it leads to [s].
        current_lag: Time constant of the current loop [s].
        encoder: What the position controller sees; motor speeds are those of the motor.
        is_cascade: It was written as gains, not as a controller of its own form.
    """

    errors: FloatArray
    law: LinearBlock
    acceleration_feed_forward: float = 0.0
    filters: tuple[LinearBlock, ...] = ()
    dead_time: float = 0.0
    current_lag: float = 0.0
    encoder: Encoder = "motor"
    is_cascade: bool = False

    @property
    def position_gain(self) -> float | None:
        """Speed per position error [1/s] where one error compares speeds, as in a cascade."""
        speed = -float(self.errors[0, MOTOR_SPEED])
        return float(self.errors[0, 0]) / speed if len(self.errors) == 1 and speed else None

    @property
    def velocity_gain(self) -> float | None:
        """Direct force per speed error [N s/m] where one error compares speeds."""
        return None if self.position_gain is None else float(self.law.d[0, 0])


@dataclass(frozen=True)
class Cascade:
    """Gains of P position control and PI velocity control, all as seen along the axis.

    Attributes:
        position_gain: kv [1/s].
        velocity_gain: Force per velocity error [N s/m].
        integral_time: Of the velocity controller [s]; infinite for a P controller.
        velocity_feed_forward: Share of the commanded velocity that is added to the position
            controller's [-].
        acceleration_feed_forward: Force per commanded acceleration [kg].
        dead_time: From a measurement to the force it leads to [s].
        current_lag: Time constant of the current loop [s].
        encoder: What the position controller sees; the velocity controller sees the motor.
        filters: Blocks that the force passes.
    """

    position_gain: float
    velocity_gain: float
    integral_time: float = math.inf
    velocity_feed_forward: float = 0.0
    acceleration_feed_forward: float = 0.0
    dead_time: float = 0.0
    current_lag: float = 0.0
    encoder: Encoder = "motor"
    filters: tuple[LinearBlock, ...] = ()

    @property
    def control(self) -> AxisControl:
        """The controller with these gains; the state of its integrator is a force."""
        kp = self.velocity_gain
        law = LinearBlock.gain(kp)
        if math.isfinite(self.integral_time):
            rate = np.array([[kp / self.integral_time]])
            law = LinearBlock(np.zeros((1, 1)), rate, np.ones((1, 1)), law.d)
        return AxisControl(
            errors=velocity_error(self.position_gain, self.velocity_feed_forward),
            law=law,
            acceleration_feed_forward=self.acceleration_feed_forward,
            filters=self.filters,
            dead_time=self.dead_time,
            current_lag=self.current_lag,
            encoder=self.encoder,
            is_cascade=True,
        )


def velocity_error(position_gain: float, feed_forward: float) -> FloatArray:
    """Return the row ``(1, 5)`` of the speed error behind P position control."""
    return np.array([[position_gain, feed_forward, 0.0, -position_gain, -1.0]])


@dataclass(frozen=True)
class GuideFriction:
    """Friction along an axis: ``(c + (s - c) exp(-(v / v_s)^2)) tanh(v / v_e) + d v``.

    Attributes:
        coulomb: c, sliding friction [N].
        breakaway: s, at rest [N].
        stribeck_speed: v_s [m/s].
        viscous: d [N s/m].
        smoothing: v_e, below which the law is smooth [m/s].
    """

    coulomb: float = 0.0
    breakaway: float = 0.0
    stribeck_speed: float = 1e-3
    viscous: float = 0.0
    smoothing: float = 1e-5


@dataclass(frozen=True)
class TorqueRipple:
    """A wave of a motor's torque, ``torque sin(per_turn angle + phase)``, its angle zero at position
    zero of the axis.

    Attributes:
        torque: Amplitude [N m].
        phase: At position zero [rad].
    """

    torque: float
    per_turn: int
    phase: float = 0.0


@dataclass(frozen=True)
class Drive:
    """A drive of an axis: of a linear one through a ball screw, of a rotary one through a gear or
    directly.

    Attributes:
        joint: Its ball screw, nut at the first end; of a rotary axis what it turns across.
        motor_inertia: Of rotor and coupling [kg m^2].
        lead: Travel per turn of the motor [m], of a rotary axis [rad].
        screw_inertia: Of the screw about its axis [kg m^2]; zero where it does not count.
        coupling: Torsional stiffness between motor and screw [N m/rad]; infinite where it is rigid.
        scale: Point whose motion along the axis a linear scale reads, tool against work; None for
            the place of the screw.
        friction: Along the axis; None where there is none.
        acceleration_share: Share of the axis' inertia that acceleration feed-forward carries [-].
        ripple: Waves of the motor's torque.
    """

    name: str
    axis: str
    joint: str
    motor_inertia: float
    lead: float
    control: AxisControl
    screw_inertia: float = 0.0
    coupling: float = math.inf
    scale: str | None = None
    friction: GuideFriction | None = None
    acceleration_share: float = 0.0
    ripple: tuple[TorqueRipple, ...] = ()


def ripple_force(drive: Drive, positions: FloatArray) -> FloatArray:
    """Return the force along the axis ``(n,)`` by the ripple of a motor's torque at positions of
    the axis [N].

    Args:
        positions: ``(n,)`` [m].
    """
    turns, force = positions / drive.lead, np.zeros_like(positions)
    for wave in drive.ripple:
        force += wave.torque * np.sin(2.0 * math.pi * wave.per_turn * turns + wave.phase)
    return 2.0 * math.pi / drive.lead * force
