"""A linear system along a path: matrices at times of the motion, marched in time.

``M(t) x'' + C(t) x' + K(t) x = f(t) + J(t)^T F``, and the tool moves by ``J(t) x + R(t) F``: of the
motions that are left out the static flexibility ``R`` at the tool remains. What has these matrices
is marched alike: a lumped mechanism in its compliant coordinates, a machine of bodies or finite
elements in its modes.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.solvers.errors import ConvergenceError
from headstock.solvers.mechanisms.generalized_alpha import AlphaScheme

CHUNK = 512  # states evaluated together: more would leave the cache


@dataclass(frozen=True, eq=False)
class LinearMotion:
    """The linear model along a path: matrices at nodes, linear between them.

    Attributes:
        times: ``(n,)`` even steps [s].
        nodes: ``(k,)`` even times of the matrices [s].
        mass: ``(k, c, c)``.
        damping: ``(k, c, c)``.
        stiffness: ``(k, c, c)``.
        tool: ``(k, 3, c)`` motion of the tool per coordinate, in the axes that forces are given in.
        gravity_deflection: ``(k, c)`` static deflection under gravity alone.
        load: ``(n, c)`` inertial and gravity load of the rigid motion.
        flexibility: ``(k, 3, 3)`` static motion of the tool per force on it, of all motions that
            are left out; None where none is.
        rest: ``(n, 3)`` static motion of the tool under the load, of all motions that are left out.
    """

    times: FloatArray
    nodes: FloatArray
    mass: FloatArray
    damping: FloatArray
    stiffness: FloatArray
    tool: FloatArray
    gravity_deflection: FloatArray
    load: FloatArray
    flexibility: FloatArray | None = None
    rest: FloatArray | None = None

    def between(self, values: FloatArray, part: slice) -> FloatArray:
        """Values ``(k, ...)`` at the nodes, at some of the steps."""
        return interpolate_nodes(self.times[part], self.nodes, values)

    def tool_motion(self, compliant: FloatArray) -> FloatArray:
        """``(n, 3)`` motion of the tool at coordinates ``(n, c)``, of those that are kept."""
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

    def tool_rest(self, force: FloatArray) -> FloatArray:
        """``(n, 3)`` motion of the tool by all motions that are left out, under forces ``(n, 3)``
        on it and the load.
        """
        rest = np.zeros((len(self.times), 3)) if self.rest is None else self.rest
        if self.flexibility is None:
            return rest
        parts = [
            (self.between(self.flexibility, part) @ force[part][..., None])[..., 0]
            for part in chunk_slices(len(force))
        ]
        return rest + np.concatenate(parts)


@dataclass(frozen=True, eq=False)
class CompliantHistory:
    """Coordinates over time: ``(n, c)`` values, rates and accelerations."""

    compliant: FloatArray
    rate: FloatArray
    acceleration: FloatArray


@dataclass(frozen=True, eq=False)
class Regeneration:
    """Cutting forces that depend on the wave left by the last tooth.

    Attributes:
        stiffness: ``(n, 3, 3)`` force on the tool per motion since the last tooth [N/m], axes of
            the tool's motion.
        delay: Steps from tooth to tooth.
    """

    stiffness: FloatArray
    delay: int


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
    state[:size] = np.linalg.solve(motion.stiffness[0], load[0])
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
    stiffness = motion.between(motion.stiffness, part)
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


def even_nodes(times: FloatArray, spacing: float) -> FloatArray:
    """Even times from the first to the last one, about so far apart [s]."""
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
