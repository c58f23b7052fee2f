"""Pairing of the natural modes of two models of a machine by shape; close frequencies are compared
by the space they span.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from headstock.geometry.frames import FloatArray
from headstock.meshing.scipy_library import scipy

type Field = npt.NDArray[Any]  # real, or complex where it was measured
SAME_MODE = 0.5  # a smaller correlation makes two modes different ones
CLUSTER_GAP = 0.02  # neighbours closer than this share of their frequency may turn into each other
# how much shape within a cluster, and then nearness in frequency, may decide where correlations are
# alike
SHAPE_WEIGHT, NEARNESS_WEIGHT = 0.1, 0.01


@dataclass(frozen=True, eq=False)
class ModeSet:
    """Modes of one model.

    Attributes:
        frequencies_hz: ``(m,)`` rising.
        field: ``(k, m)`` motions at places that all models share, complex where they were measured;
            weighted so that scalar products are kinetic energies where masses are known.
        rigid_count: How many of the first are rigid-body modes: their frequencies are roundoff.
    """

    frequencies_hz: FloatArray
    field: Field
    rigid_count: int = 0


@dataclass(frozen=True)
class ModePair:
    """Two modes that are one: the index of each, and the square of the cosine between their shapes
    (MAC).
    """

    first: int
    second: int
    correlation: float


def correlate_modes(first: Field, second: Field) -> FloatArray:
    """Return the modal assurance criterion ``(m_1, m_2)`` of weighted fields ``(k, m_1)`` and
    ``(k, m_2)``; 0 for a field that rests.

    Source: Allemang and Brown (1982).
    """
    return np.abs(unit_columns(first).conj().T @ unit_columns(second)) ** 2


def pair_modes(
    first: ModeSet, second: ModeSet, *, mac_threshold: float = SAME_MODE
) -> tuple[ModePair, ...]:
    """Return the modes of two models that are the same, each used once, in the order of the first.

    Modes closer to each other than two per cent are no more than a basis of the space they span:
    there the smallest cosine between the two spaces counts where it is larger than that of the
    single shapes. Frequencies decide only between modes that correlate alike.

    Args:
        mac_threshold: Correlation below which two modes are not the same.

    Source: Bjoerck and Golub (1973), angles between spaces.
    """
    if not first.field.size or not second.field.size:
        return ()
    plain = correlate_modes(first.field, second.field)
    spanned = np.maximum(plain, _cluster_correlations(first, second))
    nearness = 1.0 / (
        1.0
        + np.abs(
            np.log(_positive(first.frequencies_hz)[:, None] / _positive(second.frequencies_hz))
        )
    )
    return tuple(
        assign_modes(
            spanned, SHAPE_WEIGHT * plain + NEARNESS_WEIGHT * nearness, mac_threshold=mac_threshold
        )
    )


def assign_modes(
    correlations: FloatArray, tie_break: FloatArray, *, mac_threshold: float = SAME_MODE
) -> list[ModePair]:
    """Return the pairs, each mode used once, with the largest sum of correlations.

    Args:
        correlations: ``(m_1, m_2)`` squares of cosines.
        tie_break: ``(m_1, m_2)`` small numbers that decide where correlations are alike.
        mac_threshold: Correlation below which two modes are not the same.

    Source: Kuhn (1955).
    """
    gains = np.where(correlations >= mac_threshold, correlations + tie_break, 0.0)
    # the same answer as `scipy.optimize` has, which takes a tenth of a second to load; a pair that
    # weighs nothing would be none
    graph = scipy.sparse.csr_array(gains - gains.min(initial=0.0) + 1.0)
    rows, columns = scipy.sparse.csgraph.min_weight_full_bipartite_matching(graph, maximize=True)
    pairs = [
        ModePair(int(i), int(j), float(correlations[i, j]))
        for i, j in zip(rows, columns, strict=True)
    ]
    return [pair for pair in pairs if pair.correlation >= mac_threshold]


def match_frequencies(
    logs: FloatArray,
    wanted_logs: FloatArray,
    *,
    sigmas: FloatArray | float = 1.0,
    costs: FloatArray | float = 0.0,
) -> tuple[int, ...]:
    """Return which mode meets each wanted frequency, where shapes alone do not decide: the smallest
    sum of squared distances and costs.

    Args:
        logs: ``(m,)`` logarithms of the modes' frequencies.
        wanted_logs: ``(t,)`` of those wanted, no more than there are modes.
        sigmas: ``(t,)`` distances that count as one.
        costs: ``(t, m)`` what each pair costs besides.

    Returns:
        ``t`` indices of modes.

    Source: Kuhn (1955).
    """
    distances = (logs[None, :] - wanted_logs[:, None]) / np.reshape(sigmas, (-1, 1))
    return tuple(
        int(column) for column in scipy.optimize.linear_sum_assignment(distances**2 + costs)[1]
    )


def find_clusters(modes: ModeSet) -> list[list[int]]:
    """Find the rigid-body modes, and runs of modes whose neighbours lie within ``CLUSTER_GAP`` of
    each other.
    """
    clusters = [list(range(modes.rigid_count))] if modes.rigid_count else []
    for index in range(modes.rigid_count, len(modes.frequencies_hz)):
        hz = float(modes.frequencies_hz[index])
        if (
            index > modes.rigid_count
            and hz - float(modes.frequencies_hz[index - 1]) <= CLUSTER_GAP * hz
        ):
            clusters[-1].append(index)
        else:
            clusters.append([index])
    return clusters


def _cluster_correlations(first: ModeSet, second: ModeSet) -> FloatArray:
    """Return the square of the smallest cosine between the spaces that two clusters span, for every
    mode of them.
    """
    result = np.zeros((first.field.shape[1], second.field.shape[1]))
    bases = [
        [
            (members, np.linalg.qr(unit_columns(modes.field[:, members]))[0])
            for members in find_clusters(modes)
        ]
        for modes in (first, second)
    ]
    for mine, basis in bases[0]:
        for others, other_basis in bases[1]:
            if len(mine) > 1 or len(others) > 1:
                cosines = np.linalg.svd(basis.conj().T @ other_basis, compute_uv=False)
                result[np.ix_(mine, others)] = float(cosines.min()) ** 2
    return result


def unit_columns(field: Field) -> Field:
    """Return columns of length one; those of length zero stay."""
    lengths = np.linalg.norm(field, axis=0)
    return field / np.where(lengths > 0.0, lengths, 1.0)


def _positive(frequencies_hz: FloatArray) -> FloatArray:
    """Return the frequencies for ratios: rigid-body modes have none."""
    return np.maximum(frequencies_hz, 1e-3 * max(float(frequencies_hz.max()), 1e-300))
