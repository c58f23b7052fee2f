"""Mass, inertial and gravity forces of the bodies of a mechanism in all its coordinates (Newton and Euler, projected).

``M = sum m Jp^T Jp + Jw^T I Jw`` and ``h = sum m Jp^T a + Jw^T (I alpha + omega x I omega)`` with bias accelerations ``a``, ``alpha``
at zero joint accelerations: no matrix of Coriolis terms is needed (Kane 1961).
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.mechanisms.closures import Kinematics, closure_bias
from headstock.geometry.mechanisms.kinematics import (
    Bias,
    IndexArray,
    Placement,
    cross,
    mark_bias,
    skew_matrices,
)
from headstock.solvers.mechanisms.compliant_mechanism import CompliantMechanism


@dataclass(frozen=True, eq=False)
class BodyArrays:
    """Bodies as arrays: which mark, mass, centre and inertia in its frame."""

    mark: IndexArray
    mass: FloatArray
    center: FloatArray
    inertia: FloatArray


@dataclass(frozen=True, eq=False)
class MechanismDynamics:
    """A mechanism in a state of motion.

    Attributes:
        placement: Where it is.
        mass: ``(..., n, n)`` in all coordinates.
        load: ``(..., n)`` gravity less inertial forces at zero joint accelerations.
        closures: ``(..., m, n)`` closure Jacobian.
        closure_bias: ``(..., m)``.
        tool: ``(..., 3, n)`` Jacobian of the tool point.
        tool_bias: ``(..., 3)`` its bias acceleration [m/s^2].
    """

    placement: Placement
    mass: FloatArray
    load: FloatArray
    closures: FloatArray
    closure_bias: FloatArray
    tool: FloatArray
    tool_bias: FloatArray


@lru_cache(maxsize=32)
def body_arrays(model: CompliantMechanism) -> BodyArrays:
    """The bodies of a model as arrays."""
    marks = [model.mechanism.marks.index(body.mark) for body in model.bodies]
    return BodyArrays(
        np.array(marks, dtype=np.intp),
        np.array([body.mass for body in model.bodies]),
        np.array([body.center for body in model.bodies]),
        np.array([body.inertia for body in model.bodies]),
    )


def evaluate_dynamics(model: CompliantMechanism, kinematics: Kinematics, rates: FloatArray | None = None) -> MechanismDynamics:
    """Everything the equations of motion are made of.

    Args:
        model: The mechanism, ``n`` coordinates.
        kinematics: At its state.
        rates: ``(..., n)`` [1/s]; None for a mechanism at rest.
    """
    placement, closures = kinematics.placement, kinematics.closures
    bodies = body_arrays(model)
    moving, turning = _body_jacobians(bodies, kinematics)
    heavy = bodies.mass[:, None, None] * moving
    spin = bodies.inertia @ turning
    mass = _gram(heavy, moving) + _gram(spin, turning)
    load = (np.swapaxes(heavy, -1, -2) @ model.gravity).sum(axis=-2)
    tool = model.mechanism.marks.index(model.tool)
    if rates is None:
        gamma, tool_bias = np.zeros(closures.shape[:-1]), np.zeros_like(placement.positions[..., tool, :])
    else:
        bias = mark_bias(placement, rates)
        load = load - _inertial_forces(bodies, placement, bias, (heavy, turning))
        gamma, tool_bias = closure_bias(model.mechanism, placement, bias), bias.acceleration[..., tool, :]
    return MechanismDynamics(placement, mass, load, closures, gamma, kinematics.of_position[..., tool, :, :], tool_bias)


def kinetic_energy(dynamics: MechanismDynamics, rates: FloatArray) -> FloatArray:
    """``(...)`` [J]."""
    return np.asarray(0.5 * np.einsum("...i,...ij,...j->...", rates, dynamics.mass, rates))


def gravity_energy(model: CompliantMechanism, placement: Placement) -> FloatArray:
    """``(...)`` potential energy of all bodies in the gravity field [J]."""
    bodies = body_arrays(model)
    centers = placement.positions[..., bodies.mark, :] + _arms(bodies, placement)
    return np.asarray(-(bodies.mass * (centers @ model.gravity)).sum(axis=-1))


def body_kinetic_shares(model: CompliantMechanism, kinematics: Kinematics, rates: FloatArray) -> FloatArray:
    """``(..., b)`` kinetic energy of each body [J]."""
    bodies = body_arrays(model)
    moving, turning = _body_jacobians(bodies, kinematics)
    speed, spin = (moving @ rates[..., None, :, None])[..., 0], (turning @ rates[..., None, :, None])[..., 0]
    rotary = np.einsum("...bi,bij,...bj->...b", spin, bodies.inertia, spin)
    return np.asarray(0.5 * (bodies.mass * (speed**2).sum(axis=-1) + rotary))


def _arms(bodies: BodyArrays, placement: Placement) -> FloatArray:
    return np.asarray((placement.rotations[..., bodies.mark, :, :] @ bodies.center[..., None])[..., 0])


def _body_jacobians(bodies: BodyArrays, kinematics: Kinematics) -> tuple[FloatArray, FloatArray]:
    """Of the centres of mass ``(..., b, 3, n)``, and of the angular velocity in each body's own axes."""
    placement = kinematics.placement
    of_turn = kinematics.of_turn.take(bodies.mark, axis=-3)
    moving = kinematics.of_position.take(bodies.mark, axis=-3) - skew_matrices(_arms(bodies, placement)) @ of_turn
    return moving, np.swapaxes(placement.rotations[..., bodies.mark, :, :], -1, -2) @ of_turn


def _inertial_forces(bodies: BodyArrays, placement: Placement, bias: Bias, weighed: tuple[FloatArray, FloatArray]) -> FloatArray:
    heavy, turning = weighed
    arms = _arms(bodies, placement)
    omega, alpha = bias.omega[..., bodies.mark, :], bias.alpha[..., bodies.mark, :]
    acceleration = bias.acceleration[..., bodies.mark, :] + cross(alpha, arms) + cross(omega, cross(omega, arms))
    own = np.swapaxes(placement.rotations[..., bodies.mark, :, :], -1, -2)
    spin, gain = (own @ omega[..., None]), (own @ alpha[..., None])
    moment = (bodies.inertia @ gain)[..., 0] + cross(spin[..., 0], (bodies.inertia @ spin)[..., 0])
    forces = np.swapaxes(heavy, -1, -2) @ acceleration[..., None] + np.swapaxes(turning, -1, -2) @ moment[..., None]
    return np.asarray(forces[..., 0].sum(axis=-2))


def _gram(left: FloatArray, right: FloatArray) -> FloatArray:
    """Sum over bodies of ``left^T right`` as one product."""
    shape = (*left.shape[:-3], -1, left.shape[-1])
    return np.asarray(np.swapaxes(left.reshape(shape), -1, -2) @ right.reshape(shape))
