"""A motor that drives a load through a spring and a damper: everything about it in closed form, derived by hand.

With ``Z = m2 s^2 + d s + k`` and ``N = d s + k`` the load follows the motor as ``x2 = N / Z x1``, and the motor a force as

    x1 = Z / (s^2 (m1 m2 s^2 + (m1 + m2) (d s + k))) F

The controller ``F = kp (1 + 1 / (T_n s)) (kv (x_set - x_measured) + f_v s x_set - s x1) exp(-s T)`` leads to the polynomials below.
"""

import math
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.drives import AxisControl, GuideFriction
from headstock.solvers.control.drive_trains import DriveTrain, free_motors
from headstock.solvers.second_order import ComplexArray, Port, SecondOrderSystem

LOAD = ("load", "x")


@dataclass(frozen=True)
class TwoMasses:
    """Motor, load and what is between them.

    Attributes:
        motor: m1 [kg].
        load: m2 [kg].
        stiffness: k [N/m].
        damping: d [N s/m].
    """

    motor: float = 80.0
    load: float = 120.0
    stiffness: float = 5e7
    damping: float = 2e3

    @property
    def locked_hz(self) -> float:
        """Natural frequency with the motor held [Hz]."""
        return math.sqrt(self.stiffness / self.load) / (2.0 * math.pi)

    @property
    def free_hz(self) -> float:
        """Natural frequency with the motor free [Hz]."""
        return math.sqrt(self.stiffness * (1.0 / self.motor + 1.0 / self.load)) / (2.0 * math.pi)


def make_drive(
    masses: TwoMasses, control: AxisControl, friction: GuideFriction | None = None
) -> tuple[SecondOrderSystem, DriveTrain]:
    """The system with its motor free, and the drive ``X``; the load is the port ``("load", "x")``."""
    one: FloatArray = np.ones(1)
    row: dict[Port, FloatArray] = {LOAD: one}
    held = SecondOrderSystem(
        masses.load * np.eye(1), masses.damping * np.eye(1), masses.stiffness * np.eye(1), row, dict(row), ("load",)
    )
    train = DriveTrain(
        name="X",
        axis="X",
        joint="screw",
        control=control,
        stretch=one,
        stiffness=masses.stiffness,
        thread=masses.stiffness,
        slide=one,
        scale=one,
        stator=np.zeros(1),
        motor_mass=masses.motor,
        damping=masses.damping,
        friction=friction,
    )
    return free_motors(held, [train]), train


def characteristic(masses: TwoMasses, control: AxisControl) -> tuple[FloatArray, FloatArray]:
    """Two polynomials in s, lowest power first: the closed loop's is the first plus the second times ``exp(-s T)``."""
    poly = np.polynomial.polynomial
    load, shaft = _load(masses), _shaft(masses)
    total = masses.motor + masses.load
    plant = np.array([0.0, 0.0, 0.0, total * shaft[0], total * shaft[1], masses.motor * masses.load])
    seen = load if control.encoder == "motor" else shaft
    inner = poly.polyadd(control.position_gain * seen, poly.polymulx(load))
    return plant, np.asarray(control.velocity_gain * poly.polymul([1.0 / control.integral_time, 1.0], inner))


def closed_loop_poles(masses: TwoMasses, control: AxisControl) -> ComplexArray:
    """Roots of the characteristic polynomial without dead time [rad/s]."""
    plant, fed = characteristic(masses, control)
    return np.asarray(np.polynomial.polynomial.polyroots(np.polynomial.polynomial.polyadd(plant, fed)) + 0j)


def delayed_pole(masses: TwoMasses, control: AxisControl, start: complex) -> complex:
    """The exact pole with dead time next to a start, by Newton's method on the quasi-polynomial [rad/s]."""
    poly = np.polynomial.polynomial
    plant, fed = characteristic(masses, control)
    slope, fed_slope = poly.polyder(plant), poly.polyder(fed)
    s, late = start, control.dead_time
    for _ in range(50):
        delay = np.exp(-s * late)
        value = poly.polyval(s, plant) + delay * poly.polyval(s, fed)
        step = value / (poly.polyval(s, slope) + delay * (poly.polyval(s, fed_slope) - late * poly.polyval(s, fed)))
        s = complex(s - step)
        if abs(step) < 1e-13 * abs(s):
            break
    return s


def set_point_response(masses: TwoMasses, control: AxisControl) -> tuple[FloatArray, FloatArray]:
    """Numerator and denominator, lowest power first, of load position over set position, without dead time."""
    poly = np.polynomial.polynomial
    plant, fed = characteristic(masses, control)
    ahead = poly.polymul([1.0 / control.integral_time, 1.0], [control.position_gain, control.velocity_feed_forward])
    numerator = poly.polymul(control.velocity_gain * ahead, _shaft(masses))
    return np.asarray(numerator), np.asarray(poly.polyadd(plant, fed))


def step_response(masses: TwoMasses, control: AxisControl, times: FloatArray) -> FloatArray:
    """Load position ``(n,)`` after a unit step of the set position, by residues at the poles."""
    poly = np.polynomial.polynomial
    numerator, denominator = set_point_response(masses, control)
    poles = poly.polyroots(denominator)
    residues = poly.polyval(poles, numerator) / (poles * poly.polyval(poles, poly.polyder(denominator)))
    return np.asarray(1.0 + (residues * np.exp(np.outer(times, poles))).sum(axis=1).real)


def _load(masses: TwoMasses) -> FloatArray:
    return np.array([masses.stiffness, masses.damping, masses.load])


def _shaft(masses: TwoMasses) -> FloatArray:
    return np.array([masses.stiffness, masses.damping])
