"""Small motions of a compliant mechanism about poses: its second-order system, natural modes, static compliance (eq. 15)."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import DOF_NAMES, FloatArray
from headstock.geometry.loop_closures import Kinematics, evaluate_kinematics
from headstock.solvers.compliant_mechanism import CompliantMechanism
from headstock.solvers.coordinate_partitioning import velocity_maps
from headstock.solvers.mechanism_dynamics import evaluate_dynamics
from headstock.solvers.second_order import SecondOrderSystem


@dataclass(frozen=True, eq=False)
class SmallMotions:
    """A mechanism at rest in poses, drives held, linear in the compliant coordinates.

    Attributes:
        kinematics: At the poses.
        from_compliant: ``(..., n, c)`` motion of all coordinates per compliant coordinate.
        mass: ``(..., c, c)``.
        stiffness: ``(..., c)`` [N/m].
        gravity: ``(..., c)`` generalised gravity forces [N].
    """

    kinematics: Kinematics
    from_compliant: FloatArray
    mass: FloatArray
    stiffness: FloatArray
    gravity: FloatArray


@dataclass(frozen=True, eq=False)
class LumpedModes:
    """Natural modes of many poses.

    Attributes:
        frequencies_hz: ``(..., c)``, rising.
        shapes: ``(..., c, c)`` mass-normalised, one column per mode, in the compliant coordinates.
        energy: ``(..., c, c)`` share of each spring (row) in the strain energy of each mode (column).
    """

    frequencies_hz: FloatArray
    shapes: FloatArray
    energy: FloatArray


def linearise_poses(model: CompliantMechanism, states: FloatArray) -> SmallMotions:
    """Small motions about closed states ``(..., n)`` with compliant coordinates at zero."""
    mechanism = model.mechanism
    kinematics = evaluate_kinematics(mechanism, states)
    from_compliant = velocity_maps(mechanism, kinematics.closures)[1]
    dynamics = evaluate_dynamics(model, kinematics)
    left = np.swapaxes(from_compliant, -1, -2)
    stiffness = model.springs.stiffness(states[..., mechanism.driven_slice])
    gravity = (left @ dynamics.load[..., None])[..., 0]
    return SmallMotions(kinematics, from_compliant, left @ dynamics.mass @ from_compliant, stiffness, gravity)


def mark_motion(model: CompliantMechanism, motions: SmallMotions, mark: str) -> FloatArray:
    """``(..., 6, c)`` motion of a mark's origin and its turning per compliant coordinate, in the ground frame of the chains."""
    place = model.mechanism.marks.index(mark)
    kinematics = motions.kinematics
    return np.asarray(
        np.concatenate([kinematics.of_position[..., place, :, :], kinematics.of_turn[..., place, :, :]], axis=-2)
        @ motions.from_compliant
    )


def solve_pose_modes(motions: SmallMotions) -> LumpedModes:
    """Natural modes by the symmetric form ``S M^-1 S`` of the springs ``S^2``, inverted: ``L^-1`` of the mass is not needed.

    ``M x = (1 / omega^2) S^2 x`` with ``y = S x`` is the symmetric problem ``(S^-1 M S^-1) y = y / omega^2``.
    """
    root = np.sqrt(motions.stiffness)
    squares, vectors = np.linalg.eigh(motions.mass / root[..., :, None] / root[..., None, :])
    squares, vectors = squares[..., ::-1], vectors[..., ::-1]
    shapes = vectors / root[..., :, None] / np.sqrt(squares)[..., None, :]
    return LumpedModes(1.0 / (2.0 * np.pi * np.sqrt(squares)), shapes, vectors**2)


def modal_damping(motions: SmallMotions, modes: LumpedModes, ratios: FloatArray) -> FloatArray:
    """Damping ``(..., c, c)`` with a ratio for the first, second, ... mode, the last for all others [N s/m]."""
    spread = motions.mass @ modes.shapes
    zeta = np.concatenate([ratios, np.full(spread.shape[-1], ratios[-1])])[: spread.shape[-1]]
    return np.asarray((spread * (4.0 * np.pi * zeta * modes.frequencies_hz)[..., None, :]) @ np.swapaxes(spread, -1, -2))


def tool_compliance(model: CompliantMechanism, motions: SmallMotions) -> FloatArray:
    """Static compliance ``(..., 6, 6)`` of the tool point [m/N, rad/N, 1/N, rad/(N m)]: ``J K^-1 J^T``."""
    tool = mark_motion(model, motions, model.tool)
    return np.asarray((tool / motions.stiffness[..., None, :]) @ np.swapaxes(tool, -1, -2))


def pose_system(model: CompliantMechanism, motions: SmallMotions, ports: Mapping[str, FloatArray]) -> SecondOrderSystem:
    """One pose as a second-order system.

    Args:
        model: The mechanism.
        motions: At one pose.
        ports: Name of a point to ``(6, c)`` its motion per compliant coordinate.
    """
    rows = {(name, dof): motion[row] for name, motion in ports.items() for row, dof in enumerate(DOF_NAMES)}
    return SecondOrderSystem(
        mass=0.5 * (motions.mass + motions.mass.T),
        damping=model.damping,
        stiffness=np.diag(motions.stiffness),
        inputs=rows,
        outputs=rows,
        labels=model.springs.labels,
    )
