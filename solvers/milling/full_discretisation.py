"""Floquet multipliers of a cut, many times faster than by exponentials of every step: the force is a
line between the nodes of a tooth period, so that one propagation serves all steps (full
discretisation, Ding, Zhu, Zhang and Ding 2010), and only nodes at which a tooth cuts are unknown.

A tip moves by its poles, in blocks of two; what it remembers of the last period is projected on
polynomials over the nodes of each cut, which leaves out what no multiplier near one contains; and the
largest multiplier comes from a power of the matrix and the eigenvalues of what is left of it.
Multipliers converge with the square of the step, as those of :mod:`.stability` do, which are an
independent method.
"""

import functools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg
import scipy.optimize
from numpy.typing import NDArray

from headstock.geometry.frames import BoolArray, FloatArray
from headstock.solvers.milling.forces import MillingCut, chip_stiffness
from headstock.solvers.milling.stability import ComplexArray, TipDynamics, TipPoles

IndexArray = NDArray[np.intp]

SAMPLES = 4  # of the engagement in each step
STEPS_PER_CHATTER = 36  # of a swing
FEWEST_STEPS = 64
STEPS_PER_MEMORY = 18  # of the fastest swing that the memory of the last period resolves
LEAST_DEGREES = 12  # of its polynomials, besides pi for each of these swings
SQUARINGS = 12  # of the matrix over a period
DOMINANT = 16  # multipliers that are left of it
SPENT = 1e-6  # share of the largest below which a direction of them is roundoff
NEGLIGIBLE = 3e-3  # of the inverse of a gain: receptance of all poles that are left out
SMALL = 1e-2  # exponent below which a series takes the place of differences
SCAN_BEGIN, SCAN_FACTOR = 0.35, 1.3  # of the depth that is expected, and from depth to depth
DEPTH_TOLERANCE = 1e-3  # relative
MOST_TRIALS = 60


@dataclass(frozen=True, eq=False)
class StepResponse:
    """A tip over one tooth period in even steps, without the cut, in coordinates of its own.

    Attributes:
        steps: ``m``.
        rest: Size of the largest multiplier of poles that are left out.
        free: ``(m + 1, p, n)`` outputs at the nodes per state at the start.
        early: ``(m + 1, p, r)`` outputs ``k`` steps after the node at which a force begins to fall.
        late: ``(m + 1, p, r)`` outputs ``k`` steps after the node up to which a force rises.
        end: ``(n, n)`` state at the end per state at the start.
        end_early: ``(m + 1, n, r)`` state at the end per force that falls from node ``j`` on.
        end_late: ``(m + 1, n, r)`` state at the end per force that rises up to node ``j``.
    """

    steps: int
    rest: float
    free: FloatArray
    early: FloatArray
    late: FloatArray
    end: FloatArray
    end_early: FloatArray
    end_late: FloatArray


def step_response(
    tip: TipDynamics | TipPoles, period: float, steps: int, *, stiffest: float = np.inf
) -> StepResponse:
    """Responses over a period: by the poles of the tip, or of its matrices by an exponential.

    Args:
        tip: The system; faster by its poles.
        period: From tooth to tooth [s].
        steps: Per period.
        stiffest: Largest gain of a cut that will be tried [N/m]: poles that do not matter beside it
            are left out.
    """
    if isinstance(tip, TipDynamics):
        return _by_exponential(tip, period, steps)
    kept = ~_find_negligible(tip, stiffest)
    rest = np.abs(np.exp(tip.values[~kept] * period)).max(initial=0.0)
    some = TipPoles(tip.values[kept], tip.inputs[kept], tip.outputs[:, kept])
    return _by_poles(some, period, steps, float(rest))


def _find_negligible(tip: TipPoles, stiffest: float) -> BoolArray:
    """``(q,)`` poles whose receptances at their peaks, together, are small beside a gain's inverse."""
    peaks = np.linalg.norm(tip.inputs, axis=1) * np.linalg.norm(tip.outputs, axis=0)
    with np.errstate(divide="ignore"):
        peaks = peaks / np.abs(tip.values.real)
    order = np.argsort(peaks)
    small: BoolArray = np.zeros(len(peaks), dtype=bool)
    small[order] = np.cumsum(peaks[order]) * stiffest < NEGLIGIBLE
    return small


def _by_poles(tip: TipPoles, period: float, steps: int, rest: float) -> StepResponse:
    step = period / steps
    swing = tip.values * step
    power = np.exp(swing[:, None] * np.arange(steps + 1))  # (q, m + 1)
    rising = step * _ramp(swing)
    falling = step * _constant(swing) - rising
    # a pair of poles moves as the real part of a complex coordinate
    moved = tip.outputs.T[:, :, None] * power[:, None]  # (q, p, m + 1)
    free = np.concatenate([moved.real, moved.imag]).transpose(2, 1, 0)
    early, late = (
        np.einsum("qpk,qr->kpr", moved, share[:, None] * tip.inputs, optimize=True).real
        for share in (falling, rising)
    )
    none = np.zeros((1, *early.shape[1:]))
    last = power[:, -1]
    end = np.block(
        [[np.diag(last.real), np.diag(last.imag)], [np.diag(-last.imag), np.diag(last.real)]]
    )

    def at_end(share: ComplexArray) -> FloatArray:
        """``(m, n, r)`` state at the end per force in each step."""
        forced = power[:, steps - 1 :: -1].T[:, :, None] * (share[:, None] * tip.inputs)
        return np.concatenate([forced.real, -forced.imag], axis=1)

    idle = np.zeros((1, len(end), tip.inputs.shape[1]))
    return StepResponse(
        steps,
        rest,
        free,
        np.concatenate([none, early[:-1]]),
        late,
        end,
        np.concatenate([at_end(falling), idle]),
        np.concatenate([idle, at_end(rising)]),
    )


def _constant(swing: ComplexArray) -> ComplexArray:
    """``(e^x - 1) / x``."""
    return np.asarray(1.0 + swing * _ramp(swing))


def _ramp(swing: ComplexArray) -> ComplexArray:
    """``(e^x - 1 - x) / x^2``."""
    small = np.abs(swing) < SMALL
    safe = np.where(small, 1.0, swing)
    series = 0.5 + swing / 6.0 + swing**2 / 24.0 + swing**3 / 120.0 + swing**4 / 720.0
    return np.where(small, series, (np.exp(safe) - 1.0 - safe) / safe**2)


def _by_exponential(tip: TipDynamics, period: float, steps: int) -> StepResponse:
    size, forces = len(tip.system), tip.inputs.shape[1]
    step = period / steps
    # state, force at the start, its growth over the step
    matrix = np.zeros((size + 2 * forces,) * 2)
    matrix[:size, :size], matrix[:size, size : size + forces] = tip.system, tip.inputs
    matrix[size : size + forces, size + forces :] = np.eye(forces) / step
    ahead = scipy.linalg.expm(matrix * step)[:size]
    own, late = ahead[:, :size], ahead[:, size + forces :]
    early = ahead[:, size : size + forces] - late
    free, states_early, states_late = [tip.outputs], [early], [late]
    for _ in range(steps):
        free.append(free[-1] @ own)
        states_early.append(own @ states_early[-1])
        states_late.append(own @ states_late[-1])
    outputs = np.array(free)
    none = np.zeros((1, size, forces))
    falling, rising = np.array(states_early), np.array(states_late)
    return StepResponse(
        steps,
        0.0,
        outputs,
        np.concatenate([0.0 * outputs[:1] @ early, outputs[:-1] @ early]),
        outputs @ late,
        np.linalg.matrix_power(own, steps),
        np.concatenate([falling[:steps][::-1], none]),
        np.concatenate([none, rising[:steps][::-1]]),
    )


def node_gains(cut: MillingCut, steps: int) -> FloatArray:
    """``(m, 3, 2)`` cutting stiffness at the nodes of a tooth period, each the mean over both steps
    beside it with the weight of a hat [N/m].

    Args:
        cut: Tool, material and engagement.
        steps: ``m`` per period.
    """
    places = (np.arange(steps * SAMPLES) + 0.5) / SAMPLES
    fine = chip_stiffness(cut, places * cut.tooth_period / steps)
    within = (np.arange(SAMPLES) + 0.5) / SAMPLES
    parts = fine.reshape(steps, SAMPLES, *fine.shape[1:])
    rising = np.tensordot(parts, within / SAMPLES, axes=(1, 0))
    falling = np.tensordot(parts, (1.0 - within) / SAMPLES, axes=(1, 0))
    return np.asarray(falling + np.roll(rising, 1, axis=0))


def period_matrix(response: StepResponse, gains: FloatArray) -> FloatArray:
    """State and what is remembered of the delayed outputs a period later per those at its start.

    Args:
        response: Of the tip.
        gains: ``(m, r, p)`` at the nodes.
    """
    every = np.concatenate([gains, gains[:1]])  # the last node is the first of the next period
    cutting = np.flatnonzero(np.abs(every).max(axis=(1, 2)) > 0.0)
    if not len(cutting):
        return response.end
    begins = int(cutting[0] == 0)  # and then ends
    ahead, behind = cutting[begins:], cutting[: len(cutting) - begins]
    memory, size = _memory(tuple(map(int, behind))), len(response.end)
    kernel = _kernel(response, every, cutting)[begins:]
    at_end = (response.end_early[cutting] + response.end_late[cutting]) @ every[cutting]
    past = _remember(kernel[:, :, : len(behind)], memory)
    known = np.concatenate([response.free[ahead], -past], axis=2)
    end = np.concatenate(
        [response.end, -_remember(at_end[: len(behind)].swapaxes(0, 1), memory)], axis=1
    )
    if begins:
        # at the first node the motion is that of the state; at the last it is what was there first
        known[:, :, :size] += (kernel[:, :, 0] - kernel[:, :, -1]) @ response.free[0]
        end[:, :size] += (at_end[0] - at_end[-1]) @ response.free[0]
    own = _solve_causal(kernel[:, :, begins:], known)
    after = at_end[begins:].transpose(1, 0, 2).reshape(size, -1)
    end += after @ own.reshape(after.shape[1], -1)
    kept = own[: len(behind) - begins]
    if begins:
        first: FloatArray = np.zeros((1, *own.shape[1:]))
        first[0, :, :size] = response.free[0]
        kept = np.concatenate([first, kept])
    remembered = np.tensordot(memory, kept, axes=(0, 0)).reshape(-1, end.shape[1])
    return np.concatenate([end, remembered])


def _kernel(response: StepResponse, gains: FloatArray, nodes: IndexArray) -> FloatArray:
    """``(c, p, c, p)`` outputs at nodes ``(c,)`` per motion at nodes, through the force there."""
    steps = response.steps
    none = np.zeros((steps, *response.late.shape[1:]))
    lag = steps + nodes[:, None] - nodes[None, :]
    every = np.concatenate([none, response.early + response.late])
    first = np.concatenate([none, response.early])  # no force rises up to the first node
    outputs, forces = every.shape[1:]
    directions = gains.shape[2]
    found = np.zeros((len(nodes), outputs, len(nodes), directions))
    for output, force in np.ndindex(outputs, forces):
        reach = every[:, output, force][lag]
        if nodes[0] == 0:
            reach[:, 0] = first[lag[:, 0], output, force]
        for direction in range(directions):
            found[:, output, :, direction] += reach * gains[nodes, force, direction]
    return found


def _solve_causal(through: FloatArray, known: FloatArray) -> FloatArray:
    """Outputs ``(c, p, k)`` that are known ones and what ``through`` makes of earlier and their own,
    ``(c, p, c, p)``.
    """
    count, directions = known.shape[:2]
    number = np.arange(count)
    # scaled by the inverse of its blocks on the diagonal the matrix is a lower triangle of ones there
    own = np.linalg.inv(np.eye(directions) - through[number, :, number, :])
    lower = (-own @ through.reshape(count, directions, -1)).reshape(through.shape)
    lower[number, :, number, :] = 0.0
    found = scipy.linalg.solve_triangular(
        lower.reshape(2 * (count * directions,)),
        (own @ known).reshape(count * directions, -1),
        lower=True,
        unit_diagonal=True,
        check_finite=False,
    )
    return np.asarray(found.reshape(known.shape))


def _remember(values: FloatArray, memory: FloatArray) -> FloatArray:
    """Per coefficient of the memory ``(..., b, k)`` in place of per output ``(..., p)`` at each of
    the delayed nodes, ``(..., c, p)``.
    """
    found = np.tensordot(values, memory, axes=(-2, 0))  # (..., p, k)
    found = found.swapaxes(-1, -2)
    return np.asarray(found.reshape(*found.shape[:-2], -1))


@functools.lru_cache(maxsize=64)
def _memory(nodes: tuple[int, ...]) -> FloatArray:
    """``(c, k)`` orthonormal polynomials over each run of neighbouring nodes."""
    places = np.array(nodes)
    runs = np.split(places, np.flatnonzero(np.diff(places) > 1) + 1)
    return np.asarray(scipy.linalg.block_diag(*(_polynomials(len(run)) for run in runs)))


def _polynomials(count: int) -> FloatArray:
    degrees = min(count, LEAST_DEGREES + round(np.pi * count / STEPS_PER_MEMORY))
    places = np.linspace(-1.0, 1.0, count)
    return np.asarray(np.linalg.qr(np.polynomial.legendre.legvander(places, degrees - 1))[0])


def spectral_radius(matrix: FloatArray) -> float:
    """Size of the largest eigenvalue: of the matrix on what a high power of it leaves of a few
    vectors.

    Args:
        matrix: ``(n, n)``.
    """
    if len(matrix) <= 4 * DOMINANT:
        return float(np.abs(np.linalg.eigvals(matrix)).max(initial=0.0))
    power = matrix
    for _ in range(SQUARINGS):
        power = power / np.abs(power).max()
        power = power @ power
    start = np.random.default_rng(0).standard_normal((len(matrix), DOMINANT))
    space, sizes, _ = np.linalg.svd(power @ start, full_matrices=False)
    space = space[:, sizes > SPENT * sizes[0]]
    return float(np.abs(np.linalg.eigvals(space.T @ matrix @ space)).max())


def cut_multiplier(response: StepResponse, cut: MillingCut) -> float:
    """Size of the largest Floquet multiplier of a cut: stable below one.

    Args:
        response: Of the tip over the tooth period of the cut.
        cut: Tool, material and engagement.
    """
    matrix = period_matrix(response, node_gains(cut, response.steps))
    return max(response.rest, spectral_radius(matrix))


def steps_per_period(chatter_hz: float, period: float) -> int:
    """Steps that resolve both the engagement and chatter at a frequency."""
    return max(FEWEST_STEPS, round(STEPS_PER_CHATTER * chatter_hz * period))


def scan_limit_depth(
    multiplier: Callable[[float], float], expected: float, deepest: float
) -> float:
    """Thinnest depth of cut that chatters: depths are tried from below the expected one upwards,
    then the border between two of them is
    enclosed (Brent) [m].

    Args:
        multiplier: Size of the largest Floquet multiplier at a depth [m].
        expected: Depth near which the limit is expected [m].
        deepest: Returned where no cut chatters.
    """
    low, high = 0.0, min(SCAN_BEGIN * expected, deepest)
    for _ in range(MOST_TRIALS):
        if multiplier(high) >= 1.0:
            break
        if high >= deepest:
            return deepest
        low, high = high, min(SCAN_FACTOR * high, deepest)
    while low == 0.0 and high > DEPTH_TOLERANCE * expected:
        # it chatters below: down to where it does not
        if multiplier(0.5 * high) < 1.0:
            low = 0.5 * high
        else:
            high *= 0.5
    if low == 0.0:
        return 0.0
    return float(
        scipy.optimize.brentq(
            lambda depth: multiplier(depth) - 1.0, low, high, xtol=DEPTH_TOLERANCE * low
        )
    )
