"""Small motions of a compliant mechanism about poses: its second-order system, natural modes, static compliance (eq. 15)."""

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
        tool: ``(..., 6, c)`` motion of the tool point and its turning in the ground frame of the chains.
    """

    kinematics: Kinematics
    from_compliant: FloatArray
    mass: FloatArray
    stiffness: FloatArray
    tool: FloatArray


@dataclass(frozen=True, eq=False)
class PoseModes:
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
    mass = np.swapaxes(from_compliant, -1, -2) @ dynamics.mass @ from_compliant
    tool = mechanism.marks.index(model.tool)
    motion = np.concatenate([kinematics.of_position[..., tool, :, :], kinematics.of_turn[..., tool, :, :]], axis=-2)
    stiffness = model.springs.stiffness(states[..., mechanism.driven_slice])
    return SmallMotions(kinematics, from_compliant, mass, stiffness, motion @ from_compliant)


def solve_pose_modes(motions: SmallMotions) -> PoseModes:
    """Natural modes by the symmetric form ``S M^-1 S`` of the springs ``S^2``, inverted: ``L^-1`` of the mass is not needed.

    ``M x = (1 / omega^2) S^2 x`` with ``y = S x`` is the symmetric problem ``(S^-1 M S^-1) y = y / omega^2``.
    """
    root = np.sqrt(motions.stiffness)
    squares, vectors = np.linalg.eigh(motions.mass / root[..., :, None] / root[..., None, :])
    squares, vectors = squares[..., ::-1], vectors[..., ::-1]
    shapes = vectors / root[..., :, None] / np.sqrt(squares)[..., None, :]
    return PoseModes(1.0 / (2.0 * np.pi * np.sqrt(squares)), shapes, vectors**2)


def tool_compliance(motions: SmallMotions) -> FloatArray:
    """Static compliance ``(..., 6, 6)`` of the tool point [m/N, rad/N, 1/N, rad/(N m)]: ``J K^-1 J^T``."""
    return np.asarray((motions.tool / motions.stiffness[..., None, :]) @ np.swapaxes(motions.tool, -1, -2))


def pose_system(model: CompliantMechanism, motions: SmallMotions, point: str, axes: FloatArray) -> SecondOrderSystem:
    """One pose as a second-order system with the tool point as its port.

    Args:
        model: The mechanism.
        motions: At one pose.
        point: Name of the tool point, for the labels of inputs and outputs.
        axes: ``(3, 3)`` columns are the axes of the ports in the ground frame of the chains.
    """
    turned = np.kron(np.eye(2), axes.T) @ motions.tool
    ports = {(point, name): turned[row] for row, name in enumerate(DOF_NAMES)}
    return SecondOrderSystem(
        mass=motions.mass,
        damping=model.damping,
        stiffness=np.diag(motions.stiffness),
        inputs=ports,
        outputs=ports,
        labels=model.springs.labels,
    )
