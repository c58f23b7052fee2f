"""Solid cells of a file in one order of nodes: turned the right way round, middles found by where they lie,
and cut into tets where their families are mixed.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray
from headstock.meshing.component_mesh import IntArray
from headstock.meshing.elements.topology import EDGES
from headstock.meshing.errors import MeshError
from headstock.meshing.files.raw_mesh import (
    CORNERS,
    FAMILY_EDGES,
    FAMILY_FACES,
    MIRRORED,
    Group,
    SolidBlock,
    SolidFamily,
    middle_groups,
)

SAME_PLACE = 1e-9  # of the size of the mesh
ORDER_SAMPLE = 5000  # cells that vote on the order of their nodes
MOST_NODES: dict[SolidFamily, int] = {"tet": 10, "pyramid": 14, "wedge": 18, "hex": 27}
TET_EDGES = np.array(EDGES["tet"])


@dataclass(frozen=True, eq=False)
class SolidCells:
    """Cells of one family.

    Attributes:
        nodes: ``(n, MOST_NODES)`` corners, middles of edges, of quadrilateral faces and of the body as
            `middle_groups` has them; -1 where there is none.
        index: ``(n,)`` which cells of the file they are.
    """

    family: SolidFamily
    nodes: IntArray
    index: IntArray

    @property
    def corners(self) -> IntArray:
        """Corner nodes, ``(n, c)``."""
        return self.nodes[:, : CORNERS[self.family]]

    @property
    def middles(self) -> IntArray:
        """Nodes in the middles of edges, ``(n, e)``."""
        first = CORNERS[self.family]
        return self.nodes[:, first : first + len(FAMILY_EDGES[self.family])]

    def within(self, chosen: NDArray[np.bool_]) -> "SolidCells":
        """Return some of the cells.

        Args:
            chosen: ``(n_cells of the file,)``.
        """
        mine = chosen[self.index]
        return SolidCells(self.family, self.nodes[mine], self.index[mine])


def _all_groups(family: SolidFamily) -> tuple[Group, ...]:
    """Return the corners whose middle each node behind the corners of `SolidCells` is."""
    return middle_groups(family, MOST_NODES[family]) or ()


def gather_cells(path: Path, points: FloatArray, blocks: Sequence[SolidBlock]) -> list[SolidCells]:
    """Return the cells by family, with nodes in one order.

    Formats differ in the order of mid-side nodes and in the side from which corners are counted,
    and programs differ in how well they keep to the format they write.

    Args:
        points: ``(n, 3)`` of the file.

    Raises:
        MeshError: Cells lack corners, or mid-side nodes lie at no sides.
    """
    by_family: dict[SolidFamily, list[SolidCells]] = {}
    start = 0
    for block in blocks:
        first, count = CORNERS[block.family], len(block.nodes)
        if (block.nodes[:, :first] < 0).any():
            row = int(np.flatnonzero((block.nodes[:, :first] < 0).any(axis=1))[0])
            raise MeshError(f"{path.name}: element {block.numbers[row]} lacks a corner")
        groups = _all_groups(block.family)
        full = np.full((count, first + len(groups)), -1, dtype=np.int64)
        full[:, :first] = block.nodes[:, :first]
        columns = {frozenset(group): first + i for i, group in enumerate(groups)}
        target = [columns[frozenset(group)] for group in block.groups]
        full[:, target] = block.nodes[:, first:][:, _vote_order(path, points, block)]
        cells = SolidCells(block.family, full, start + np.arange(count))
        if count and np.median(np.sign(signed_volumes(points, cells))) < 0:
            cells = mirror_cells(cells, np.ones(count, dtype=bool))
        by_family.setdefault(block.family, []).append(cells)
        start += count
    return [
        SolidCells(
            family,
            np.concatenate([part.nodes for part in parts]),
            np.concatenate([part.index for part in parts]),
        )
        for family, parts in by_family.items()
    ]


def _vote_order(path: Path, points: FloatArray, block: SolidBlock) -> IntArray:
    """Return which node behind the corners lies in the middle of each group of a block, in most
    cells.

    Raises:
        MeshError: They lie near the middles of no edges and faces, and the format has no order.
    """
    first, nominal = CORNERS[block.family], np.arange(len(block.groups))
    if not len(nominal):
        return nominal
    corners = np.sort(block.nodes[:, :first], axis=1)
    usable = (block.nodes >= 0).all(axis=1) & (np.diff(corners, axis=1) > 0).all(axis=1)
    rows = block.nodes[usable]
    sample = rows[:: max(1, len(rows) // ORDER_SAMPLE)]
    if not len(sample):
        return nominal
    targets = np.stack(
        [points[sample[:, list(group)]].mean(axis=1) for group in block.groups], axis=1
    )
    apart = np.linalg.norm(targets[:, :, None, :] - points[sample[:, None, first:]], axis=3)
    orders, votes = np.unique(np.argmin(apart, axis=2), axis=0, return_counts=True)
    order = orders[np.argmax(votes)]  # strongly curved cells may vote otherwise
    if len(set(order.tolist())) == len(nominal):
        return np.asarray(order)
    if block.ordered:
        return nominal
    raise MeshError(
        f"{path.name}: nodes of second-order cells do not lie near the middles of their edges; "
        "it is damaged, or its node order is none that is known"
    )


def mirror_cells(cells: SolidCells, turned: NDArray[np.bool_]) -> SolidCells:
    """Return the cells of which some are counted from the other side.

    Args:
        turned: ``(n,)`` which.
    """
    corners = MIRRORED[cells.family]
    groups, first = _all_groups(cells.family), CORNERS[cells.family]
    columns = {frozenset(group): first + i for i, group in enumerate(groups)}
    order = [
        *corners,
        *(columns[frozenset(corners[corner] for corner in group)] for group in groups),
    ]
    nodes = cells.nodes.copy()
    nodes[turned] = nodes[turned][:, order]
    return replace(cells, nodes=nodes)


def signed_volumes(points: FloatArray, cells: SolidCells) -> FloatArray:
    """Return the volume ``(n,)`` between the straight faces of cells, negative where corners are
    counted from the other side.

    Args:
        points: ``(n_points, 3)``.
    """
    places = points[cells.corners]
    places = places - places[:, :1]
    volumes = np.zeros(len(places))
    for face in FAMILY_FACES[cells.family]:
        # a warped face counts as the mean of its two ways to be folded
        folds = [face] if len(face) == 3 else [face, (*face[1:], face[0])]
        for fold in folds:
            for second, third in pairwise(fold[1:]):
                a, b, c = (places[:, corner] for corner in (fold[0], second, third))
                volumes += np.einsum("ci,ci->c", a, np.cross(b, c)) / (6.0 * len(folds))
    return volumes


def fill_middles(
    path: Path, points: FloatArray, every: Sequence[SolidCells], numbers: IntArray
) -> tuple[FloatArray, list[SolidCells]]:
    """Return the cells with a node in the middle of every edge: that of a neighbour, or a new one
    half-way.

    Args:
        points: ``(n, 3)``.

    Raises:
        MeshError: Two cells have nodes in different places in the middle of an edge that they share.
    """
    ends = np.concatenate([_edge_ends(cells).reshape(-1, 2) for cells in every])
    middles = np.concatenate([cells.middles.ravel() for cells in every])
    owners = np.concatenate(
        [np.repeat(cells.index, len(FAMILY_EDGES[cells.family])) for cells in every]
    )
    keys, edge = np.unique(_pair_keys(ends, len(points)), return_inverse=True)
    chosen = np.full(len(keys), -1, dtype=np.int64)
    np.maximum.at(chosen, edge, middles)
    other = np.flatnonzero((middles >= 0) & (middles != chosen[edge]))
    apart = np.linalg.norm(points[middles[other]] - points[chosen[edge[other]]], axis=1)
    other = other[apart > SAME_PLACE * float(np.ptp(points, axis=0).max())]
    if len(other):
        row = other[0]
        second = np.flatnonzero((edge == edge[row]) & (middles == chosen[edge[row]]))[0]
        raise MeshError(
            f"{path.name}: elements {numbers[owners[row]]} and {numbers[owners[second]]} share an edge, but their "
            "nodes in its middle lie apart: the mesh has a slit there; mesh the part again"
        )
    missing = chosen < 0
    chosen[missing] = len(points) + np.arange(int(missing.sum()))
    low, high = keys[missing] // len(points), keys[missing] % len(points)
    points = np.vstack([points, (points[low] + points[high]) / 2])
    filled, start = [], 0
    for cells in every:
        first, count = CORNERS[cells.family], cells.middles.size
        nodes = cells.nodes.copy()
        nodes[:, first : first + cells.middles.shape[1]] = chosen[
            edge[start : start + count]
        ].reshape(cells.middles.shape)
        filled.append(replace(cells, nodes=nodes))
        start += count
    return points, filled


def _edge_ends(cells: SolidCells) -> IntArray:
    return np.sort(cells.corners[:, np.array(FAMILY_EDGES[cells.family])], axis=2)


def _pair_keys(ends: IntArray, n_points: int) -> IntArray:
    return ends[:, 0] * n_points + ends[:, 1]


@dataclass(frozen=True, eq=False)
class _CutTets:
    """Tets into which cells are cut.

    Attributes:
        corners: ``(n, 4)``.
        local: ``(n, 4)`` which corners of their cell those are.
        rows: ``(n,)`` rows of the cells that were cut.
    """

    corners: IntArray
    local: IntArray
    rows: IntArray


def cut_cells(cells: SolidCells) -> _CutTets:
    """Return the tets between the corners of cells; neighbours are cut alike where they meet.

    Every face is cut through its smallest node, and every cell from its smallest corner. What collapses
    because corners of a cell are equal is left out.

    Source: Dompierre, Labbé, Vallet and Camarero (1999), How to subdivide pyramids, prisms and
    hexahedra into tetrahedra.
    """
    corners = cells.corners
    if cells.family == "tet":
        count = len(corners)
        return _CutTets(corners, np.tile(np.arange(4), (count, 1)), np.arange(count))
    tops = np.argmin(corners, axis=1)
    local: list[IntArray] = []
    owners: list[IntArray] = []
    for top in range(corners.shape[1]):
        mine = np.flatnonzero(tops == top)
        for face in FAMILY_FACES[cells.family]:
            if top in face or not len(mine):
                continue
            for a, b, c in _cut_face(np.array(face), corners[mine][:, list(face)]):
                local.append(np.stack([a, c, b, np.full(len(mine), top)], axis=1))
                owners.append(mine)
    order = np.argsort(np.concatenate(owners), kind="stable")
    places, rows = np.concatenate(local)[order], np.concatenate(owners)[order]
    tets = np.take_along_axis(corners[rows], places, axis=1)
    whole = (np.diff(np.sort(tets, axis=1), axis=1) > 0).all(axis=1)
    return _CutTets(tets[whole], places[whole], rows[whole])


def _cut_face(face: IntArray, nodes: IntArray) -> list[tuple[IntArray, IntArray, IntArray]]:
    """Return the triangles of a face of many cells, as local corners ``(n,)`` each."""
    if len(face) == 3:
        a, b, c = (np.full(len(nodes), corner) for corner in face)
        return [(a, b, c)]
    first = np.argmin(nodes, axis=1)
    a, b, c, d = (face[(first + step) % 4] for step in range(4))
    return [(a, b, c), (a, c, d)]


def cut_facets(facets: IntArray) -> IntArray:
    """Return the triangles ``(2 n, 3)`` of quadrilaterals ``(n, 4)``, cut as `cut_cells` cuts the
    cells behind them.
    """
    first = np.argmin(facets, axis=1)[:, None]
    turned = np.take_along_axis(facets, (first + np.arange(4)) % 4, axis=1)
    both = np.concatenate([turned[:, [0, 1, 2]], turned[:, [0, 2, 3]]])
    return both[(np.diff(np.sort(both, axis=1), axis=1) > 0).all(axis=1)]


def cut_to_tets(
    points: FloatArray, every: Sequence[SolidCells]
) -> tuple[FloatArray, IntArray, IntArray]:
    """Return the second-order tets of the same shape as cells of mixed families whose middles are
    filled.

    A diagonal gets the node that the cell's own map puts half-way, so that surfaces of straight-edged cells
    stay what they were.

    Args:
        points: ``(n, 3)``.

    Returns:
        Points, tets ``(n, 10)`` and which cells of the file they are of.
    """
    edge_keys, edge_nodes = [], []
    diagonals: list[tuple[IntArray, FloatArray]] = []
    bodies: list[tuple[IntArray, FloatArray]] = []
    tets, pieces = [], []
    for cells in every:
        edge_keys.append(_pair_keys(_edge_ends(cells).reshape(-1, 2), len(points)))
        edge_nodes.append(cells.middles.ravel())
        cut = cut_cells(cells)
        tets.append(cut.corners)
        pieces.append(cells.index[cut.rows])
        used = np.sort(cut.local[:, TET_EDGES], axis=2)
        # where corners of a cell are equal, a diagonal of its body may be one of a face
        collapsed = np.flatnonzero((np.diff(np.sort(cells.corners, axis=1), axis=1) == 0).any(1))
        for pair, group in _list_diagonals(cells.family):
            rows = cut.rows[(used == pair).all(axis=2).any(axis=1)]
            if len(group) == 4:
                rows = np.concatenate([rows, collapsed])
            ends = np.sort(cells.corners[rows][:, list(pair)], axis=1)
            middle_keys = _pair_keys(ends, len(points)), _group_middles(points, cells, rows, group)
            (diagonals if len(group) == 4 else bodies).append(middle_keys)
    diagonals += [*bodies, (np.zeros(0, dtype=np.int64), np.zeros((0, 3)))]
    keys, first = np.unique(np.concatenate(edge_keys), return_index=True)
    nodes = np.concatenate(edge_nodes)[first]
    others, where = np.unique(
        np.concatenate([pair_keys for pair_keys, _ in diagonals]), return_index=True
    )
    new = ~np.isin(others, keys)
    places = np.concatenate([pair_keys for _, pair_keys in diagonals])[where[new]]
    keys = np.concatenate([keys, others[new]])
    nodes = np.concatenate([nodes, len(points) + np.arange(len(places))])
    order = np.argsort(keys)
    corners = np.concatenate(tets)
    wanted = _pair_keys(np.sort(corners[:, TET_EDGES], axis=2).reshape(-1, 2), len(points))
    middles = nodes[order][np.searchsorted(keys[order], wanted)].reshape(-1, 6)
    return np.vstack([points, places]), np.hstack([corners, middles]), np.concatenate(pieces)


def _list_diagonals(family: SolidFamily) -> list[tuple[tuple[int, int], Group]]:
    """Return the pairs of corners that are no edge, and the one quadrilateral face, or else the
    body, that they cross.
    """
    edges = FAMILY_EDGES[family]
    edge_sets = {frozenset(edge) for edge in edges}
    groups = _all_groups(family)[len(edges) :]
    return [
        (pair, next((group for group in groups if set(pair) <= set(group)), groups[-1]))
        for pair in combinations(range(CORNERS[family]), 2)
        if frozenset(pair) not in edge_sets
    ]


def _group_middles(
    points: FloatArray, cells: SolidCells, rows: IntArray, group: Group
) -> FloatArray:
    """Return where the map of cells puts the middle of a face or of the body.

    Source: Zienkiewicz and Taylor (2000), vol. 1, ch. 8, serendipity shape functions.
    """
    first, edges = CORNERS[cells.family], FAMILY_EDGES[cells.family]
    around = [first + i for i, edge in enumerate(edges) if set(edge) <= set(group)]
    corners = points[cells.nodes[rows][:, list(group)]].sum(axis=1)
    middles = points[cells.nodes[rows][:, around]].sum(axis=1)
    places = -0.25 * corners + (0.5 if len(group) == 4 else 0.25) * middles
    given = cells.nodes[rows, first + _all_groups(cells.family).index(group)]
    return np.where((given >= 0)[:, None], points[np.maximum(given, 0)], places)
