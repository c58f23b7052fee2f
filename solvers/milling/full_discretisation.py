"""Floquet multipliers of a cut, many times faster than by exponentials of every step: the force is a
line between the nodes of a tooth period, so that one exponential serves all steps (full
discretisation, Ding, Zhu, Zhang and Ding 2010), and only nodes at which a tooth cuts are unknown.

Multipliers converge with the square of the step, as those of :mod:`.stability` do, which are an
independent method.
"""

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg
import scipy.optimize
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray
from headstock.solvers.milling.forces import MillingCut, regeneration_stiffness
from headstock.solvers.milling.stability import TipDynamics

IndexArray = NDArray[np.intp]

SAMPLES = 4  # of the engagement in each step
STEPS_PER_CHATTER = 36  # of a swing
FEWEST_STEPS = 64
SCAN_BEGIN, SCAN_FACTOR = 0.35, 1.3  # of the depth that is expected, and from depth to depth
DEPTH_TOLERANCE = 1e-3  # relative
MOST_TRIALS = 60


@dataclass(frozen=True, eq=False)
class StepResponse:
    """A tip over one tooth period in even steps, without the cut.

    Attributes:
        tip: The system.
        steps: ``m``.
        free: ``(m + 1, p, n)`` outputs at the nodes per state at the start.
        early: ``(m + 1, p, r)`` outputs ``k`` steps after the node at which a force begins to fall.
        late: ``(m + 1, p, r)`` outputs ``k`` steps after the node up to which a force rises.
        end: ``(n, n)`` state at the end per state at the start.
        end_early: ``(m + 1, n, r)`` state at the end per force that falls from node ``j`` on.
        end_late: ``(m + 1, n, r)`` state at the end per force that rises up to node ``j``.
    """

    tip: TipDynamics
    steps: int
    free: FloatArray
    early: FloatArray
    late: FloatArray
    end: FloatArray
    end_early: FloatArray
    end_late: FloatArray


def step_response(tip: TipDynamics, period: float, steps: int) -> StepResponse:
    """Responses over a period, of one matrix exponential.

    Args:
        tip: The system.
        period: From tooth to tooth [s].
        steps: Per period.
    """
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
        tip,
        steps,
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
    if cut.mill.helix == 0.0:
        cut = dataclasses.replace(cut, slices=1)
    places = (np.arange(steps * SAMPLES) + 0.5) / SAMPLES
    fine = regeneration_stiffness(cut, places * cut.tooth_period / steps)[:, :, :2]
    within = (np.arange(SAMPLES) + 0.5) / SAMPLES
    parts = fine.reshape(steps, SAMPLES, *fine.shape[1:])
    rising = np.tensordot(parts, within / SAMPLES, axes=(1, 0))
    falling = np.tensordot(parts, (1.0 - within) / SAMPLES, axes=(1, 0))
    return np.asarray(falling + np.roll(rising, 1, axis=0))


def period_matrix(response: StepResponse, gains: FloatArray) -> FloatArray:
    """State and delayed outputs a period later per those at its start.

    Args:
        response: Of the tip.
        gains: ``(m, r, p)`` at the nodes.
    """
    steps, directions = response.steps, gains.shape[2]
    every = np.concatenate([gains, gains[:1]])  # the last node is the first of the next period
    cutting = np.flatnonzero(np.abs(every).max(axis=(1, 2)) > 0.0)
    ahead = cutting[cutting > 0]  # unknown outputs
    behind = cutting[cutting < steps]  # delayed ones that are kept
    size = len(response.end)

    def kernel(rows: IndexArray, columns: IndexArray) -> FloatArray:
        """Outputs at nodes per motion at nodes, through the force there."""
        lag = rows[:, None] - columns[None, :]
        known = np.clip(lag, 0, steps)
        reach = response.early[known] + np.where(
            (columns > 0)[None, :, None, None], response.late[known], 0.0
        )
        reach = np.where((lag >= 0)[:, :, None, None], reach, 0.0)
        found = reach @ every[columns][None]
        return np.asarray(found.transpose(0, 2, 1, 3).reshape(len(rows) * directions, -1))

    def at_end(columns: IndexArray) -> FloatArray:
        """State at the end per motion at nodes."""
        reach = (response.end_early[columns] + response.end_late[columns]) @ every[columns]
        return np.asarray(reach.transpose(1, 0, 2).reshape(size, -1))

    through, past = kernel(ahead, ahead), kernel(ahead, behind)
    seen = response.free[ahead].reshape(-1, size)
    from_start: FloatArray = np.zeros(seen.shape)
    end_from_start: FloatArray = np.zeros((size, size))
    first, last = np.array([0]), np.array([steps])
    if cutting[:1].tolist() == [0]:
        # at the first node the motion is that of the state; at the last it is what was there first
        start = response.tip.outputs
        from_start = (kernel(ahead, first) - kernel(ahead, last)) @ start
        end_from_start = (at_end(first) - at_end(last)) @ start
    own = np.linalg.solve(
        np.eye(len(through)) - through, np.concatenate([seen + from_start, -past], axis=1)
    )
    end = np.concatenate([response.end + end_from_start, -at_end(behind)], axis=1)
    end = end + at_end(ahead) @ own
    kept = own.reshape(len(ahead), directions, -1)[ahead < steps].reshape(-1, own.shape[1])
    if behind[:1].tolist() == [0]:
        begin = np.zeros((directions, own.shape[1]))
        begin[:, :size] = response.tip.outputs
        kept = np.concatenate([begin, kept])
    return np.concatenate([end, kept])


def cut_multiplier(response: StepResponse, cut: MillingCut) -> float:
    """Size of the largest Floquet multiplier of a cut: stable below one.

    Args:
        response: Of the tip over the tooth period of the cut.
        cut: Tool, material and engagement.
    """
    matrix = period_matrix(response, node_gains(cut, response.steps))
    return float(np.abs(np.linalg.eigvals(matrix)).max())


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
