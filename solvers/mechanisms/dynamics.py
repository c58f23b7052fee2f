"""A closed-loop mechanism of rigid bodies with lumped compliances: its mass, inertial and gravity
forces in all coordinates.

``M = sum m Jp^T Jp + Jw^T I Jw`` and ``h = sum m Jp^T a + Jw^T (I alpha + omega x I omega)`` with
bias accelerations ``a``, ``alpha`` at zero joint accelerations: no matrix of Coriolis terms is
needed (Kane 1961).
"""

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.mechanisms.closures import Kinematics, closure_bias
from headstock.geometry.mechanisms.kinematics import (
    Bias,
    IndexArray,
    Placement,
    cross,
    marker_bias,
    skew_matrices,
)
from headstock.geometry.mechanisms.mechanism import Mechanism


@dataclass(frozen=True, eq=False)
class MechanismBody:
    """A rigid body that is fixed to a marker.

    Attributes:
        name: For energy shares and messages.
        marker: The marker whose frame it is given in.
        mass: [kg].
        center: ``(3,)`` centre of mass [m].
        inertia: ``(3, 3)`` about the centre of mass [kg m^2].
    """

    name: str
    marker: str
    mass: float
    center: FloatArray = field(default_factory=lambda: np.zeros(3))
    inertia: FloatArray = field(default_factory=lambda: np.zeros((3, 3)))


@dataclass(frozen=True, eq=False)
class LumpedSprings:
    """Springs in the compliant coordinates: compliance = constant + per_length times a driven
    length (Bonnemains et al., eq. 2).

    Attributes:
        constant: ``(c,)`` [m/N].
        per_length: ``(c,)`` [1/N]: 1 / EA of the screw where its free length grows with the leg.
        length: ``(c,)`` which driven coordinate that is.
        labels: ``(c,)`` what each is called in energy shares.
    """

    constant: FloatArray
    per_length: FloatArray
    length: IndexArray
    labels: tuple[str, ...]

    def stiffness(self, driven: FloatArray) -> FloatArray:
        """``(..., c)`` [N/m] at driven coordinates ``(..., u)``."""
        return np.asarray(1.0 / (self.constant + self.per_length * driven[..., self.length]))

    def stiffness_slope(self, driven: FloatArray) -> FloatArray:
        """``(..., c)`` derivative of each stiffness by its own length [N/m^2]."""
        return np.asarray(-self.per_length * self.stiffness(driven) ** 2)


@dataclass(frozen=True, eq=False)
class CompliantMechanism:
    """A mechanism with springs in its compliant coordinates.

    Attributes:
        mechanism: Chains and closures; its compliant coordinates carry the springs.
        gravity: ``(3,)`` acceleration in the ground frame of the chains [m/s^2].
        damping: ``(c, c)`` viscous damping of the compliant coordinates [N s/m].
        velocity_terms: Whether Coriolis and centrifugal forces are counted; without them bodies and
            closures answer to accelerations alone.
        gravity_stiffening: Whether small motions include the geometric stiffness due to gravity.
    """

    mechanism: Mechanism
    bodies: tuple[MechanismBody, ...]
    springs: LumpedSprings
    tool: str = "tcp"
    gravity: FloatArray = field(default_factory=lambda: np.zeros(3))
    damping: FloatArray | None = None
    velocity_terms: bool = True
    gravity_stiffening: bool = False


@dataclass(frozen=True, eq=False)
class _BodyArrays:
    """Bodies as arrays: which marker, mass, centre and inertia in its frame."""

    marker: IndexArray
    mass: FloatArray
    center: FloatArray
    inertia: FloatArray


@dataclass(frozen=True, eq=False)
class MechanismDynamics:
    """A mechanism in a state of motion.

    Attributes:
        mass: ``(..., n, n)`` in all coordinates.
        load: ``(..., n)`` gravity less inertial forces at zero joint accelerations.
        closure_jacobian: ``(..., m, n)`` of the loop closures.
        closure_bias: ``(..., m)``.
        tool: ``(..., 3, n)`` Jacobian of the tool point.
        tool_bias: ``(..., 3)`` its bias acceleration [m/s^2].
    """

    placement: Placement
    mass: FloatArray
    load: FloatArray
    closure_jacobian: FloatArray
    closure_bias: FloatArray
    tool: FloatArray
    tool_bias: FloatArray


@lru_cache(maxsize=32)
def _body_arrays(model: CompliantMechanism) -> _BodyArrays:
    """The bodies of a model as arrays."""
    markers = [model.mechanism.markers.index(body.marker) for body in model.bodies]
    return _BodyArrays(
        np.array(markers, dtype=np.intp),
        np.array([body.mass for body in model.bodies]),
        np.array([body.center for body in model.bodies]),
        np.array([body.inertia for body in model.bodies]),
    )


def evaluate_dynamics(
    model: CompliantMechanism, kinematics: Kinematics, rates: FloatArray | None = None
) -> MechanismDynamics:
    """Everything the equations of motion are made of.

    Args:
        model: The mechanism, ``n`` coordinates.
        rates: ``(..., n)`` [1/s]; None for a mechanism at rest.
    """
    placement, closures = kinematics.placement, kinematics.closure_jacobian
    bodies = _body_arrays(model)
    moving, turning = _body_jacobians(bodies, kinematics)
    heavy = bodies.mass[:, None, None] * moving
    spin = bodies.inertia @ turning
    mass = _gram(heavy, moving) + _gram(spin, turning)
    load = (np.swapaxes(heavy, -1, -2) @ model.gravity).sum(axis=-2)
    tool = model.mechanism.markers.index(model.tool)
    if rates is None:
        gamma = np.zeros(closures.shape[:-1])
        tool_bias = np.zeros_like(placement.positions[..., tool, :])
    else:
        bias = marker_bias(placement, rates)
        load = load - _inertial_forces(bodies, placement, bias, heavy=heavy, turning=turning)
        gamma = closure_bias(model.mechanism, placement, bias)
        tool_bias = bias.acceleration[..., tool, :]
    return MechanismDynamics(
        placement, mass, load, closures, gamma, kinematics.of_position[..., tool, :, :], tool_bias
    )


def kinetic_energy(dynamics: MechanismDynamics, rates: FloatArray) -> FloatArray:
    """``(...)`` [J]."""
    return np.asarray(0.5 * np.einsum("...i,...ij,...j->...", rates, dynamics.mass, rates))


def gravity_energy(model: CompliantMechanism, placement: Placement) -> FloatArray:
    """``(...)`` potential energy of all bodies in the gravity field [J]."""
    bodies = _body_arrays(model)
    centers = placement.positions[..., bodies.marker, :] + _arms(bodies, placement)
    return np.asarray(-(bodies.mass * (centers @ model.gravity)).sum(axis=-1))


def _arms(bodies: _BodyArrays, placement: Placement) -> FloatArray:
    return np.asarray(
        (placement.rotations[..., bodies.marker, :, :] @ bodies.center[..., None])[..., 0]
    )


def _body_jacobians(bodies: _BodyArrays, kinematics: Kinematics) -> tuple[FloatArray, FloatArray]:
    """Of the centres of mass ``(..., b, 3, n)``, and of the angular velocity in each body's own
    axes.
    """
    placement = kinematics.placement
    of_rotation = kinematics.of_rotation.take(bodies.marker, axis=-3)
    moving = (
        kinematics.of_position.take(bodies.marker, axis=-3)
        - skew_matrices(_arms(bodies, placement)) @ of_rotation
    )
    return moving, np.swapaxes(placement.rotations[..., bodies.marker, :, :], -1, -2) @ of_rotation


def _inertial_forces(
    bodies: _BodyArrays, placement: Placement, bias: Bias, *, heavy: FloatArray, turning: FloatArray
) -> FloatArray:
    """``Jp^T m a + Jw^T (I alpha + w x I w)`` ``(..., n)`` with the bias accelerations, summed over
    the bodies.
    """
    # heavy is m Jp; turning is Jw in the axes of each body, where its inertia is constant (Newton
    # and Euler)
    arms = _arms(bodies, placement)
    omega, alpha = bias.omega[..., bodies.marker, :], bias.alpha[..., bodies.marker, :]
    acceleration = (
        bias.acceleration[..., bodies.marker, :]
        + cross(alpha, arms)
        + cross(omega, cross(omega, arms))
    )
    to_body = np.swapaxes(placement.rotations[..., bodies.marker, :, :], -1, -2)
    spin, gain = (to_body @ omega[..., None]), (to_body @ alpha[..., None])
    moment = (bodies.inertia @ gain)[..., 0] + cross(spin[..., 0], (bodies.inertia @ spin)[..., 0])
    forces = (
        np.swapaxes(heavy, -1, -2) @ acceleration[..., None]
        + np.swapaxes(turning, -1, -2) @ moment[..., None]
    )
    return np.asarray(forces[..., 0].sum(axis=-2))


def _gram(left: FloatArray, right: FloatArray) -> FloatArray:
    """Sum over bodies of ``left^T right`` as one product."""
    shape = (*left.shape[:-3], -1, left.shape[-1])
    return np.asarray(np.swapaxes(left.reshape(shape), -1, -2) @ right.reshape(shape))
