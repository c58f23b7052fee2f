"""Tracking of natural modes from pose to pose by their shapes, through crossings of their
frequencies too.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree

from headstock.geometry.frames import FloatArray
from headstock.solvers.pairing.mode_pairing import (
    SAME_MODE,
    SHAPE_WEIGHT,
    ModeSet,
    assign_modes,
    find_clusters,
)

IntArray = NDArray[np.int64]
Edges = Sequence[tuple[int, int]]
EDGES_AT_ONCE = 256
NOBODY = -1
# of an edge between poses that look exactly alike, which a sparse graph would take for none
SMALLEST_STEP = 1e-6


@dataclass(frozen=True, eq=False)
class SweptModes:
    """Modes of every pose of a sweep.

    Attributes:
        frequencies_hz: ``(n, m)`` rising, NaN beyond the last.
        fields: ``(n, d, m)`` shapes whose scalar products are kinetic (or strain) energies, of
            length one; zero beyond the last.
        wanted: ``(n,)`` how many of them are asked for.
        rigid: ``(n,)`` how many of the first are rigid-body modes.
    """

    frequencies_hz: FloatArray
    fields: NDArray[np.float32]
    wanted: IntArray
    rigid: IntArray

    @property
    def present(self) -> NDArray[np.bool_]:
        """``(n,)`` which poses have modes."""
        return np.asarray(np.isfinite(self.frequencies_hz).any(axis=1))

    def mode_set(self, number: int) -> ModeSet:
        """Return the modes of one pose."""
        count = int(np.isfinite(self.frequencies_hz[number]).sum())
        return ModeSet(
            self.frequencies_hz[number, :count],
            self.fields[number, :, :count].astype(float),
            int(self.rigid[number]),
        )


@dataclass(frozen=True, eq=False)
class TrackedModes:
    """Modes followed over poses, elastic ones only, in the order of their median frequency.

    Attributes:
        index: ``(n, t)`` which of a pose's modes each tracked mode is; -1 where it is none of them.
        correlation: ``(n, t)`` square of the cosine between its shape and that in the neighbour it
            was followed from, or the share of that shape within a cluster of close modes; 1 where
            it was first met, NaN where it is not.
        crossings: Pairs of tracked modes whose order changes between neighbours, and between how
            many.
        tracking_breaks: How many pairs of neighbours hold a tracked mode in shapes that do not look alike.
    """

    index: IntArray
    correlation: FloatArray
    crossings: dict[tuple[int, int], int]
    tracking_breaks: int


@dataclass(eq=False)
class _Node:
    """A pose along the tracking: reference shapes ``(d, m)``, the label and the correlation of
    each.
    """

    field: FloatArray
    labels: IntArray
    correlation: FloatArray


def track_modes(modes: SweptModes, neighbours: Edges) -> TrackedModes:
    """Follow modes along the edges where neighbours look most alike (a maximum spanning tree).

    Modes closer than two per cent are no more than a basis of the space they span: there the shape
    that is followed is the one of that space nearest to the shape before, so modes keep their
    identity through a pose in which two frequencies coincide. Modes that are not met again begin
    anew, and are joined with those they look like in another neighbour.

    Source: Allemang and Brown (1982), MAC; Schoenemann (1966), orthogonal Procrustes problem; Kuhn
    (1955), assignment.
    """
    present = modes.present
    edges = [(i, j) for i, j in neighbours if present[i] and present[j]]
    mac = np.concatenate(
        [
            np.zeros(0),
            *(
                _mac(modes, edges[at : at + EDGES_AT_ONCE])
                for at in range(0, len(edges), EDGES_AT_ONCE)
            ),
        ]
    )
    nodes: dict[int, _Node] = {}
    labels = 0
    for number, before in _walk(modes, edges, mac):
        nodes[number] = _follow(modes.mode_set(number), nodes.get(before), labels)
        labels = max(labels, int(nodes[number].labels.max(initial=labels - 1)) + 1)
    _join_labels(nodes, edges)
    return _tabulate(modes, nodes, edges)


def _mac(modes: SweptModes, edges: Edges) -> FloatArray:
    """Return how much the wanted mode that is least alike in two poses still looks like one of the
    other pose, per edge.
    """
    first, second = np.array(edges).T
    products = np.swapaxes(modes.fields[first], 1, 2) @ modes.fields[second]
    eigenvalues = products * products
    columns = np.arange(eigenvalues.shape[1])
    worst = np.ones(len(edges))
    for side, axis in ((first, 2), (second, 1)):
        asked = (columns >= modes.rigid[side, None]) & (columns < modes.wanted[side, None])
        worst = np.minimum(worst, np.where(asked, eigenvalues.max(axis=axis), 1.0).min(axis=1))
    return worst


def _walk(modes: SweptModes, edges: Edges, mac: FloatArray) -> Iterator[tuple[int, int]]:
    """Yield every pose that has modes, after the neighbour it is followed from; -1 for those that
    begin.

    It begins where frequencies lie furthest apart, since a cluster's shapes say nothing about which
    mode is which.
    """
    size, gaps = len(modes.frequencies_hz), _closest_gaps(modes)
    ends = np.array(edges, dtype=np.int32).reshape(-1, 2)
    graph = coo_array(
        (1.0 - mac + SMALLEST_STEP, (ends[:, 0], ends[:, 1])), shape=(size, size)
    ).tocsr()
    tree = minimum_spanning_tree(graph)
    _, groups = connected_components(graph, directed=False)
    for group in range(groups.max(initial=-1) + 1):
        members = np.flatnonzero((groups == group) & np.isfinite(gaps))
        if len(members):
            order, before = breadth_first_order(
                tree, members[np.argmax(gaps[members])], directed=False
            )
            yield from ((int(number), int(before[number])) for number in order)


def _closest_gaps(modes: SweptModes) -> FloatArray:
    """Return the smallest distance between a wanted elastic mode and the next, as a share of its
    frequency; NaN without modes.
    """
    columns = np.arange(modes.frequencies_hz.shape[1] - 1)
    asked = (columns >= modes.rigid[:, None]) & (columns < modes.wanted[:, None])
    shares = np.diff(modes.frequencies_hz, axis=1) / np.maximum(
        modes.frequencies_hz[:, 1:], np.finfo(float).tiny
    )
    closest = np.where(asked & np.isfinite(shares), shares, 1.0).min(axis=1, initial=1.0)
    return np.asarray(np.where(modes.present, closest, np.nan))


def _follow(modes: ModeSet, before: _Node | None, labels: int) -> _Node:
    """Return the labels of a pose's modes: those of the neighbour's modes they are, new ones from
    ``labels`` on for the others.
    """
    field, count = modes.field.copy(), len(modes.frequencies_hz)
    node = _Node(field, np.full(count, NOBODY), np.ones(count))
    node.labels[: modes.rigid_count] = NOBODY - 1
    if before is not None:
        cosines = before.field.T @ field
        for old, new, correlation in _assign(modes, before, cosines):
            node.labels[new], node.correlation[new] = before.labels[old], correlation
        for members in find_clusters(modes):
            node.field[:, members] = field[:, members] @ _turn_cluster(
                cosines, before.labels, node.labels, members
            )
    fresh = node.labels == NOBODY
    node.labels[fresh] = labels + np.arange(fresh.sum())
    return node


def _assign(modes: ModeSet, before: _Node, cosines: FloatArray) -> Iterator[tuple[int, int, float]]:
    """Yield the pairs of modes that are one, and how much of the old shape lies in the space of the
    new one's cluster.
    """
    plain = cosines**2
    spanned = plain.copy()
    for members in find_clusters(modes):
        spanned[:, members] = plain[:, members].sum(axis=1, keepdims=True)
    spanned[before.labels < NOBODY] = 0.0
    spanned[:, : modes.rigid_count] = 0.0
    for pair in assign_modes(spanned, SHAPE_WEIGHT * plain):
        yield pair.first, pair.second, min(1.0, pair.correlation)


def _turn_cluster(
    cosines: FloatArray, before: IntArray, labels: IntArray, members: list[int]
) -> FloatArray:
    """Return the rotation ``(m, m)`` of a cluster's shapes to those nearest to the shapes they were
    followed from; of one shape, its sign.
    """
    followed = [position for position, member in enumerate(members) if labels[member] in before]
    old = [int(np.flatnonzero(before == labels[members[position]])[0]) for position in followed]
    left, _, right = np.linalg.svd(cosines[np.ix_(old, members)].T)
    turn = np.zeros((len(members), len(members)))
    turn[:, followed] = left[:, : len(followed)] @ right
    turn[:, [position for position in range(len(members)) if position not in followed]] = left[
        :, len(followed) :
    ]
    return turn


def _join_labels(nodes: dict[int, _Node], edges: Edges) -> None:
    """Join labels that look alike in neighbours and never stand in the same pose, the most alike
    first.
    """
    places: dict[int, set[int]] = {}
    for number, node in nodes.items():
        for label in node.labels[node.labels >= 0]:
            places.setdefault(int(label), set()).add(number)
    candidates: list[tuple[float, int, int]] = []
    for first, second in edges:
        one, other = nodes[first], nodes[second]
        alone = np.flatnonzero((one.labels >= 0) & ~np.isin(one.labels, other.labels))
        partners = np.flatnonzero((other.labels >= 0) & ~np.isin(other.labels, one.labels))
        if len(alone) and len(partners):
            eigenvalues = (one.field[:, alone].T @ other.field[:, partners]) ** 2
            for i, j in np.argwhere(eigenvalues >= SAME_MODE):
                candidates.append(
                    (
                        -float(eigenvalues[i, j]),
                        int(one.labels[alone[i]]),
                        int(other.labels[partners[j]]),
                    )
                )
    now = {label: label for label in places}
    for _, first, second in sorted(candidates):
        kept, gone = now[first], now[second]
        if kept != gone and places[kept].isdisjoint(places[gone]):
            places[kept] |= places.pop(gone)
            now = {label: kept if target == gone else target for label, target in now.items()}
    for node in nodes.values():
        node.labels = np.array(
            [now.get(int(label), int(label)) for label in node.labels], dtype=np.int64
        )


def _tabulate(modes: SweptModes, nodes: dict[int, _Node], edges: Edges) -> TrackedModes:
    labels = sorted({int(label) for node in nodes.values() for label in node.labels if label >= 0})
    index = np.full((len(modes.frequencies_hz), len(labels)), NOBODY, dtype=np.int64)
    correlation = np.full(index.shape, np.nan)
    for number, node in nodes.items():
        for column, label in enumerate(node.labels):
            if label >= 0:
                index[number, labels.index(int(label))] = column
                correlation[number, labels.index(int(label))] = node.correlation[column]
    asked = ((index >= 0) & (index < modes.wanted[:, None])).any(axis=0)
    tracked = tracked_frequencies(modes.frequencies_hz, index[:, asked])
    order = np.flatnonzero(asked)[np.argsort(np.nanmedian(tracked, axis=0), kind="stable")]
    tracked = tracked_frequencies(modes.frequencies_hz, index[:, order])
    tracking_breaks = sum(_breaks(nodes[i], nodes[j]) for i, j in edges)
    return TrackedModes(
        index[:, order], correlation[:, order], _find_crossings(tracked, edges), tracking_breaks
    )


def tracked_frequencies(frequencies_hz: FloatArray, index: IntArray) -> FloatArray:
    """Return the frequency ``(n, t)`` of each tracked mode in each pose, NaN where it is not."""
    tracked = np.take_along_axis(frequencies_hz, np.maximum(index, 0), axis=1)
    return np.where(index >= 0, tracked, np.nan)


def _find_crossings(tracked: FloatArray, edges: Edges) -> dict[tuple[int, int], int]:
    if not edges:
        return {}
    first, second = np.array(edges).T
    crossings = {}
    for one in range(tracked.shape[1]):
        for other in range(one + 1, tracked.shape[1]):
            above = tracked[:, other] - tracked[:, one]
            count = int(np.count_nonzero(above[first] * above[second] < 0.0))
            if count:
                crossings[one, other] = count
    return crossings


def _breaks(one: _Node, other: _Node) -> bool:
    common = np.intersect1d(one.labels[one.labels >= 0], other.labels)
    first = [int(np.flatnonzero(one.labels == label)[0]) for label in common]
    second = [int(np.flatnonzero(other.labels == label)[0]) for label in common]
    eigenvalues = np.einsum("ij,ij->j", one.field[:, first], other.field[:, second]) ** 2
    return bool((eigenvalues < SAME_MODE).any())
