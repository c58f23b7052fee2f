"""Elimination of the passive coordinates: the equations of motion in the compliant ones, and the
forces of the drives.

Wehage and Haug (1982); for a mechanism whose driven coordinates ``u(t)`` are prescribed it is eqs.
6 to 14 of Bonnemains, Chanal, Bouzgarrou and Ray (2010), here in projected form: ``qd = Tu ud + Td
dd``, ``qdd = Tu udd + Td ddd + tb`` with ``Tu = [I; -phi_v^-1 phi_u; 0]``, ``Td = [0; -phi_v^-1
phi_d; I]``, ``tb = [0; -phi_v^-1 gamma; 0]``, so that

    Td^T M Td ddd = Td^T (Q - h + J^T F - M (Tu udd + tb)) - K d - D dd          (their eq. 10)
    s = Tu^T (M qdd + h - Q - J^T F) + 1/2 d^T K'(u) d                           (their eq. 14 and
    the term it lacks)

``M = 6 x 6`` blocks are never formed: the projection is the same algebra with fewer products.
"""

from dataclasses import dataclass

import numpy as np

from headstock.geometry.errors import SingularPoseError
from headstock.geometry.frames import FloatArray
from headstock.geometry.mechanisms.closures import Kinematics, close_kinematics
from headstock.geometry.mechanisms.mechanism import Mechanism
from headstock.solvers.mechanisms.dynamics import (
    CompliantMechanism,
    MechanismDynamics,
    evaluate_dynamics,
)

SINGULAR = 1e-13  # smallest over largest singular value of the closures: as good as zero


@dataclass(frozen=True, eq=False)
class Drive:
    """Driven coordinates at an instant, or at many: ``(..., u)`` positions, speeds and
    accelerations.
    """

    position: FloatArray
    speed: FloatArray
    acceleration: FloatArray


@dataclass(frozen=True, eq=False)
class PartitionedDynamics:
    """Equations of motion in the compliant coordinates, ``mass ddd + damping dd + stiffness d =
    load``, in a state of motion.

    Attributes:
        state: ``(..., n)``.
        rates: ``(..., n)``.
        from_driven: ``(..., n, u)`` ``Tu``.
        from_compliant: ``(..., n, c)`` ``Td``.
        offset: ``(..., n)`` ``Tu udd + tb``: acceleration of all coordinates while the compliant
            ones do not accelerate.
        mass: ``(..., c, c)``.
        load: ``(..., c)`` everything but springs and dampers.
        stiffness: ``(..., c)`` of the springs.
    """

    dynamics: MechanismDynamics
    state: FloatArray
    rates: FloatArray
    from_driven: FloatArray
    from_compliant: FloatArray
    offset: FloatArray
    mass: FloatArray
    load: FloatArray
    stiffness: FloatArray


def velocity_maps(mechanism: Mechanism, closures: FloatArray) -> tuple[FloatArray, FloatArray]:
    """``Tu`` and ``Td`` from the closure Jacobian ``(..., m, n)``.

    Raises:
        SingularPoseError: The closures do not determine the passive coordinates.
    """
    u, v, d = mechanism.driven_slice, mechanism.passive_slice, mechanism.compliant_slice
    outer = np.concatenate([closures[..., u], closures[..., d]], axis=-1)
    passive = closures[..., v]
    sizes = np.linalg.svd(passive, compute_uv=False)
    if passive.shape[-1] and not (sizes[..., -1] > SINGULAR * sizes[..., 0]).all():
        raise SingularPoseError(
            f"{mechanism.name}: the loop closures do not determine the passive coordinates in this pose (condition number "
            f"{float((sizes[..., 0] / np.maximum(sizes[..., -1], np.finfo(float).tiny)).max()):.2g}): it is singular; move the pose a little"
        )
    follow = -np.linalg.solve(passive, outer)
    count = len(mechanism.driven)
    maps = np.zeros((*closures.shape[:-2], closures.shape[-1], outer.shape[-1]), closures.dtype)
    maps[..., u, :count] = np.eye(count)
    maps[..., d, count:] = np.eye(outer.shape[-1] - count)
    maps[..., v, :] = follow
    return maps[..., :count], maps[..., count:]


def compose_state(
    mechanism: Mechanism, driven: FloatArray, compliant: FloatArray, guess: FloatArray
) -> tuple[FloatArray, Kinematics]:
    """All coordinates of a mechanism, the passive ones from the closures, and the kinematics there.

    Args:
        mechanism: With ``n`` coordinates: ``u`` driven, ``v`` passive and ``c`` compliant ones.
        driven: ``(..., u)`` [m, rad].
        compliant: ``(..., c)`` [m, rad].
        guess: ``(..., n)`` or ``(n,)`` closed state nearby, which decides the branch of the passive
            coordinates.

    Raises:
        ClosureError: The loops cannot be closed from there.
    """
    state = np.array(
        np.broadcast_to(guess, (*driven.shape[:-1], guess.shape[-1])),
        dtype=np.result_type(driven, compliant, guess),
    )
    state[..., mechanism.driven_slice], state[..., mechanism.compliant_slice] = driven, compliant
    return close_kinematics(mechanism, state)


def partition_dynamics(
    model: CompliantMechanism,
    state: FloatArray,
    kinematics: Kinematics,
    drive: Drive,
    *,
    rates: FloatArray,
    force: FloatArray,
) -> PartitionedDynamics:
    """The equations of motion in the compliant coordinates.

    Args:
        state: ``(..., n)`` all coordinates, from :func:`compose_state`, at the drive's position.
        drive: What the driven coordinates do.
        rates: ``(..., c)`` speeds of the compliant coordinates [m/s].
        force: ``(..., 3)`` force on the tool in the ground frame of the chains [N].
    """
    mechanism = model.mechanism
    from_driven, from_compliant = velocity_maps(mechanism, kinematics.closure_jacobian)
    speeds = (from_driven @ drive.speed[..., None] + from_compliant @ rates[..., None])[..., 0]
    dynamics = evaluate_dynamics(model, kinematics, speeds if model.velocity_terms else None)
    offset = (from_driven @ drive.acceleration[..., None])[..., 0]
    if model.velocity_terms:
        passive = dynamics.closure_jacobian[..., mechanism.passive_slice]
        offset[..., mechanism.passive_slice] -= np.linalg.solve(
            passive, dynamics.closure_bias[..., None]
        )[..., 0]
    applied = dynamics.load + (np.swapaxes(dynamics.tool, -1, -2) @ force[..., None])[..., 0]
    # all accelerations are offset + Td ddd; the equations of motion times Td^T lose the joint
    # forces, which do no work along Td. What the drives and the turning joints accelerate by
    # themselves (offset) is a load on the compliant coordinates
    left = np.swapaxes(from_compliant, -1, -2)
    load = (left @ (applied - (dynamics.mass @ offset[..., None])[..., 0])[..., None])[..., 0]
    mass = left @ dynamics.mass @ from_compliant
    stiffness = model.springs.stiffness(drive.position)
    return PartitionedDynamics(
        dynamics, state, speeds, from_driven, from_compliant, offset, mass, load, stiffness
    )


def driven_forces(
    model: CompliantMechanism,
    motion: PartitionedDynamics,
    accelerations: FloatArray,
    force: FloatArray,
) -> FloatArray:
    """Forces ``(..., u)`` of the drives [N, N m] that make a motion (eq. 14, with the work of the
    length-dependent springs).

    Args:
        accelerations: ``(..., c)`` of the compliant coordinates [m/s^2].
        force: ``(..., 3)`` on the tool [N].
    """
    everything = motion.offset + (motion.from_compliant @ accelerations[..., None])[..., 0]
    dynamics = motion.dynamics
    applied = dynamics.load + (np.swapaxes(dynamics.tool, -1, -2) @ force[..., None])[..., 0]
    balance = (dynamics.mass @ everything[..., None])[..., 0] - applied
    drives = (np.swapaxes(motion.from_driven, -1, -2) @ balance[..., None])[..., 0]
    driven = motion.state[..., model.mechanism.driven_slice]
    compliant = motion.state[..., model.mechanism.compliant_slice]
    work = 0.5 * model.springs.stiffness_slope(driven) * compliant**2
    for spring, length in enumerate(model.springs.length):
        drives[..., length] += work[..., spring]
    return np.asarray(drives)
