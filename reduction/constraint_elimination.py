"""Elimination of held motions by an orthonormal null space, and coordinates in which stiff springs stand apart from soft ones."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr

from headstock.geometry.frames import FloatArray

IntArray = NDArray[np.int64]

RANK_TOLERANCE = 1e-9  # rows closer than this to a combination of others (all dofs scaled to lengths) say the same


@dataclass(frozen=True, eq=False)
class Elimination:
    """Coordinates left when constraints hold.

    Attributes:
        basis: ``(n_all, n)`` stacked dofs per coordinate.
        levels: ``(n,)`` 0 for a coordinate that stretches no listed spring group, g for one that stretches group g (1 is the
            stiffest) and, apart from that, only softer ones.
        redundant: Indices of the constraint rows that others already imply.
    """

    basis: FloatArray
    levels: IntArray
    redundant: tuple[int, ...]


def eliminate_constraints(constraints: FloatArray, groups: Sequence[FloatArray], scale: FloatArray) -> Elimination:
    """Coordinates ``q = T z`` with ``C T = 0``, graded so that springs of very different stiffness do not mix.

    The stiff relative motions become coordinates of their own. A stiffness matrix put together from a stiff and a soft
    spring loses the soft one to roundoff; in these coordinates each keeps its own digits, and no stiffness is changed.

    Args:
        constraints: ``(m, n_all)`` rows that must vanish.
        groups: Rows ``(m_g, n_all)`` of springs, the stiffest group first; springs not listed are the softest.
        scale: ``(n_all,)`` factor per dof after which every dof is a length; rank decisions are made there.

    Source: Golub and Van Loan (2013), section 5.4.2 (QR with column pivoting); Barlow and Demmel (1990) on graded matrices.
    """
    rows = [_normalised(block * scale) for block in (constraints, *groups)]
    touched = np.flatnonzero(np.any([np.any(block != 0.0, axis=0) for block in rows], axis=0))
    null = np.eye(len(touched))
    spans: list[FloatArray] = []
    redundant: tuple[int, ...] = ()
    for index, block in enumerate(rows):
        span, null, dependent = _split_space(block[:, touched], null)
        spans.append(span)
        if index == 0:
            redundant = tuple(int(i) for i in dependent)
    untouched = np.setdiff1d(np.arange(len(scale)), touched)
    blocks = [null, *spans[:0:-1]]
    basis = np.zeros((len(scale), len(untouched) + sum(block.shape[1] for block in blocks)))
    basis[untouched, np.arange(len(untouched))] = 1.0
    basis[touched, len(untouched) :] = scale[touched, None] * np.hstack(blocks)
    levels = [np.zeros(len(untouched) + null.shape[1], dtype=np.int64)]
    levels += [np.full(spans[g].shape[1], g, dtype=np.int64) for g in range(len(spans) - 1, 0, -1)]
    return Elimination(basis, np.concatenate(levels), redundant)


def _normalised(rows: FloatArray) -> FloatArray:
    """Rows of length one; a zero row stays."""
    lengths = np.linalg.norm(rows, axis=1, keepdims=True)
    return np.asarray(rows / np.where(lengths > 0.0, lengths, 1.0))


def _split_space(rows: FloatArray, null: FloatArray) -> tuple[FloatArray, FloatArray, IntArray]:
    """Split the span of ``null`` into what the rows see and what they do not; and the rows that add nothing."""
    if len(rows) == 0 or null.shape[1] == 0:
        return null[:, :0], null, np.arange(len(rows))
    orthogonal, triangular, pivots = qr((rows @ null).T, pivoting=True, check_finite=False)
    sizes = np.abs(triangular.diagonal())
    rank = int(np.count_nonzero(sizes > RANK_TOLERANCE))
    turned = null @ orthogonal
    return turned[:, :rank], turned[:, rank:], np.sort(pivots[rank:])
