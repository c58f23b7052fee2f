"""A compliant mechanism under cutting forces along a path: linear with matrices that follow the
path, and fully nonlinear.

The equations of motion in the compliant coordinates (eq. 10 of Bonnemains et al. 2010) are linear
in them to one part in a thousand. The linear model takes ``M(t) ddd + D(t) dd + K(t) d = f0(t) +
J(t)^T F(t)`` along the rigid path. The nonlinear solution of the same time steps (generalised-α)
follows by Newton's method over *all* steps at once, with the linear model as its approximate
derivative: every sweep evaluates the full equations at all instants together and solves the linear
model for the rest that is left.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.solvers.errors import ConvergenceError
from headstock.solvers.mechanisms.dynamics import CompliantMechanism
from headstock.solvers.mechanisms.generalized_alpha import AlphaScheme
from headstock.solvers.mechanisms.modes import (
    linearise_poses,
    marker_motion,
    modal_damping,
    solve_pose_modes,
)
from headstock.solvers.mechanisms.partitioning import (
    Drive,
    PartitionedDynamics,
    compose_state,
    driven_forces,
    partition_dynamics,
)
from headstock.solvers.milling.path_drives import PathDrive

NODE_SPACING = 0.02  # matrices change over decimetres, the tool moves millimetres in this time
LOAD_SPACING = 1e-3
CHUNK = 512  # states evaluated together: more would leave the cache
MAX_SWEEPS = 8
CONVERGED = 1e-12  # last correction of a compliant coordinate [m]


@dataclass(frozen=True, eq=False)
class LinearMotion:
    """The linear model along a path: matrices at nodes, linear between them.

    Attributes:
        times: ``(n,)`` even steps [s].
        nodes: ``(k,)`` even times of the matrices [s].
        mass: ``(k, c, c)``.
        damping: ``(k, c, c)``.
        stiffness: ``(k, c)``.
        tool: ``(k, 3, c)`` motion of the tool per compliant coordinate, ground frame of the chains.
        gravity_deflection: ``(k, c)`` static deflection under gravity alone.
        load: ``(n, c)`` inertial and gravity load of the rigid motion.
    """

    times: FloatArray
    nodes: FloatArray
    mass: FloatArray
    damping: FloatArray
    stiffness: FloatArray
    tool: FloatArray
    gravity_deflection: FloatArray
    load: FloatArray

    def between(self, values: FloatArray, part: slice) -> FloatArray:
        """Values ``(k, ...)`` at the nodes, at some of the steps."""
        return interpolate_nodes(self.times[part], self.nodes, values)

    def tool_motion(self, compliant: FloatArray) -> FloatArray:
        """``(n, 3)`` motion of the tool at compliant coordinates ``(n, c)``."""
        parts = [
            (self.between(self.tool, part) @ compliant[part][..., None])[..., 0]
            for part in chunk_slices(len(compliant))
        ]
        return np.concatenate(parts)

    def tool_load(self, force: FloatArray) -> FloatArray:
        """``(n, c)`` load of forces ``(n, 3)`` on the tool."""
        parts = [
            (force[part][:, None, :] @ self.between(self.tool, part))[:, 0]
            for part in chunk_slices(len(force))
        ]
        return np.concatenate(parts)


@dataclass(frozen=True, eq=False)
class CompliantHistory:
    """Compliant coordinates over time: ``(n, c)`` values, rates and accelerations."""

    compliant: FloatArray
    rate: FloatArray
    acceleration: FloatArray


@dataclass(frozen=True, eq=False)
class Regeneration:
    """Cutting forces that depend on the wave left by the last tooth.

    Attributes:
        stiffness: ``(n, 3, 3)`` force on the tool per motion since the last tooth [N/m], ground
            frame of the chains.
        delay: Steps from tooth to tooth.
    """

    stiffness: FloatArray
    delay: int


def linear_motion(
    model: CompliantMechanism, drive: PathDrive, times: FloatArray, ratios: FloatArray
) -> LinearMotion:
    """The linear model along a path.

    Args:
        model: The mechanism.
        drive: What its drives do.
        times: ``(n,)`` even steps [s].
        ratios: Damping ratio of the first, second, ... mode, the last for all others; modes are
            those of each pose.
    """
    nodes = _nodes(times, NODE_SPACING)
    states = drive.rigid_states(nodes)
    motions = linearise_poses(model, states)
    damping = modal_damping(motions, solve_pose_modes(motions), ratios)
    load_nodes = _nodes(times, LOAD_SPACING)
    rigid = np.concatenate(
        [_rigid_load(model, drive, load_nodes[part]) for part in chunk_slices(len(load_nodes))]
    )
    return LinearMotion(
        times=times,
        nodes=nodes,
        mass=motions.mass,
        damping=damping,
        stiffness=motions.stiffness,
        tool=marker_motion(model, motions, model.tool)[:, :3],
        gravity_deflection=motions.gravity / motions.stiffness,
        load=interpolate_nodes(times, load_nodes, rigid),
    )


def march_linear(
    motion: LinearMotion,
    load: FloatArray,
    *,
    scheme: AlphaScheme | None = None,
    regeneration: Regeneration | None = None,
) -> CompliantHistory:
    """Generalised-α steps of the linear model, from static rest at the first instant.

    Args:
        motion: The linear model at ``n`` even steps.
        load: ``(n, c)`` generalised load [N, N m].
        scheme: Parameters of the generalised-α method; None for a spectral radius of 0.9.
        regeneration: Cutting force by the wave that the last tooth left; None for a load that
            depends on time alone.

    Raises:
        ConvergenceError: The motion grows without bound, as regeneration can make it.
    """
    chosen, times, size = scheme or AlphaScheme(), motion.times, load.shape[1]
    method = scheme_matrices(chosen, float(times[1] - times[0]))
    state: FloatArray = np.zeros(4 * size)
    state[:size] = load[0] / motion.stiffness[0]
    history = np.empty((len(times), 4, size))
    history[0] = state.reshape(4, size)
    delay = 0 if regeneration is None else regeneration.delay
    for part in chunk_slices(len(times)):
        wave = None if regeneration is None else _wave_stiffness(motion, part, regeneration)
        ahead, own, inverse = step_maps(motion, load, part, method, softer=wave)
        states = history[part].reshape(-1, 4 * size)
        for row in range(1 if part.start == 0 else 0, len(own)):
            state = ahead[row] @ state
            state += own[row]
            if wave is not None:
                past = history[max(0, part.start + row - delay), 0]
                state -= np.outer(method.reach, inverse[row] @ (wave[row] @ past)).ravel()
            states[row] = state
        if not np.isfinite(state).all():
            raise ConvergenceError(
                f"the motion grows without bound before t = {times[part.stop - 1]:.4g} s: the cut is unstable"
            )
    return CompliantHistory(history[:, 0], history[:, 1], history[:, 2])


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


def _rigid_load(model: CompliantMechanism, drive: PathDrive, times: FloatArray) -> FloatArray:
    none = np.zeros((len(times), len(model.mechanism.compliant)))
    force = np.zeros((len(times), 3))
    return _evaluate(
        model, drive.at(times), drive.rigid_states(times), compliant=none, rate=none, force=force
    ).load


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


class SchemeMatrices(NamedTuple):
    """One step of position, velocity, acceleration, auxiliary: ``ahead @ old + reach * new
    acceleration``, ``(4, 4)`` and ``(4,)``.
    """

    ahead: FloatArray
    reach: FloatArray


def scheme_matrices(scheme: AlphaScheme, h: float) -> SchemeMatrices:
    """What the steps of a scheme do over ``h`` seconds."""
    am, af, gamma, beta = scheme.alpha_m, scheme.alpha_f, scheme.gamma, scheme.beta
    share = (1.0 - af) / (1.0 - am)
    rest = np.array([0.0, 0.0, af, -am]) / (1.0 - am)
    unit = np.eye(4)
    position = unit[0] + h * unit[1] + h * h * ((0.5 - beta) * unit[3] + beta * rest)
    velocity = unit[1] + h * ((1.0 - gamma) * unit[3] + gamma * rest)
    reach = np.array([h * h * beta * share, h * gamma * share, 1.0, share])
    return SchemeMatrices(np.array([position, velocity, np.zeros(4), rest]), reach)


def step_maps(
    motion: LinearMotion,
    load: FloatArray,
    part: slice,
    method: SchemeMatrices,
    *,
    softer: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Some steps as maps of the state, position after velocity after acceleration after auxiliary:
    ``new = ahead @ old + own``.

    Args:
        motion: The linear model.
        load: ``(n, c)``.
        part: Which steps.
        method: From :func:`scheme_matrices`.
        softer: ``(., c, c)`` stiffness to be taken off [N/m].

    Returns:
        ``ahead (., 4 c, 4 c)``, ``own (., 4 c)``, and ``(., c, c)`` what one more load adds to the
        new acceleration.
    """
    reach, size = method.reach, load.shape[1]
    mass, damping = motion.between(motion.mass, part), motion.between(motion.damping, part)
    stiffness = motion.between(motion.stiffness, part)[:, :, None] * np.eye(size)
    if softer is not None:
        stiffness = stiffness - softer
    inverse = np.linalg.inv(mass + reach[1] * damping + reach[0] * stiffness)
    drift = np.kron(method.ahead, np.eye(size))
    # M a + C (v + reach_v a) + K (x + reach_x a) = load, where x and v are what the old state alone
    # leads to (drift): the new acceleration is linear in the old state and the load, and so is the
    # new state = drift + reach a
    pulled = np.concatenate([stiffness, damping], axis=-1) @ drift[: 2 * size]
    answer = inverse @ pulled
    ahead = drift - (reach[:, None, None] * answer[:, None]).reshape(
        len(answer), 4 * size, 4 * size
    )
    pushed = (inverse @ load[part][..., None])[..., 0]
    return ahead, (reach[:, None] * pushed[:, None]).reshape(len(pushed), 4 * size), inverse


def _wave_stiffness(motion: LinearMotion, part: slice, regeneration: Regeneration) -> FloatArray:
    tool = motion.between(motion.tool, part)
    return np.asarray(np.swapaxes(tool, -1, -2) @ regeneration.stiffness[part] @ tool)


def _nodes(times: FloatArray, spacing: float) -> FloatArray:
    return np.linspace(times[0], times[-1], max(2, round((times[-1] - times[0]) / spacing) + 1))


def interpolate_nodes(times: FloatArray, nodes: FloatArray, values: FloatArray) -> FloatArray:
    """Linear interpolation between even nodes; beyond the first and last node the outermost line
    goes on.

    Args:
        times: ``(n,)`` [s].
        nodes: ``(k,)`` even times, ``k >= 2`` [s].
        values: ``(k, ...)`` at the nodes.

    Returns:
        ``(n, ...)``.
    """
    place = (times - nodes[0]) / (nodes[1] - nodes[0])
    left = np.clip(place.astype(np.intp), 0, len(nodes) - 2)
    share = (place - left).reshape(-1, *([1] * (values.ndim - 1)))
    return np.asarray((1.0 - share) * values[left] + share * values[left + 1])


def chunk_slices(count: int) -> list[slice]:
    """Parts of so many steps that are worked on together."""
    return [slice(start, min(start + CHUNK, count)) for start in range(0, count, CHUNK)]
