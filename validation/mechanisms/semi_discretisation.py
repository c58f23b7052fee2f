"""Stability of regenerative cutting by an independent method: Floquet multipliers by
semi-discretisation, and limit depths by it and by a single frequency.

``x' = A x + B G(t) (C x(t) - C x(t - T))`` with ``G`` of period ``T``, the time from tooth to
tooth, which is the delay as well. Over each of ``m`` steps ``G`` is its mean there and the delayed
output a line between its samples (first-order semi-discretisation, Insperger and Stepan 2004 and
2011, sec. 3): multipliers converge with the square of the step. The tip is stable when the largest
is below one. With the mean of ``G`` over a period in place of ``G`` the limit is a matter of one
frequency (Altintas and Budak 1995, their zeroth order); this is an independent method, exact for a
constant engagement and close for many teeth in the cut.
"""

import numpy as np
import scipy.linalg

from headstock.geometry.frames import FloatArray
from headstock.solvers.milling.forces import MillingCut, regeneration_stiffness
from headstock.solvers.milling.tip_poles import ComplexArray, TipDynamics

SAMPLES_PER_STEP = 8
# frequencies tried for a limit, up to three times the highest natural frequency
LIMIT_POINTS = 40_000


def floquet_multipliers(
    tip: TipDynamics, gains: FloatArray, period: float, *, past: FloatArray | None = None
) -> ComplexArray:
    """Return all multipliers over a period, those of the delay's discretisation among them.

    Args:
        gains: ``(m, r, p)`` mean of ``G`` over each step: force per motion since the last period
            [N/m].
        period: And delay [s].
        past: As the gains, for the delayed motion alone, where it has gains of its own.
    """
    steps, _, directions = gains.shape
    size = len(tip.system)
    forced, delayed = tip.inputs @ gains, tip.inputs @ (gains if past is None else past)
    # x, the delayed output at the start of the step, its growth over the step
    matrix = np.zeros((steps, size + 2 * directions, size + 2 * directions))
    matrix[:, :size, :size] = tip.system + forced @ tip.outputs
    matrix[:, :size, size : size + directions] = -delayed
    matrix[:, size : size + directions, size + directions :] = np.eye(directions) * steps / period
    ahead = np.asarray(scipy.linalg.expm(matrix * (period / steps)))[:, :size]
    own = ahead[:, :, :size]
    start = ahead[:, :, size : size + directions]
    growth = ahead[:, :, size + directions :]
    # rows: the state, then the outputs one to m steps ago
    whole = np.eye(size + steps * directions)
    state, waves = whole[:size], list(whole[size:].reshape(steps, directions, -1))
    for step in range(steps):
        oldest = waves.pop()
        now = tip.outputs @ state
        later = waves[-1] if waves else now
        state = own[step] @ state + (start[step] - growth[step]) @ oldest + growth[step] @ later
        waves.insert(0, now)
    return np.linalg.eigvals(np.concatenate([state, *waves]))


def largest_multiplier(tip: TipDynamics, gains: FloatArray, period: float) -> float:
    """Return the size of the largest Floquet multiplier: the cut is stable below one.

    Args:
        gains: ``(m, r, p)`` mean of ``G`` over each of ``m`` steps: force per motion since the last
            period [N/m].
        period: Time from tooth to tooth, which is the delay too [s].
    """
    return float(np.abs(floquet_multipliers(tip, gains, period)).max())


def milling_gains(cut: MillingCut, steps: int) -> FloatArray:
    """Return the mean ``(m, 3, 2)`` over each step of a tooth period: force along, away and up per motion
    along and away [N/m].
    """
    fine = (
        (np.arange(steps * SAMPLES_PER_STEP) + 0.5) * cut.tooth_period / (steps * SAMPLES_PER_STEP)
    )
    gains = regeneration_stiffness(cut, fine)[:, :, :2]
    return gains.reshape(steps, SAMPLES_PER_STEP, *gains.shape[1:]).mean(axis=1)


def single_frequency_limit(tip: TipDynamics, gains: FloatArray, period: float) -> float:
    """Return by how much gains may be multiplied until the mean of them over a period makes the tip
    chatter; infinite where never.

    Args:
        gains: ``(m, r, p)``.
        period: And delay [s].
    """
    hz = np.linspace(0.0, 3.0 * tip.highest_hz, LIMIT_POINTS + 1)[1:]
    poles, vectors = np.linalg.eig(tip.system)
    left, right = tip.outputs @ vectors, np.linalg.solve(vectors, tip.inputs) @ gains.mean(axis=0)
    omega = 2.0 * np.pi * hz
    response = (left / (1j * omega[:, None, None] - poles)) @ right
    own = np.linalg.eigvals(response)
    # 1 = scale (1 - exp(-i omega T)) eigenvalue: real where the border is met
    inverse = (1.0 - np.exp(-1j * omega * period))[:, None] * own
    found = np.inf
    for column in range(inverse.shape[1]):
        value = inverse[:, column]
        crossed = np.flatnonzero((value.imag[1:] * value.imag[:-1] <= 0.0) & (value.real[1:] > 0.0))
        share = value.imag[crossed] / (value.imag[crossed] - value.imag[crossed + 1])
        real = value.real[crossed] + share * (value.real[crossed + 1] - value.real[crossed])
        found = min([found, *(1.0 / real[real > 0.0])])
    return float(found)
