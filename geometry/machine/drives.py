"""Drives of machine axes as data: motor, transmission, controller and friction."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from headstock.geometry.frames import FloatArray

Encoder = Literal["motor", "scale"]


@dataclass(frozen=True)
class AxisControl:
    """A cascade of P position control and PI velocity control, all as seen along the axis.

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
    """

    position_gain: float
    velocity_gain: float
    integral_time: float = math.inf
    velocity_feed_forward: float = 0.0
    acceleration_feed_forward: float = 0.0
    dead_time: float = 0.0
    current_lag: float = 0.0
    encoder: Encoder = "motor"


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
    """A ball screw drive of an axis.

    Attributes:
        joint: Its ball screw, nut at the first end.
        motor_inertia: Of rotor and coupling [kg m^2].
        lead: Travel per turn [m].
        screw_inertia: Of the screw about its axis [kg m^2]; zero where it does not count.
        coupling: Torsional stiffness between motor and screw [N m/rad]; infinite where it is rigid.
        scale: Point whose motion along the axis a linear scale reads, tool against work; None for
            the place of the screw.
        friction: Along the axis; None where there is none.
        cycle: Time between two samples of the controller [s]; zero for a continuous one.
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
    cycle: float = 0.0
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
