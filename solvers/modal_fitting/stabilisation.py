"""Poles that come back at one order of the model after another: what a stabilisation diagram marks, and
the clusters they form.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
import scipy  # whose clustering, a tenth of a second, is loaded where it is used
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray
from headstock.solvers.modal_fitting.candidates import OrderPoles
from headstock.solvers.pairing.mode_pairing import correlate_modes
from headstock.solvers.second_order import ComplexArray

MOST_DAMPING = 0.2  # more is no resonance
SAME_FREQUENCY, SAME_DAMPING, SAME_VECTOR = 0.01, 0.05, 0.95  # changes of a stable pole; a MAC
# of a pole's distance to the imaginary axis, and of one less MAC: distances that count as one
NEAR_POLE, NEAR_VECTOR = 0.6, 0.3
APART = 10.0  # distance of two poles of one order, which are two modes
LEAST_MEMBERS, MEMBER_SHARE = 4, 0.15  # orders at which a mode appears, and as a share of all


class PoleLabel(IntEnum):
    """What a pole has in common with one of the order below."""

    UNSTABLE = 0
    NEW = 1
    FREQUENCY = 2
    DAMPING = 3
    VECTOR = 4


@dataclass(frozen=True, eq=False)
class PoleCluster:
    """Poles of several orders that are one mode.

    Attributes:
        pole: The most central one of its upper orders [1/s].
        participation: ``(f,)`` of that one.
        orders: ``(n,)`` at which it appears.
    """

    pole: complex
    participation: ComplexArray
    orders: NDArray[np.int64]


def damping_ratios(poles: ComplexArray) -> FloatArray:
    """Return the damping ratios of poles, in any shape."""
    return np.asarray(-poles.real / np.abs(poles))


def label_poles(steps: Sequence[OrderPoles]) -> list[NDArray[np.int64]]:
    """Return a ``PoleLabel`` for every pole of every order."""
    labels = []
    for number, step in enumerate(steps):
        mine = np.where(_plausible(step.poles), PoleLabel.NEW, PoleLabel.UNSTABLE)
        if number and len(steps[number - 1].poles):
            last = steps[number - 1]
            sizes = np.abs(step.poles)[:, None]
            shift = np.abs(np.abs(last.poles) - sizes) / sizes
            ratio = damping_ratios(step.poles)[:, None]
            change = np.abs(damping_ratios(last.poles) - ratio) / np.abs(ratio)
            mac = correlate_modes(step.participations, last.participations)
            near = (shift < SAME_FREQUENCY) & _plausible(last.poles)
            damped = near & (change < SAME_DAMPING)
            for label, same in (
                (PoleLabel.FREQUENCY, near),
                (PoleLabel.DAMPING, damped),
                (PoleLabel.VECTOR, damped & (mac > SAME_VECTOR)),
            ):
                mine = np.where((mine > PoleLabel.UNSTABLE) & same.any(axis=1), label, mine)
        labels.append(np.asarray(mine, dtype=np.int64))
    return labels


def cluster_poles(
    steps: Sequence[OrderPoles], *, from_hz: float, to_hz: float
) -> list[PoleCluster]:
    """Find the modes whose poles come back over orders, by rising frequency.

    Hierarchical clustering with average linkage; two poles of one order are never one mode.

    Args:
        from_hz: Poles below are left out [Hz].
        to_hz: Poles above are left out [Hz].
    """
    if not steps:
        return []
    poles = np.concatenate([step.poles for step in steps])
    vectors = np.concatenate([step.participations for step in steps], axis=1)
    orders = np.concatenate([np.full(len(step.poles), step.order) for step in steps])
    hz = np.abs(poles) / (2.0 * np.pi)
    used = _plausible(poles) & (hz >= from_hz) & (hz <= to_hz)
    poles, vectors, orders = poles[used], vectors[:, used], orders[used]
    if len(poles) < LEAST_MEMBERS:
        return []
    rates = np.abs(poles.real)
    distances = np.abs(poles[:, None] - poles) / (NEAR_POLE * 0.5 * (rates[:, None] + rates))
    distances += np.maximum(1.0 - correlate_modes(vectors, vectors), 0.0) / NEAR_VECTOR
    distances[(orders[:, None] == orders) & ~np.eye(len(poles), dtype=bool)] = APART
    condensed = np.minimum(distances[np.triu_indices(len(poles), 1)], APART)
    tree = scipy.cluster.hierarchy.linkage(condensed, method="average")
    numbers = scipy.cluster.hierarchy.fcluster(tree, 1.0, criterion="distance")
    least = max(LEAST_MEMBERS, MEMBER_SHARE * len(steps))
    clusters = []
    for number in np.unique(numbers):
        members = np.flatnonzero(numbers == number)
        if len(members) >= least:
            # models of low orders are biased
            high = members[orders[members] >= np.median(orders[members])]
            center = high[int(np.argmin(distances[np.ix_(high, high)].sum(axis=1)))]
            clusters.append(
                PoleCluster(
                    complex(poles[center]),
                    vectors[:, center],
                    np.unique(orders[members]),
                )
            )
    return sorted(clusters, key=lambda cluster: abs(cluster.pole))


def _plausible(poles: ComplexArray) -> NDArray[np.bool_]:
    """Return which poles are stable and damped as resonances are."""
    return np.asarray((poles.real < 0.0) & (damping_ratios(poles) < MOST_DAMPING))
