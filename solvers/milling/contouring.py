"""A compliant mechanism under cutting forces along a path: linear with matrices that follow the
path, and fully nonlinear.

The equations of motion in the compliant coordinates (eq. 10 of Bonnemains et al. 2010) are linear
in them to one part in a thousand. The linear model takes ``M(t) ddd + D(t) dd + K(t) d = f0(t) +
J(t)^T F(t)`` along the rigid path. The nonlinear solution of the same time steps (generalised-α)
follows by Newton's method over *all* steps at once, with the linear model as its approximate
derivative: every sweep evaluates the full equations at all instants together and solves the linear
model again under what they lack.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

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
from headstock.solvers.motion.alpha import (
    CompliantHistory,
    LinearMotion,
    chunk_slices,
    even_nodes,
    interpolate_nodes,
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


@dataclass(frozen=True, eq=False)
class FreeLegs:
    """A mechanism whose motors move beyond their set points.

    Attributes:
        names: Driven coordinates of these motors.
        motion: Its linear model with the motors let go, without their loops and inertia.
    """

    names: tuple[str, ...]
    motion: LinearMotion

    def deviate(self, model: CompliantMechanism, drives: Drive, moved: CompliantHistory) -> Drive:
        """Return what driven coordinates do with the motions of the motors added."""
        columns = [model.mechanism.driven.index(name) for name in self.names]
        first = len(model.mechanism.compliant)
        driven = slice(first, first + len(columns))
        parts = [np.array(part) for part in (drives.position, drives.speed, drives.acceleration)]
        for part, beyond in zip(
            parts, (moved.compliant, moved.rate, moved.acceleration), strict=True
        ):
            part[:, columns] += beyond[:, driven]
        return Drive(*parts)


class _Tried(Protocol):
    """A motion of the linear model under the load of a sweep, with the force that it met."""

    @property
    def history(self) -> CompliantHistory:
        """Its coordinates."""

    @property
    def carried(self) -> FloatArray:
        """``(n, 3)`` force on the tool's place [N], ground frame of the chains."""


def refine_motion[T: _Tried](
    model: CompliantMechanism,
    drive: PathDrive,
    motion: LinearMotion,
    solve: Callable[[FloatArray, T | None], T],
    *,
    legs: FreeLegs | None = None,
    pushed: FloatArray | None = None,
) -> T:
    """The nonlinear solution of the same steps, by sweeps from the linear one.

    Every sweep solves the linear model under the load that its equations lack, whatever the force on
    the tool depends on: chips of the motion itself, too. What the loops of drives add to the equations
    is linear, but for friction, which is solved step by step.

    Args:
        motion: Its linear model at ``n`` even steps, the approximate derivative.
        solve: The motion of the linear model under a load ``(n, c)`` beside its own [N], and the one
            before it, None at first.
        legs: Whose motors move beyond their set points; their coordinates follow the compliant
            ones, those of their controllers come last. None where motors follow them.
        pushed: ``(n, c)`` loads on the springs beside those of the model, which the linear model has
            already [N]; None for none.

    Raises:
        ConvergenceError: The sweeps do not settle.
    """
    extra, last = np.zeros_like(motion.load), np.inf
    tried = solve(extra, None)
    states = drive.rigid_states(motion.times)
    moving = len(model.mechanism.compliant) + (0 if legs is None else len(legs.names))
    for _ in range(MAX_SWEEPS):
        history = tried.history
        off = _unbalanced(
            model, drive, motion, tried.carried, history=history, states=states, legs=legs
        )
        if pushed is not None:
            off[:, : pushed.shape[1]] -= pushed
        if motion.friction is not None:
            friction = motion.friction
            off[:, friction.coordinates] += friction.force(history.rate)
        extra = extra - off
        tried = solve(extra, tried)
        size = float(np.abs(tried.history.compliant - history.compliant)[:, :moving].max())
        if size < CONVERGED:
            return tried
        if size > last:
            break
        last = size
    raise ConvergenceError(
        f"the sweeps of the nonlinear motion stall at a correction of {size:.2g} m, wanted {CONVERGED:g} m"
    )


def tool_gaps(
    model: CompliantMechanism,
    drive: PathDrive,
    times: FloatArray,
    history: CompliantHistory,
    *,
    legs: FreeLegs | None = None,
) -> FloatArray:
    """Tool point of the compliant mechanism less that of the rigid one, ground frame of the chains.

    Args:
        times: ``(n,)`` [s].
        legs: Whose motors move beyond their set points; None for none.

    Returns:
        ``(n, 3)`` [m].
    """
    tool, count = model.mechanism.markers.index(model.tool), len(model.mechanism.compliant)
    gaps = []
    for part in chunk_slices(len(times)):
        drives, moved = drive.at(times[part]), thin_history(history, part)
        here = drives if legs is None else legs.deviate(model, drives, moved)
        compliant, guess = moved.compliant[:, :count], drive.rigid_states(times[part])
        deflected, rigid = (
            compose_state(model.mechanism, driven, coordinates, guess)[1].placement.positions[
                :, tool
            ]
            for driven, coordinates in (
                (here.position, compliant),
                (drives.position, np.zeros_like(compliant)),
            )
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
        times: ``(n,)`` [s].
        force: ``(n, 3)`` force on the tool [N], ground frame of the chains.

    Returns:
        ``(n, u)`` per driven coordinate [N, N m].
    """
    forces = []
    for part in chunk_slices(len(times)):
        compliant = history.compliant[part]
        rate = history.rate[part]
        guess = drive.rigid_states(times[part])
        dynamics = _evaluate(
            model, drive.at(times[part]), guess, compliant=compliant, rate=rate, force=force[part]
        )
        forces.append(driven_forces(model, dynamics, history.acceleration[part], force[part]))
    return np.concatenate(forces)


def _rigid_load(
    model: CompliantMechanism, drive: PathDrive, times: FloatArray, released: Sequence[str]
) -> FloatArray:
    """Load ``(n, c + d)`` of the rigid motion; on motors that are free what it takes of their
    drives, with the sign turned.
    """
    none = np.zeros((len(times), len(model.mechanism.compliant)))
    force = np.zeros((len(times), 3))
    dynamics = _evaluate(
        model, drive.at(times), drive.rigid_states(times), compliant=none, rate=none, force=force
    )
    taken = driven_forces(model, dynamics, none, force)
    columns = [model.mechanism.driven.index(name) for name in released]
    return np.concatenate([dynamics.load, -taken[:, columns]], axis=1)


def _unbalanced(
    model: CompliantMechanism,
    drive: PathDrive,
    motion: LinearMotion,
    force: FloatArray,
    *,
    history: CompliantHistory,
    states: FloatArray,
    legs: FreeLegs | None,
) -> FloatArray:
    """What the nonlinear equations of a trial motion are off by, without friction ``(n, c)``, or
    ``(n, c + d + s)`` with motors and controllers [N]; its states are brought up to date.
    """
    residual = np.zeros_like(history.compliant)
    count = len(model.mechanism.compliant)
    for part in chunk_slices(len(motion.times)):
        moved, drives = thin_history(history, part), drive.at(motion.times[part])
        compliant, rate, acceleration = (
            values[:, :count] for values in (moved.compliant, moved.rate, moved.acceleration)
        )
        dynamics = _evaluate(
            model,
            drives if legs is None else legs.deviate(model, drives, moved),
            states[part],
            compliant=compliant,
            rate=rate,
            force=force[part],
        )
        states[part] = dynamics.state
        damping = motion.between(motion.damping, part)[:, :count, :count]
        residual[part, :count] = (
            (dynamics.mass @ acceleration[..., None] + damping @ rate[..., None])[..., 0]
            + dynamics.stiffness * compliant
            - dynamics.load
        )
        if legs is None:
            continue
        taken = driven_forces(model, dynamics, acceleration, force[part])
        columns = [model.mechanism.driven.index(name) for name in legs.names]
        free = slice(count, count + len(columns))
        residual[part, free] = taken[:, columns]
        # what the loops add: the linear equations with them less those without
        added = _linear_forces(motion, moved, part)
        within = slice(0, free.stop)
        kept = CompliantHistory(
            moved.compliant[:, within], moved.rate[:, within], moved.acceleration[:, within]
        )
        added[:, within] -= _linear_forces(legs.motion, kept, part)
        residual[part] += added
    return residual


def _linear_forces(motion: LinearMotion, moved: CompliantHistory, part: slice) -> FloatArray:
    """What the linear equations of a motion are off by at some of its steps ``(k, c)``."""
    terms = (
        (motion.mass, moved.acceleration),
        (motion.damping, moved.rate),
        (motion.stiffness, moved.compliant),
    )
    total = sum(
        (motion.between(matrix, part) @ values[..., None])[..., 0] for matrix, values in terms
    )
    return total - motion.load[part]


def thin_history(history: CompliantHistory, some: slice | NDArray[np.intp]) -> CompliantHistory:
    """Some of the steps of a motion."""
    return CompliantHistory(history.compliant[some], history.rate[some], history.acceleration[some])


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
