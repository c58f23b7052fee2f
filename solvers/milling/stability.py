"""Stability of regenerative cutting: Floquet multipliers by semi-discretisation, and limit depths
by it and by a single frequency.

``x' = A x + B G(t) (C x(t) - C x(t - T))`` with ``G`` of period ``T``, the time from tooth to
tooth, which is the delay as well. Over each of ``m`` steps ``G`` is its mean there and the delayed
output a line between its samples (first-order semi-discretisation, Insperger and Stepan 2004 and
2011, sec. 3): multipliers converge with the square of the step. The tip is stable when the largest
is below one. With the mean of ``G`` over a period in place of ``G`` the limit is a matter of one
frequency (Altintas and Budak 1995, their zeroth order); this is an independent method, exact for a
constant engagement and close for many teeth in the cut.
"""

import dataclasses
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from headstock.geometry.frames import BoolArray, FloatArray
from headstock.solvers.errors import ModelError
from headstock.solvers.milling.forces import MillingCut, regeneration_stiffness

ComplexArray = NDArray[np.complexfloating]
SAMPLES_PER_STEP = 8
LIMIT_POINTS = (
    40_000  # frequencies tried for a limit, up to three times the highest natural frequency
)
SPREAD = 1e-6  # of the root of the largest rate: decay that sets equal poles apart
CONDITION_LIMIT = 1e10  # of eigenvectors: beyond, poles are no coordinates


@dataclass(frozen=True, eq=False)
class TipDynamics:
    """A linear system and the point where it cuts.

    Attributes:
        system: ``(n, n)`` ``A``, first order [1/s].
        inputs: ``(n, r)`` ``B``, per force at the tip.
        outputs: ``(p, n)`` ``C``, motion of the tip that changes the chip.
    """

    system: FloatArray
    inputs: FloatArray
    outputs: FloatArray
    highest_hz: float


@dataclass(frozen=True, eq=False)
class TipPoles:
    """A tip in coordinates of its own, one complex number for each pair of poles: ``z' = s z + B F``,
    ``y = Re(C z)``.

    Attributes:
        values: ``(q,)`` ``s`` [1/s].
        inputs: ``(q, r)`` ``B``, per force at the tip.
        outputs: ``(p, q)`` ``C``.
        static: ``(p, r)`` ``D``, what moves at once with the force [m/N]: ``y = Re(C z) + D F``.
    """

    values: ComplexArray
    inputs: ComplexArray
    outputs: ComplexArray
    static: FloatArray


def _find_poles(tip: TipDynamics) -> TipPoles | None:
    """A tip in coordinates of its own; None where it has too few of them, as with rigid-body modes or
    critical damping.
    """
    values, vectors = np.linalg.eig(tip.system)
    try:
        inverse = np.linalg.inv(vectors)
    except np.linalg.LinAlgError:
        return None
    if not np.linalg.norm(vectors, 1) * np.linalg.norm(inverse, 1) < CONDITION_LIMIT:
        return None
    above = values.imag >= 0.0
    both = np.where(values.imag > 0.0, 2.0, 1.0)[above]
    pushed, outputs = inverse[above] @ tip.inputs, tip.outputs @ vectors[:, above]
    # so that coordinates are as large as the motion they make
    seen = np.abs(outputs).max(axis=0)
    scale = np.where(seen > 0.0, seen, 1.0)
    return TipPoles(
        values[above],
        (both * scale)[:, None] * pushed,
        np.asarray(outputs / scale),
        np.zeros((len(outputs), tip.inputs.shape[1])),
    )


def require_poles(tip: TipDynamics) -> TipPoles:
    """A tip in coordinates of its own; where it has too few, decays are spread by a little.

    Raises:
        ModelError: They remain too few.
    """
    poles = _find_poles(tip)
    if poles is None:
        size = len(tip.system)
        spread = SPREAD * np.linalg.norm(tip.system, 2) ** 0.5 * np.linspace(0.5, 1.5, size)
        poles = _find_poles(dataclasses.replace(tip, system=tip.system - np.diag(spread)))
    if poles is None:
        raise ModelError("the machine where it cuts has no poles of its own; change its damping")
    return poles


def settle_fastest(tip: TipPoles, count: int) -> TipPoles:
    """A tip whose so many fastest poles move at once with the force."""
    kept = np.ones(len(tip.values), dtype=bool)
    kept[np.argsort(np.abs(tip.values))[len(kept) - count :]] = False
    return keep_poles(tip, kept)


def keep_poles(tip: TipPoles, kept: BoolArray) -> TipPoles:
    """A tip with some of its poles; the others move at once with the force.

    Args:
        kept: ``(q,)`` which stay.
    """
    fast = ~kept
    statics = ((tip.outputs[:, fast] / -tip.values[fast]) @ tip.inputs[fast]).real
    return TipPoles(tip.values[kept], tip.inputs[kept], tip.outputs[:, kept], tip.static + statics)


def turn_tip(tip: TipPoles, frame: FloatArray) -> TipPoles:
    """A tip in other axes, forces along all three and the chip along the first two.

    Args:
        tip: With forces and motions along three axes.
        frame: ``(3, 3)`` rows of the new axes.
    """
    return TipPoles(
        tip.values,
        tip.inputs @ frame.T,
        (frame @ tip.outputs)[:2],
        (frame @ tip.static @ frame.T)[:2],
    )


def tip_dynamics(
    mass: FloatArray,
    damping: FloatArray,
    stiffness: FloatArray,
    *,
    forced: FloatArray,
    seen: FloatArray | None = None,
) -> TipDynamics:
    """First-order form of a second-order system.

    Args:
        mass: ``(c, c)``.
        damping: ``(c, c)``.
        stiffness: ``(c, c)``.
        forced: ``(r, c)`` motion of the tip per coordinate, in the directions of the force.
        seen: ``(p, c)`` in the directions that change the chip; by default the same.
    """
    seen = forced if seen is None else seen
    size = len(mass)
    inverse = np.linalg.inv(mass)
    system = np.block(
        [[np.zeros((size, size)), np.eye(size)], [-inverse @ stiffness, -inverse @ damping]]
    )
    inputs = np.concatenate([np.zeros((size, len(forced))), inverse @ forced.T])
    highest = float(np.sqrt(scipy.linalg.eigvalsh(stiffness, mass)[-1])) / (2.0 * np.pi)
    return TipDynamics(system, inputs, np.concatenate([seen, np.zeros_like(seen)], axis=1), highest)


def floquet_multipliers(
    tip: TipDynamics, gains: FloatArray, period: float, *, past: FloatArray | None = None
) -> ComplexArray:
    """All multipliers over a period, those of the delay's discretisation among them.

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
    own, start, growth = (
        ahead[:, :, :size],
        ahead[:, :, size : size + directions],
        ahead[:, :, size + directions :],
    )
    # rows: the state, then the outputs one to m steps ago
    whole = np.eye(size + steps * directions)
    state, waves = whole[:size], list(whole[size:].reshape(steps, directions, -1))
    for step in range(steps):
        oldest = waves.pop()
        now = tip.outputs @ state
        later = waves[-1] if waves else now
        state = own[step] @ state + (start[step] - growth[step]) @ oldest + growth[step] @ later
        waves.insert(0, now)
    return np.asarray(np.linalg.eigvals(np.concatenate([state, *waves])))


def largest_multiplier(tip: TipDynamics, gains: FloatArray, period: float) -> float:
    """Size of the largest Floquet multiplier: the cut is stable below one.

    Args:
        gains: ``(m, r, p)`` mean of ``G`` over each of ``m`` steps: force per motion since the last
            period [N/m].
        period: Time from tooth to tooth, which is the delay too [s].
    """
    return float(np.abs(floquet_multipliers(tip, gains, period)).max())


def milling_gains(cut: MillingCut, steps: int) -> FloatArray:
    """``(m, 3, 2)`` mean over each step of a tooth period: force along, away and up per motion
    along and away [N/m].
    """
    fine = (
        (np.arange(steps * SAMPLES_PER_STEP) + 0.5) * cut.tooth_period / (steps * SAMPLES_PER_STEP)
    )
    gains = regeneration_stiffness(cut, fine)[:, :, :2]
    return np.asarray(gains.reshape(steps, SAMPLES_PER_STEP, *gains.shape[1:]).mean(axis=1))


def single_frequency_limit(tip: TipDynamics, gains: FloatArray, period: float) -> float:
    """By how much gains may be multiplied until the mean of them over a period makes the tip
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
