"""Floquet multipliers of a cut, many times faster than by exponentials of every step: the force is a
line between the nodes of a tooth period, so that one propagation serves all steps (full
discretisation, Ding, Zhu, Zhang and Ding 2010), and only nodes at which a tooth cuts are unknown.

A tip moves by its poles, in blocks of two; its motion over a period is projected on polynomials over
the nodes of each cut, which leaves out what no multiplier near one contains; and the largest
multiplier comes from a power of the matrix and the eigenvalues of what is left of it.
Multipliers converge with the square of the step, as those of :mod:`.stability` do, which are an
independent method.
"""

import functools
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass

import numpy as np
import scipy.fft
import scipy.linalg
from numpy.typing import NDArray

from headstock.geometry.frames import BoolArray, FloatArray
from headstock.solvers.milling.forces import MillingCut, chip_stiffness
from headstock.solvers.milling.stability import ComplexArray, TipDynamics, TipPoles

IndexArray = NDArray[np.intp]

SAMPLES = 4  # of the engagement in each step
STEPS_PER_CHATTER = 36  # of a swing
FEWEST_STEPS = 64
STEPS_PER_MEMORY = 36  # of the fastest swing that the memory of the last period resolves
LEAST_DEGREES = 21  # of its polynomials, besides pi for each of these swings
SQUARINGS = 12  # of the matrix over a period, at most
FEWEST_SQUARINGS = 6  # before the first look at what is left
TIMES = 4  # that each power is applied
RESIDUAL = 1e-7  # of the largest multiplier: where squaring ends
DOMINANT = 16  # multipliers that are left of it
NEGLIGIBLE = 3e-3  # of the inverse of a gain: receptance of all poles that are left out
SMALL = 1e-2  # exponent below which a series takes the place of differences
SCAN_BEGIN, SCAN_FACTOR = 0.35, 1.3  # of the depth that is expected, and from depth to depth
KNOWN_FACTOR = 1.6  # up to a depth that costs nothing
DEPTH_TOLERANCE = 5e-4  # relative
MOST_TRIALS = 60
SMALLEST = 1e-12  # multiplier that has a logarithm
OWN_SHARE = 0.9  # of the growth at a stable depth: what is above is that of what chatters


@dataclass(frozen=True, eq=False)
class StepResponse:
    """A tip over one tooth period in even steps, without the cut, in coordinates of its own.

    Attributes:
        steps: ``m``.
        rest: Size of the largest multiplier of poles that are left out.
        free: ``(p, n, m + 1)`` outputs at the nodes per state at the start.
        early: ``(p, r, m + 1)`` outputs ``k`` steps after the node at which a force begins to fall.
        whole: ``(p, r, m + 1)`` outputs ``k`` steps after the node up to which a force rises, and from
            which on it falls.
        end: ``(n, n)`` state at the end per state at the start.
        end_whole: ``(n, r, m + 1)`` state at the end per force that rises up to node ``j``, but the
            first, and falls from there on, but from the last.
    """

    steps: int
    rest: float
    free: FloatArray
    early: FloatArray
    whole: FloatArray
    end: FloatArray
    end_whole: FloatArray


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
    moved = tip.outputs[:, :, None] * power  # (p, q, m + 1)
    free = np.concatenate([moved.real, moved.imag], axis=1)
    early, late = (((share[:, None] * tip.inputs).T @ moved).real for share in (falling, rising))
    early = _one_step_later(early)
    last = power[:, -1]
    end = np.block(
        [[np.diag(last.real), np.diag(last.imag)], [np.diag(-last.imag), np.diag(last.real)]]
    )

    def at_end(share: ComplexArray) -> ComplexArray:
        """``(q, r, m)`` coordinates at the end per force in each step."""
        pushed = share[:, None] * tip.inputs
        return np.asarray(pushed[:, :, None] * power[:, None, steps - 1 :: -1])

    forced = np.zeros((*tip.inputs.shape, steps + 1), dtype=complex)
    forced[..., :-1] += at_end(falling)
    forced[..., 1:] += at_end(rising)
    end_whole = np.concatenate([forced.real, -forced.imag])
    return StepResponse(steps, rest, free, early, early + late, end, end_whole)


def _one_step_later(responses: FloatArray) -> FloatArray:
    """Responses ``(..., m + 1)`` that begin at the next node."""
    return np.concatenate([np.zeros_like(responses[..., :1]), responses[..., :-1]], axis=-1)


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
    begun = _one_step_later(np.moveaxis(outputs @ early, 0, -1))
    none = np.zeros((1, size, forces))
    falling, rising = (np.array(each)[:steps][::-1] for each in (states_early, states_late))
    at_end = np.concatenate([falling, none]) + np.concatenate([none, rising])
    return StepResponse(
        steps,
        0.0,
        np.moveaxis(outputs, 0, -1),
        begun,
        begun + np.moveaxis(outputs @ late, 0, -1),
        np.linalg.matrix_power(own, steps),
        np.moveaxis(at_end, 0, -1),
    )


def node_gains(cut: MillingCut, steps: int, depths: Collection[float] = ()) -> FloatArray:
    """``(d, m, 3, 2)`` cutting stiffness at the nodes of a tooth period, each the mean over both
    steps beside it with the weight of a hat [N/m].

    Args:
        cut: Tool, material and engagement.
        steps: ``m`` per period.
        depths: ``(d,)`` axial depths [m]; by default that of the cut alone.
    """
    places = (np.arange(steps * SAMPLES) + 0.5) / SAMPLES
    tried = np.array([*depths] or [cut.axial_depth])
    fine = chip_stiffness(cut, places * cut.tooth_period / steps, tried)
    within = (np.arange(SAMPLES) + 0.5) / SAMPLES
    parts = fine.reshape(len(tried), steps, SAMPLES, *fine.shape[2:])
    weights = np.stack([within, 1.0 - within]) / SAMPLES
    rising, falling = np.einsum("hs,dns...->hdn...", weights, parts)
    return np.asarray(falling + np.roll(rising, 1, axis=1))


def period_matrix(response: StepResponse, gains: FloatArray) -> FloatArray:
    """State and what is remembered of the outputs a period later per those at its start.

    Outputs at the nodes that cut are a few polynomials ``Q a``: ``a = Q' (free x + K G Q (a - past))``
    with the responses ``K`` and gains ``G``, which one small inverse solves (Galerkin).

    Args:
        response: Of the tip.
        gains: ``(m, r, p)`` at the nodes.
    """
    every = np.concatenate([gains, gains[:1]])  # the last node is the first of the next period
    cutting = np.flatnonzero(np.abs(every).max(axis=(1, 2)) > 0.0)
    if not len(cutting):
        return response.end
    pushed = np.flatnonzero(np.abs(every).max(axis=(0, 2)) > 0.0)
    projected = _project(response, tuple(map(int, cutting)), tuple(map(int, pushed)))
    memory, start = projected.memory, projected.start
    acting = np.moveaxis(every[np.ix_(cutting, pushed)], 0, 1)
    driven = acting[..., None] * memory[:, None, :]  # (r, c, p, k)
    both = projected.responses @ driven.reshape(-1, len(start))
    through, at_end = both[: len(start)], both[len(start) :]
    solved = np.linalg.inv(np.eye(len(start)) - through)
    ends = at_end @ solved
    return np.block(
        [[response.end + ends @ start, -ends], [solved @ start, np.eye(len(start)) - solved]]
    )


@dataclass(frozen=True, eq=False)
class _Projected:
    """Responses at the nodes that cut, in polynomials over them, to the forces that a cut has.

    Attributes:
        memory: ``(c, k)`` the polynomials.
        responses: ``(p k + n, r c)`` coefficients of the outputs, and the state at the end, per force
            at the nodes.
        start: ``(p k, n)`` coefficients of the outputs per state at the start.
    """

    memory: FloatArray
    responses: FloatArray
    start: FloatArray


@functools.lru_cache(maxsize=8)
def _project(response: StepResponse, nodes: tuple[int, ...], forces: tuple[int, ...]) -> _Projected:
    memory, places, some = _memory(nodes), np.array(nodes), np.array(forces)
    early, whole = response.early[:, some], response.whole[:, some]
    spread = np.zeros((response.steps + 1, memory.shape[1]))
    spread[places] = memory
    own = _correlate(whole, spread)[..., places]
    if not places[0]:  # no force rises up to the first node
        own[..., 0] = np.moveaxis(early[..., places] @ memory, 1, 2)
    at_end = response.end_whole[:, some][..., places]
    start = np.swapaxes(response.free[..., places] @ memory, 1, 2)
    columns = own.shape[2] * len(places)
    return _Projected(
        memory,
        np.concatenate([own.reshape(-1, columns), at_end.reshape(-1, columns)]),
        start.reshape(-1, start.shape[2]),
    )


def _correlate(responses: FloatArray, functions: FloatArray) -> FloatArray:
    """``(p, k, r, n)`` sums of functions ``(n, k)`` times responses ``(p, r, n)`` that begin at each
    place, by Fourier transforms.
    """
    length = scipy.fft.next_fast_len(2 * len(functions) - 1, real=True)
    back = scipy.fft.rfft(responses, length).conj()
    ahead = scipy.fft.rfft(functions.T, length)
    both = back[:, None] * ahead[:, None]
    return np.asarray(scipy.fft.irfft(both, length)[..., : len(functions)])


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
    vectors, high enough for a small residual; of all eigenvalues where none is.

    Args:
        matrix: ``(n, n)``.
    """
    if len(matrix) <= 4 * DOMINANT:
        return _solve_all(matrix)
    power, space = matrix, _start_vectors(len(matrix))
    for squaring in range(SQUARINGS):
        power = power @ power
        power *= 1.0 / np.linalg.norm(power)
        if squaring + 1 < FEWEST_SQUARINGS:
            continue
        for _ in range(TIMES):
            space = power @ space
        space = np.linalg.qr(space)[0]
        moved = matrix @ space
        values, vectors = np.linalg.eig(space.T @ moved)
        first = int(np.argmax(np.abs(values)))
        value, vector = values[first], vectors[:, first]
        if np.linalg.norm(moved @ vector - value * (space @ vector)) < RESIDUAL * abs(value):
            return float(abs(value))
    return _solve_all(matrix)


def _solve_all(matrix: FloatArray) -> float:
    return float(np.abs(np.linalg.eigvals(matrix)).max(initial=0.0))


@functools.lru_cache(maxsize=64)
def _start_vectors(size: int) -> FloatArray:
    return np.random.default_rng(0).standard_normal((size, DOMINANT))


def cut_multiplier(response: StepResponse, cut: MillingCut) -> float:
    """Size of the largest Floquet multiplier of a cut: stable below one.

    Args:
        response: Of the tip over the tooth period of the cut.
        cut: Tool, material and engagement.
    """
    return largest_multiplier(response, node_gains(cut, response.steps)[0])


def largest_multiplier(response: StepResponse, gains: FloatArray) -> float:
    """As :func:`cut_multiplier`, of gains ``(m, r, p)`` at the nodes of a tooth period [N/m]."""
    return max(response.rest, spectral_radius(period_matrix(response, gains)))


def steps_per_period(chatter_hz: float, period: float) -> int:
    """Steps that resolve both the engagement and chatter at a frequency."""
    return max(FEWEST_STEPS, round(STEPS_PER_CHATTER * chatter_hz * period))


def scan_limit_depth(
    multiplier: Callable[[float], float],
    expected: float,
    deepest: float,
    known: Collection[float] = (),
) -> float:
    """Thinnest depth of cut that chatters: depths are tried from below the expected one upwards,
    then the border between two of them is enclosed by secants [m].

    Args:
        multiplier: Size of the largest Floquet multiplier at a depth [m].
        expected: Depth near which the limit is expected [m].
        deepest: Returned where no cut chatters.
        known: Depths whose multipliers cost nothing, tried in place of others near them [m].
    """

    @functools.cache
    def growth(depth: float) -> float:
        return float(np.log(max(multiplier(depth), SMALLEST)))

    low = high = 0.0
    for depth in _scan_depths(expected, deepest, known):
        low, high = high, depth
        if growth(high) >= 0.0:
            break
    else:
        return deepest
    while low == 0.0 and high > DEPTH_TOLERANCE * expected:
        # it chatters below: down to where it does not
        if growth(0.5 * high) < 0.0:
            low = 0.5 * high
        else:
            high *= 0.5
    if low == 0.0:
        return 0.0
    return _find_border(growth, low, high)


def _scan_depths(expected: float, deepest: float, known: Collection[float]) -> Iterator[float]:
    """Depths rising from below the expected one to the deepest [m], known ones where they are near."""
    depth = SCAN_BEGIN * expected
    near = [each for each in known if each <= SCAN_FACTOR * depth]
    depth = min(near, default=depth)
    for _ in range(MOST_TRIALS):
        if depth >= deepest:
            break
        yield depth
        ahead = [each for each in known if depth < each <= KNOWN_FACTOR * depth]
        depth = min(ahead, default=SCAN_FACTOR * depth)
    yield deepest


def _find_border(growth: Callable[[float], float], low: float, high: float) -> float:
    """Depth at which the growth of what chatters passes zero: nearly a line in the depth, but where
    another multiplier, which no cut excites, is larger; depths of that one enclose the border only.

    Args:
        growth: Logarithm of the largest multiplier at a depth [m]; below zero at ``low`` only.
        low: Depth that is stable [m].
        high: One that is not [m].
    """
    idle, tolerance = OWN_SHARE * growth(low), DEPTH_TOLERANCE * low
    found, trial = [high], 0.5 * (low + high)
    while high - low > tolerance:
        value = growth(trial)
        low, high = (trial, high) if value < 0.0 else (low, trial)
        if value > idle:
            found.append(trial)
        if len(found) < 2 or trial != found[-1] or value == growth(found[-2]):
            trial = 0.5 * (low + high)
            continue
        before = found[-2]
        ahead = trial - value * (trial - before) / (value - growth(before))
        if abs(ahead - trial) < tolerance:
            return float(ahead)
        trial = float(ahead) if low < ahead < high else 0.5 * (low + high)
    return 0.5 * (low + high)
