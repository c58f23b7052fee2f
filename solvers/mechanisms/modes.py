"""Small motions of a compliant mechanism about poses: its second-order system, natural modes,
static compliance (eq. 15).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from headstock.geometry.frames import DOF_NAMES, FloatArray
from headstock.geometry.mechanisms.closures import Kinematics, close_chains, evaluate_kinematics
from headstock.geometry.mechanisms.mechanism import Mechanism
from headstock.geometry.parts.components import RayleighDamping
from headstock.solvers.mechanisms.dynamics import CompliantMechanism, evaluate_dynamics
from headstock.solvers.mechanisms.partitioning import velocity_maps
from headstock.solvers.second_order import SecondOrderSystem

TINY = 1e-30


@dataclass(frozen=True, eq=False)
class SmallMotions:
    """A mechanism at rest in poses, linear in the compliant coordinates; drives are locked, but
    those let go, whose coordinates follow.

    Attributes:
        from_compliant: ``(..., n, c)`` motion of all coordinates per compliant coordinate.
        mass: ``(..., c, c)``.
        stiffness: ``(..., c)`` [N/m]; zero of drives let go.
        gravity: ``(..., c)`` generalised gravity forces [N].
        geometric: ``(..., c, c)`` stiffness from gravity [N/m]; None where it is not counted.
        released: Driven coordinates that are let go, the last of the ``c``.
    """

    kinematics: Kinematics
    from_compliant: FloatArray
    mass: FloatArray
    stiffness: FloatArray
    gravity: FloatArray
    geometric: FloatArray | None = None
    released: tuple[str, ...] = ()

    @property
    def total_stiffness(self) -> FloatArray:
        """``(..., c, c)`` of springs and gravity."""
        springs = self.stiffness[..., None] * np.eye(self.stiffness.shape[-1])
        return springs if self.geometric is None else springs + self.geometric


@dataclass(frozen=True, eq=False)
class _LumpedModes:
    """Natural modes of many poses.

    Attributes:
        frequencies_hz: ``(..., c)``, rising.
        shapes: ``(..., c, c)`` mass-normalised, one column per mode, in the compliant coordinates.
        energy: ``(..., c, c)`` share of each spring (row) in the strain energy of each mode
            (column).
    """

    frequencies_hz: FloatArray
    shapes: FloatArray
    energy: FloatArray


def linearise_poses(
    model: CompliantMechanism, states: FloatArray, released: Sequence[str] = ()
) -> SmallMotions:
    """Small motions about closed states ``(..., n)`` with compliant coordinates at zero.

    Args:
        released: Driven coordinates that are free to move.
    """
    mechanism = model.mechanism
    kinematics = evaluate_kinematics(mechanism, states)
    maps = _free_maps(mechanism, kinematics, released)
    dynamics = evaluate_dynamics(model, kinematics)
    left = np.swapaxes(maps, -1, -2)
    springs = model.springs.stiffness(states[..., mechanism.driven_slice])
    stiffness = np.concatenate([springs, np.zeros((*springs.shape[:-1], len(released)))], axis=-1)
    gravity = (left @ dynamics.load[..., None])[..., 0]
    geometric = _gravity_stiffness(model, states, released) if model.gravity_stiffening else None
    return SmallMotions(
        kinematics,
        maps,
        left @ dynamics.mass @ maps,
        stiffness,
        gravity,
        geometric,
        tuple(released),
    )


def _free_maps(mechanism: Mechanism, kinematics: Kinematics, released: Sequence[str]) -> FloatArray:
    """Motion ``(..., n, c)`` of all coordinates per compliant one and per drive let go."""
    from_driven, from_compliant = velocity_maps(mechanism, kinematics.closure_jacobian)
    columns = [mechanism.driven.index(name) for name in released]
    return np.concatenate([from_compliant, from_driven[..., columns]], axis=-1)


def _gravity_stiffness(
    model: CompliantMechanism, states: FloatArray, released: Sequence[str] = ()
) -> FloatArray:
    """Geometric stiffness ``(..., c, c)`` [N/m]: by how much gravity's generalised forces fall per
    compliant coordinate.

    The second derivative of the potential energy along motions that keep the loops closed, joint
    forces and all, by the complex step.

    Args:
        states: ``(..., n)`` closed.
        released: Driven coordinates that are free to move: their drives push with what carries the
            weight.
    """
    mechanism = model.mechanism
    free = [*mechanism.compliant, *released]
    columns = []
    for coordinate in map(mechanism.index, free):
        moved = states.astype(complex)
        moved[..., coordinate] += 1j * TINY
        # Newton's method is exact for a step this small, after one correction
        closed = close_chains(mechanism, moved)
        kinematics = evaluate_kinematics(mechanism, closed)
        force = evaluate_dynamics(model, kinematics).load
        maps = _free_maps(mechanism, kinematics, released)
        columns.append((np.swapaxes(maps, -1, -2) @ force[..., None])[..., 0].imag / TINY)
    return -np.stack(columns, axis=-1)


def marker_motion(model: CompliantMechanism, motions: SmallMotions, marker: str) -> FloatArray:
    """Motion of a marker per compliant coordinate, in the ground frame of the chains.

    Args:
        motions: Its small motions about poses ``(...)`` with ``c`` compliant coordinates.

    Returns:
        ``(..., 6, c)``: displacement of the marker's origin, then its rotation.

    Raises:
        ValueError: There is no such marker.
    """
    index = model.mechanism.markers.index(marker)
    kinematics = motions.kinematics
    return (
        np.concatenate(
            [kinematics.of_position[..., index, :, :], kinematics.of_rotation[..., index, :, :]],
            axis=-2,
        )
        @ motions.from_compliant
    )


def solve_lumped_modes(motions: SmallMotions) -> _LumpedModes:
    """Natural modes by the symmetric form ``S M^-1 S`` of the springs ``S^2``, inverted: ``L^-1``
    of the mass is not needed.

    ``M x = (1 / omega^2) S^2 x`` with ``y = S x`` is the symmetric problem ``(S^-1 M S^-1) y = y /
    omega^2``.
    """
    if motions.geometric is not None:
        return _solve_stiffened_modes(motions)
    root = np.sqrt(motions.stiffness)
    eigenvalues, vectors = np.linalg.eigh(motions.mass / root[..., :, None] / root[..., None, :])
    eigenvalues, vectors = eigenvalues[..., ::-1], vectors[..., ::-1]
    shapes = vectors / root[..., :, None] / np.sqrt(eigenvalues)[..., None, :]
    return _LumpedModes(1.0 / (2.0 * np.pi * np.sqrt(eigenvalues)), shapes, vectors**2)


def _solve_stiffened_modes(motions: SmallMotions) -> _LumpedModes:
    """By the Cholesky factor of the mass; shares of energy are those of the springs."""
    inverse = np.linalg.inv(np.linalg.cholesky(motions.mass))
    eigenvalues, vectors = np.linalg.eigh(
        inverse @ motions.total_stiffness @ np.swapaxes(inverse, -1, -2)
    )
    shapes = np.swapaxes(inverse, -1, -2) @ vectors
    energy = motions.stiffness[..., None] * shapes**2
    return _LumpedModes(
        np.sqrt(eigenvalues) / (2.0 * np.pi), shapes, energy / energy.sum(axis=-2, keepdims=True)
    )


def modal_damping(motions: SmallMotions, modes: _LumpedModes, ratios: FloatArray) -> FloatArray:
    """Viscous damping matrix that gives each natural mode its damping ratio: ``sum 2 zeta_k omega_k
    M x_k x_k^T M``.

    Args:
        motions: Small motions about poses ``(...)``, of which the mass is used.
        modes: Natural modes there, mass-normalised.
        ratios: ``(r,)`` damping ratio of the first, second, ... mode, the last for all others.

    Returns:
        ``(..., c, c)`` [N s/m].
    """
    spread = motions.mass @ modes.shapes
    zeta = np.concatenate([ratios, np.full(spread.shape[-1], ratios[-1])])[: spread.shape[-1]]
    return (spread * (4.0 * np.pi * zeta * modes.frequencies_hz)[..., None, :]) @ np.swapaxes(
        spread, -1, -2
    )


@dataclass(frozen=True)
class PoseDamping:
    """What damps a lumped mechanism in any pose.

    Attributes:
        ratios: Of its first, second, ... natural mode, the last for all others; empty for none.
    """

    ratios: tuple[float, ...] = ()
    rayleigh: RayleighDamping = field(default_factory=RayleighDamping)

    def __bool__(self) -> bool:
        return bool(self.ratios) or bool(self.rayleigh)

    def matrix(self, motions: SmallMotions) -> FloatArray:
        """``(..., c, c)`` of small motions about poses [N s/m]."""
        springs = motions.stiffness[..., None] * np.eye(motions.stiffness.shape[-1])
        damping: FloatArray = self.rayleigh.alpha * motions.mass + self.rayleigh.beta * springs
        if not self.ratios:
            return damping
        return damping + modal_damping(motions, solve_lumped_modes(motions), np.array(self.ratios))


def tool_compliance(model: CompliantMechanism, motions: SmallMotions) -> FloatArray:
    """Static compliance ``(..., 6, 6)`` of the tool point [m/N, rad/N, 1/N, rad/(N m)]: ``J K^-1
    J^T``.
    """
    tool = marker_motion(model, motions, model.tool)
    if motions.geometric is not None:
        return tool @ np.linalg.solve(motions.total_stiffness, np.swapaxes(tool, -1, -2))
    return (tool / motions.stiffness[..., None, :]) @ np.swapaxes(tool, -1, -2)


def pose_system(
    model: CompliantMechanism, motions: SmallMotions, channels: Mapping[str, FloatArray]
) -> SecondOrderSystem:
    """One pose as a second-order system.

    Args:
        channels: Name of a point to ``(6, c)`` its motion per compliant coordinate.
    """
    rows = {
        (name, dof): motion[row]
        for name, motion in channels.items()
        for row, dof in enumerate(DOF_NAMES)
    }
    return SecondOrderSystem(
        mass=0.5 * (motions.mass + motions.mass.T),
        damping=None
        if model.damping is None
        else np.pad(model.damping, (0, len(motions.released))),
        stiffness=0.5 * (motions.total_stiffness + motions.total_stiffness.T),
        inputs=rows,
        outputs=rows,
        labels=(*model.springs.labels, *motions.released),
    )
