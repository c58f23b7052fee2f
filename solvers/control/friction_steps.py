"""Steps of a closed loop that are exact but for friction, which is a parabola in time.

Within a step of size h the loop ``x' = A x + B u - G f(V x + W u)`` is linear but for the friction f. What
is given, u, is a polynomial through Gauss points, f a parabola through three nodes: one matrix exponential
then holds the step, however stiff the loop is, and only the forces at the nodes are unknown. Nodes at 1/6,
2/3 and 1 are next to those of Radau IIA: a method of order four, A- and L-stable, so that stiff friction
is followed without residual oscillation. They are twelfths of the step, as are all places at which a step is looked
into, so that powers of one exponential give them all.

Source: Hochbruck and Ostermann (2010), Exponential integrators, section 2.3 (collocation); Van Loan
(1978), Computing integrals involving the matrix exponential.
"""

import functools
import itertools
import math
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from headstock.geometry.frames import FloatArray
from headstock.solvers.control.drive_loops import force_channels
from headstock.solvers.control.friction_loop import FrictionLoop

PARTS = 12
FORCED, CHECKED = (2, 8, 12), (0, 5, 10)  # where friction is collocated, and where it is checked
NODES: FloatArray = np.arange(PARTS + 1, dtype=np.float64) / PARTS
# where what is given is looked at, as shares of a step
GIVEN: FloatArray = np.asarray(0.5 + 0.5 * np.polynomial.legendre.leggauss(5)[0], dtype=np.float64)
LOOKED: FloatArray = np.array([0.01, 0.13, 0.36, 0.64, 0.87, 0.99])  # and where that is checked
_HALF = np.array([41.0, 216.0, 27.0, 272.0, 27.0, 216.0, 41.0]) / (140.0 * PARTS)
# closed Newton-Cotes of degree seven over each half of a step
WEIGHTS: FloatArray = np.concatenate([_HALF[:-1], [2.0 * _HALF[-1]], _HALF[1:]])


@dataclass(frozen=True, eq=False)
class StepViews:
    """What works of a step are made of, ``(13, r, p)`` at its twelfths, and its damping.

    Columns are the state before the step, what is given and the friction at the nodes, as in
    :class:`FrictionStep`.

    Attributes:
        sliding: Speed in each guide, of what moves.
        reached: Motion that each load pushes along.
        dampers: ``(p, p)`` what dampers take in the step, as a quadratic form.
    """

    sliding: FloatArray
    guides: FloatArray
    drives: FloatArray
    motors: FloatArray
    reached: FloatArray
    loads: FloatArray
    dampers: FloatArray


@dataclass(frozen=True, eq=False)
class FrictionStep:
    """A step of one size.

    Attributes:
        size: [s].
        moved: ``(n + 6 k, n + 5 q)`` the state after the step, then speeds in the guides where
            friction is collocated and where it is checked, of the state before it and what is given.
        pushed: ``(n + 6 k, 3 k)`` the same of the friction where it is collocated.
        missed: ``(n, 3 k)`` error of the state by what friction is off where it is checked.
        softness: ``(k, k)`` speeds that friction all through the step takes off.
    """

    size: float
    moved: FloatArray
    pushed: FloatArray
    missed: FloatArray
    softness: FloatArray
    views: StepViews


def make_friction_step(model: FrictionLoop, size: float) -> FrictionStep:
    """The step of a loop over ``size`` seconds."""
    space, n, q, k = model.loop.space, model.size, model.b.shape[1], len(model.law)
    own, given, friction_forces = slice(0, n), slice(n, n + q), n + len(GIVEN) * q
    whole = friction_forces + len(FORCED) * k
    # polynomials as their derivatives, each of which is the rate of the one before
    growth = np.zeros((whole, whole))
    growth[own, own] = size * space.a
    growth[own, given] = size * model.acting @ model.spread
    growth[own, friction_forces : friction_forces + k] = -size * model.drag
    growth[n : friction_forces - q, n + q : friction_forces] = np.eye(friction_forces - q - n)
    growth[friction_forces : whole - k, friction_forces + k :] = np.eye(whole - k - friction_forces)
    part = scipy.linalg.expm(growth / PARTS)
    # from values at the nodes to derivatives at the beginning
    values = np.eye(whole)
    values[n:friction_forces, n:friction_forces] = np.kron(_derivatives(GIVEN), np.eye(q))
    values[friction_forces:, friction_forces:] = np.kron(
        _derivatives(NODES[list(FORCED)]), np.eye(k)
    )

    machine, count = model.loop.plant_size, len(model.loop.trains)
    forces = space.rows.of(force_channels(model.loop.trains))
    loaded = len(model.pushing)
    sizes = (k, k, count, count, loaded, loaded, machine)
    ends = [0, *itertools.accumulate(sizes)]
    sliding, guides, drives, motors, reached, loads, speeds = itertools.starmap(
        slice, itertools.pairwise(ends)
    )
    first: FloatArray = np.zeros((ends[-1], whole))
    first[sliding, own] = model.slides
    first[guides, given] = model.guides
    first[drives, own] = space.c[forces]
    first[drives, given] = model.d[forces]
    first[drives, friction_forces : friction_forces + k] = -model.passed[forces]
    first[motors, own] = model.loop.rates
    first[reached, :machine] = model.reach
    first[loads, given] = model.pushing
    first[speeds, :machine] = np.eye(machine)
    seen: FloatArray = np.empty((PARTS + 1, *first.shape))
    seen[0] = first
    for number in range(PARTS):
        seen[number + 1] = seen[number] @ part
    seen = seen @ values
    fourth = np.linalg.matrix_power(part, 4)
    end = (fourth[own] @ fourth) @ fourth @ values
    inner = seen[:, sliding] + seen[:, guides]
    looked = np.concatenate([end, *inner[list(FORCED)], *inner[list(CHECKED)]])

    reach: FloatArray = np.empty((PARTS + 1, n, k))
    reach[PARTS] = -size * model.drag
    for number in range(PARTS, 0, -1):
        reach[number - 1] = part[own, own] @ reach[number]
    at_checked = _lagrange(NODES[[*FORCED, *CHECKED]], NODES)[:, len(FORCED) :]
    missed = np.einsum("j,jc,jnk->nck", WEIGHTS, at_checked, reach).reshape(n, -1)
    over = looked[n + 2 * k : n + 3 * k, friction_forces:]
    shaken = seen[:, speeds].reshape(-1, whole)
    weighed = (model.dampers @ seen[:, speeds]) * (size * WEIGHTS[:, None, None])
    return FrictionStep(
        size=size,
        moved=np.ascontiguousarray(looked[:, :friction_forces]),
        pushed=np.ascontiguousarray(looked[:, friction_forces:]),
        missed=missed,
        softness=-over.reshape(k, len(FORCED), k).sum(axis=1),
        views=StepViews(
            sliding=seen[:, sliding],
            guides=seen[:, guides],
            drives=seen[:, drives],
            motors=seen[:, motors],
            reached=seen[:, reached],
            loads=seen[:, loads],
            dampers=shaken.T @ weighed.reshape(-1, whole),
        ),
    )


def _derivatives(nodes: FloatArray) -> FloatArray:
    """Derivatives at zero ``(m, m)`` of the polynomial through values at nodes ``(m,)``."""
    factorials = np.array([math.factorial(order) for order in range(len(nodes))], dtype=float)
    return np.asarray(np.linalg.inv(np.vander(nodes, increasing=True) / factorials))


def _lagrange(nodes: FloatArray, places: FloatArray) -> FloatArray:
    """Values ``(p, m)`` at places of the polynomials that are one at one node each."""
    inverse = np.linalg.inv(np.vander(nodes, increasing=True))
    return np.asarray(np.vander(places, len(nodes), increasing=True) @ inverse)


LOOKS: FloatArray = _lagrange(GIVEN, LOOKED)
CHECKS: FloatArray = _lagrange(NODES[list(FORCED)], NODES[list(CHECKED)])


@functools.lru_cache(maxsize=64)
def continue_forces(ratio: float) -> FloatArray:
    """Friction ``(3, 3)`` where it is collocated in a step from that in the step before, by its
    parabola.

    Args:
        ratio: Of the size of the step to that of the one before.
    """
    nodes = NODES[list(FORCED)]
    return _lagrange(nodes, 1.0 + ratio * nodes)


@functools.lru_cache(maxsize=4096)
def narrow_given(level: int, number: int) -> FloatArray:
    """What is given ``(5, 5)`` in one of ``2**level`` equal parts of a step from what is given in it."""
    return _lagrange(GIVEN, (number + GIVEN) * 0.5**level)
