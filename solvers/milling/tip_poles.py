"""A linear system and the point where it cuts, as first-order equations and by its poles."""

import dataclasses
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from headstock.geometry.frames import BoolArray, FloatArray
from headstock.solvers.errors import ModelError

ComplexArray = NDArray[np.complexfloating]
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
