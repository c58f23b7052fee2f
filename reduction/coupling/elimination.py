"""Elimination of constrained motions by an orthonormal null space, in coordinates that separate
stiff springs from compliant ones, and a memo of what poses of the same superelements share.

A memo changes no result: a coupling with one gives the numbers of a coupling without, whatever was
coupled before.
"""

import functools
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import BoolArray, FloatArray
from headstock.meshing.scipy_library import scipy

IntArray = NDArray[np.int64]

# rows closer than this to a combination of others (all dofs scaled to lengths) say the same
RANK_TOLERANCE = 1e-9


@dataclass(eq=False)
class CouplingMemo:
    """Values made last under each name, with what they were made of.

    Attributes:
        channels: Names of the points and interfaces that are loaded and observed; None for all.
    """

    channels: Collection[str] | None = None
    _kept: dict[str, tuple[tuple[object, ...], Any]] = field(default_factory=dict)

    def recall[T](self, name: str, made_of: tuple[object, ...], make: Callable[[], T]) -> T:
        """Return a value made anew, or that of the last call of this name where it was made of the
        same: arrays equal, the rest identical.

        Args:
            name: One per kind of value.
            make: Makes the value; it must depend on nothing else.
        """
        kept = self._kept.get(name)
        if kept is not None and len(kept[0]) == len(made_of) and all(map(_same, kept[0], made_of)):
            value: T = kept[1]
            return value
        made = make()
        self._kept[name] = (made_of, made)
        return made


def _same(one: object, other: object) -> bool:
    return one is other or (
        isinstance(one, np.ndarray) and isinstance(other, np.ndarray) and np.array_equal(one, other)
    )


@dataclass(frozen=True, eq=False)
class Elimination:
    """Coordinates left when constraints hold.

    Attributes:
        basis: ``(n_all, n)`` stacked dofs per coordinate.
        levels: ``(n,)`` 0 for a coordinate that stretches no listed spring group, g for one that
            stretches group g (1 is the stiffest) and, apart from that, only softer ones.
        redundant: Indices of the constraint rows that others already imply.
        shared: ``(n,)`` whether a coordinate is the same in every pose that has the same constraints
            and the same first groups.
    """

    basis: FloatArray
    levels: IntArray
    redundant: tuple[int, ...]
    shared: BoolArray


def eliminate_constraints(
    constraints: FloatArray,
    groups: Sequence[FloatArray],
    scale: FloatArray,
    *,
    shared_groups: int = 0,
    memo: CouplingMemo | None = None,
) -> Elimination:
    """Return the coordinates ``q = T z`` with ``C T = 0``, graded so that springs of very different
    stiffness do not mix.

    The stiff relative motions become coordinates of their own. A stiffness matrix put together from
    a stiff and a soft spring loses the soft one to roundoff; in these coordinates each keeps its
    own digits, and no stiffness is changed. Dofs that no row ties together are treated apart, so
    that coordinates stay local and many bodies cost what their joints cost.

    Args:
        constraints: ``(m, n_all)`` rows that must vanish.
        groups: Rows ``(m_g, n_all)`` of springs, the stiffest group first; springs not listed are
            the most compliant.
        scale: ``(n_all,)`` factor per dof after which every dof is a length; rank decisions are
            made there.
        shared_groups: How many of the first groups are the same in every pose.
        memo: Keeps splits for the next pose; None for no memory.

    Source: Golub and Van Loan (2013), section 5.4.2 (QR with column pivoting); Barlow and Demmel
    (1990) on graded matrices.
    """
    rows = []
    for block in (constraints, *groups):
        lengths = np.linalg.norm(block * scale, axis=1, keepdims=True)
        rows.append(block * scale / np.where(lengths > 0.0, lengths, 1.0))
    memo = memo or CouplingMemo()
    pattern = np.vstack([block != 0.0 for block in rows])
    ends = np.cumsum([len(block) for block in rows])[:-1]
    sets = memo.recall("sets of dofs", (pattern, ends), functools.partial(_tie_dofs, pattern, ends))
    touched = np.concatenate([np.zeros(0, dtype=np.int64), *(one.dofs for one in sets)])
    untouched = np.setdiff1d(np.arange(len(scale)), touched)
    splits = [_split_set(rows, one, memo) for one in sets]
    # coordinates that stretch nothing first, then from the most compliant group to the stiffest: a
    # graded matrix, whose small entries no stiff spring's digits are added to. Every set of dofs
    # fills its own rows only, so the columns of a level stand side by side
    order = [0, *range(len(rows) - 1, 0, -1)]
    widths = [sum(split.blocks[level].shape[1] for split in splits) for level in order]
    basis = np.zeros((len(scale), len(untouched) + sum(widths)))
    basis[untouched, np.arange(len(untouched))] = scale[untouched]
    column = len(untouched)
    for level in order:
        for one, split in zip(sets, splits, strict=True):
            block = split.blocks[level]
            basis[one.dofs, column : column + block.shape[1]] = scale[one.dofs, None] * block
            column += block.shape[1]
    levels = np.repeat([0, *order], [len(untouched), *widths])
    shared = (levels > 0) & (levels <= shared_groups)
    shared[: len(untouched)] = True
    alone = np.flatnonzero(~rows[0].any(axis=1))
    redundant = np.sort(np.concatenate([alone, *(split.redundant for split in splits)]))
    return Elimination(basis, levels, tuple(int(row) for row in redundant), shared)


@dataclass(frozen=True, eq=False)
class _Set:
    """Dofs that rows tie to each other and to no others, and those rows.

    Attributes:
        dofs: ``(k,)`` of all.
    """

    dofs: IntArray
    rows: tuple[IntArray, ...]


@dataclass(frozen=True, eq=False)
class _Split:
    """Coordinates of a set.

    Attributes:
        blocks: ``(k, n_g)`` of those that stretch nothing, and of each spring group.
        redundant: Constraint rows that others of the set imply.
    """

    blocks: tuple[FloatArray, ...]
    redundant: IntArray


def _tie_dofs(pattern: BoolArray, ends: IntArray) -> list[_Set]:
    """Return sets by where rows ``(m, n_all)`` have entries, and where their blocks end."""
    sparse, (count, size) = scipy.sparse.csr_matrix(pattern), pattern.shape
    graph = scipy.sparse.bmat(
        [
            [scipy.sparse.csr_matrix((count, count)), sparse],
            [sparse.T, scipy.sparse.csr_matrix((size, size))],
        ]
    )
    names = scipy.sparse.csgraph.connected_components(graph, directed=False)[1]
    row_names, dof_names = np.split(names[:count], ends), names[count:]
    touched = np.flatnonzero(pattern.any(axis=0))
    return [
        _Set(
            touched[dof_names[touched] == name],
            tuple(np.flatnonzero(block_of == name) for block_of in row_names),
        )
        for name in dict.fromkeys(dof_names[touched].tolist())
    ]


def _split_set(rows: Sequence[FloatArray], one: _Set, memo: CouplingMemo) -> _Split:
    name, size = f"split of dof {one.dofs[0]}", len(one.dofs)
    null: FloatArray = memo.recall(name, (one.dofs,), lambda: np.eye(size))
    spans: list[FloatArray] = []
    redundant: IntArray = np.zeros(0, dtype=np.int64)
    for index, (block, numbers) in enumerate(zip(rows, one.rows, strict=True)):
        acting = block[np.ix_(numbers, one.dofs)]
        # as long as blocks are those of the last pose, so is what they leave
        split = memo.recall(
            f"{name}, {index}", (acting, null), functools.partial(_split_space, acting, null)
        )
        null = split.null
        spans.append(split.stretched)
        if index == 0:
            redundant = numbers[split.dependent]
    return _Split((null, *spans[1:]), redundant)


class _SplitSpan(NamedTuple):
    """Parts ``(k, n)`` of a span that rows see and do not see, and numbers of the rows that add
    nothing.
    """

    stretched: FloatArray
    null: FloatArray
    dependent: IntArray


def _split_space(rows: FloatArray, null: FloatArray) -> _SplitSpan:
    """Split the span of ``null``."""
    if len(rows) == 0 or null.shape[1] == 0:
        return _SplitSpan(null[:, :0], null, np.arange(len(rows)))
    orthogonal, triangular, pivots = scipy.linalg.qr(
        (rows @ null).T, pivoting=True, check_finite=False
    )
    sizes = np.abs(triangular.diagonal())
    rank = int(np.count_nonzero(sizes > RANK_TOLERANCE))
    turned = null @ orthogonal
    return _SplitSpan(turned[:, :rank], turned[:, rank:], np.sort(pivots[rank:]))
