"""A compliant mechanism under cutting forces along a path: linear with matrices that follow the
path, and fully nonlinear.

The equations of motion in the compliant coordinates (eq. 10 of Bonnemains et al. 2010) are linear
in them to one part in a thousand. The linear model takes ``M(t) ddd + D(t) dd + K(t) d = f0(t) +
J(t)^T F(t)`` along the rigid path. The nonlinear solution of the same time steps (generalised-α)
follows by Newton's method over *all* steps at once, with the linear model as its approximate
derivative: every sweep evaluates the full equations at all instants together and solves the linear
model for the rest that is left.
"""

from collections.abc import Sequence

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.solvers.errors import ConvergenceError
from headstock.solvers.mechanisms.dynamics import CompliantMechanism
from headstock.solvers.mechanisms.modes import (
    PoseDamping,
    linearise_poses,
    marker_motion,
)
from headstock.solvers.mechanisms.partitioning import (
    Drive,
    PartitionedDynamics,
    compose_state,
    driven_forces,
    partition_dynamics,
)
from headstock.solvers.milling.path_drives import PathDrive
from headstock.solvers.paths.linear_motion import (
    CompliantHistory,
    LinearMotion,
    chunk_slices,
    even_nodes,
    interpolate_nodes,
    march_linear,
)

NODE_SPACING = 0.02  # matrices change over decimetres, the tool moves millimetres in this time
LOAD_SPACING = 1e-3
MAX_SWEEPS = 8
CONVERGED = 1e-12  # last correction of a compliant coordinate [m]


def linear_motion(
    model: CompliantMechanism,
    drive: PathDrive,
    times: FloatArray,
    damping: PoseDamping,
    released: Sequence[str] = (),
) -> LinearMotion:
    """The linear model along a path.

    Args:
        model: The mechanism.
        drive: What its drives do.
        times: ``(n,)`` even steps [s].
        damping: Of each pose, with locked motors.
        released: Driven coordinates whose motors are free: coordinates of the model behind the
            compliant ones.
    """
    nodes = even_nodes(times, NODE_SPACING)
    states = drive.rigid_states(nodes)
    locked = linearise_poses(model, states)
    motions = linearise_poses(model, states, released) if released else locked
    extra = (0, len(released))
    load_nodes = even_nodes(times, LOAD_SPACING)
    rigid = np.concatenate(
        [
            _rigid_load(model, drive, load_nodes[part], released)
            for part in chunk_slices(len(load_nodes))
        ]
    )
    return LinearMotion(
        times=times,
        nodes=nodes,
        mass=motions.mass,
        damping=np.pad(damping.matrix(locked), ((0, 0), extra, extra)),
        stiffness=motions.stiffness[..., None] * np.eye(motions.stiffness.shape[-1]),
        tool=marker_motion(model, motions, model.tool)[:, :3],
        gravity_deflection=np.pad(locked.gravity / locked.stiffness, ((0, 0), extra)),
        load=interpolate_nodes(times, load_nodes, rigid),
    )


def refine_motion(
    model: CompliantMechanism,
    drive: PathDrive,
    motion: LinearMotion,
    force: FloatArray,
    first: CompliantHistory,
) -> CompliantHistory:
    """The nonlinear solution of the same steps, by sweeps from the linear one.

    Args:
        model: The mechanism.
        drive: What its drives do.
        motion: Its linear model at ``n`` even steps, the approximate derivative.
        force: ``(n, 3)`` force on the tool [N], ground frame of the chains.
        first: The solution of the linear model.

    Raises:
        ConvergenceError: The sweeps do not settle.
    """
    found, last = first, np.inf
    states = drive.rigid_states(motion.times)
    for _ in range(MAX_SWEEPS):
        change = march_linear(
            motion, -_unbalanced(model, drive, motion, force, history=found, states=states)
        )
        found = CompliantHistory(
            found.compliant + change.compliant,
            found.rate + change.rate,
            found.acceleration + change.acceleration,
        )
        size = float(np.abs(change.compliant).max())
        if size < CONVERGED:
            return found
        if size > last:
            break
        last = size
    raise ConvergenceError(
        f"the sweeps of the nonlinear motion stall at a correction of {size:.2g} m, wanted {CONVERGED:g} m"
    )


def tool_gaps(
    model: CompliantMechanism, drive: PathDrive, times: FloatArray, compliant: FloatArray
) -> FloatArray:
    """Tool point of the compliant mechanism less that of the rigid one, ground frame of the chains.

    Args:
        model: The mechanism.
        drive: What its drives do.
        times: ``(n,)`` [s].
        compliant: ``(n, c)`` compliant coordinates then [m, rad].

    Returns:
        ``(n, 3)`` [m].
    """
    tool = model.mechanism.markers.index(model.tool)
    gaps = []
    for part in chunk_slices(len(times)):
        driven, guess = drive.at(times[part]).position, drive.rigid_states(times[part])
        deflected, rigid = (
            compose_state(model.mechanism, driven, coordinates, guess)[1].placement.positions[
                :, tool
            ]
            for coordinates in (compliant[part], np.zeros_like(compliant[part]))
        )
        gaps.append(deflected - rigid)
    return np.concatenate(gaps)


def drive_forces(
    model: CompliantMechanism,
    drive: PathDrive,
    times: FloatArray,
    history: CompliantHistory,
    force: FloatArray,
) -> FloatArray:
    """Forces of the drives in a motion that has been solved (eq. 14 of Bonnemains et al. 2010).

    Args:
        model: The mechanism.
        drive: What its drives do.
        times: ``(n,)`` [s].
        history: The compliant coordinates then.
        force: ``(n, 3)`` force on the tool [N], ground frame of the chains.

    Returns:
        ``(n, u)`` per driven coordinate [N, N m].
    """
    found = []
    for part in chunk_slices(len(times)):
        compliant, rate, guess = (
            history.compliant[part],
            history.rate[part],
            drive.rigid_states(times[part]),
        )
        dynamics = _evaluate(
            model, drive.at(times[part]), guess, compliant=compliant, rate=rate, force=force[part]
        )
        found.append(driven_forces(model, dynamics, history.acceleration[part], force[part]))
    return np.concatenate(found)


def _rigid_load(
    model: CompliantMechanism, drive: PathDrive, times: FloatArray, released: Sequence[str]
) -> FloatArray:
    """Load ``(n, c + d)`` of the rigid motion; on motors that are free what it takes of their
    drives, with the sign turned.
    """
    none = np.zeros((len(times), len(model.mechanism.compliant)))
    force = np.zeros((len(times), 3))
    found = _evaluate(
        model, drive.at(times), drive.rigid_states(times), compliant=none, rate=none, force=force
    )
    taken = driven_forces(model, found, none, force)
    columns = [model.mechanism.driven.index(name) for name in released]
    return np.concatenate([found.load, -taken[:, columns]], axis=1)


def _unbalanced(
    model: CompliantMechanism,
    drive: PathDrive,
    motion: LinearMotion,
    force: FloatArray,
    *,
    history: CompliantHistory,
    states: FloatArray,
) -> FloatArray:
    """``(n, c)`` what the nonlinear equations of a trial motion are off by [N]; its states are
    brought up to date.
    """
    found = np.empty_like(history.compliant)
    for part in chunk_slices(len(motion.times)):
        compliant, rate = history.compliant[part], history.rate[part]
        dynamics = _evaluate(
            model,
            drive.at(motion.times[part]),
            states[part],
            compliant=compliant,
            rate=rate,
            force=force[part],
        )
        states[part] = dynamics.state
        inertia = (dynamics.mass @ history.acceleration[part][..., None])[..., 0]
        found[part] = (
            inertia
            + (motion.between(motion.damping, part) @ rate[..., None])[..., 0]
            + dynamics.stiffness * compliant
            - dynamics.load
        )
    return found


def _evaluate(
    model: CompliantMechanism,
    drives: Drive,
    guess: FloatArray,
    *,
    compliant: FloatArray,
    rate: FloatArray,
    force: FloatArray,
) -> PartitionedDynamics:
    """The full equations at many instants at once, from a guess of the states."""
    state, kinematics = compose_state(model.mechanism, drives.position, compliant, guess)
    return partition_dynamics(model, state, kinematics, drives, rates=rate, force=force)
