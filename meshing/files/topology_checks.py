"""Whether cells of a file make one solid: none twice, none turned, none within another, all connected.

This runs in the isolated process that reads the file: libraries that build the topology of a mesh corrupt
memory where a face has more than two cells.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from headstock.geometry.frames import FloatArray
from headstock.meshing.component_mesh import IntArray
from headstock.meshing.errors import MeshError
from headstock.meshing.files.raw_mesh import CORNERS, FAMILY_EDGES, FAMILY_FACES
from headstock.meshing.files.solid_cells import (
    SAME_PLACE,
    SolidCells,
    cut_cells,
    mirror_cells,
    signed_volumes,
)

NAMED = 3  # cells or groups in a message
# of the size of a tet: how deep the middle of a face lies in what it only touches
DEPTH = 1e-3
CHUNK = 1000


@dataclass(frozen=True, eq=False)
class _Faces:
    """Faces of cells, each once for every cell it belongs to.

    Attributes:
        nodes: ``(n, 4)`` outward; -1 behind the corners of triangles.
        keys: ``(n, 4)`` the same nodes sorted.
        owners: ``(n,)`` which cell of the file.
    """

    nodes: IntArray
    keys: IntArray
    owners: IntArray

    def runs(self) -> tuple[IntArray, IntArray, IntArray]:
        """Return the order in which equal faces follow each other, and where each run starts and
        how long it is.
        """
        order = np.lexsort(self.keys.T)
        new = np.concatenate([[True], np.diff(self.keys[order], axis=0).any(axis=1)])
        starts = np.flatnonzero(new)
        return order, starts, np.diff(np.append(starts, len(order)))

    def upward(self) -> NDArray[np.bool_]:
        """Return whether a face runs from its smallest corner to the smaller of its two neighbours,
        ``(n,)``; two cells on both sides of a face see it run both ways.
        """
        count = (self.nodes >= 0).sum(axis=1)
        first = np.argmin(np.where(self.nodes < 0, self.nodes.max(initial=0) + 1, self.nodes), 1)
        rows = np.arange(len(self.nodes))
        following = self.nodes[rows, (first + 1) % count]
        return following < self.nodes[rows, (first - 1) % count]


def list_cell_faces(every: Sequence[SolidCells]) -> _Faces:
    """Return the faces of cells; a face that collapses to a triangle is one, to less is none."""
    nodes, owners = [], []
    for cells in every:
        corners = cells.corners
        for face in FAMILY_FACES[cells.family]:
            sorted_corners = np.full((len(corners), 4), -1, dtype=np.int64)
            sorted_corners[:, : len(face)] = corners[:, list(face)]
            nodes.append(sorted_corners)
            owners.append(cells.index)
    rows, owner = np.concatenate(nodes), np.concatenate(owners)
    count = (rows >= 0).sum(axis=1)
    following = np.take_along_axis(rows, (np.arange(4) + 1) % count[:, None], axis=1)
    repeated = (rows == following) & (rows >= 0)
    if repeated.any():
        rows = np.where(repeated, -1, rows)
        # what is left moves to the front in its order
        rows = np.take_along_axis(rows, np.argsort(rows < 0, axis=1, kind="stable"), axis=1)
    keys = np.sort(rows, axis=1)
    whole = ((rows >= 0).sum(axis=1) >= 3) & ((np.diff(keys, axis=1) > 0) | (keys[:, 1:] < 0)).all(
        axis=1
    )
    return _Faces(rows[whole], keys[whole], owner[whole])


def drop_repeated_cells(
    path: Path, every: Sequence[SolidCells], numbers: IntArray, materials: IntArray
) -> tuple[list[SolidCells], list[str]]:
    """Return the cells without those that have the corners of another, and what is to be said of
    them.

    Args:
        materials: Number of the material of each cell, -1 where none is known.

    Raises:
        MeshError: Two cells with the same corners differ in material or in the nodes between.
    """
    kept, pairs = [], []
    total = sum(len(cells.index) for cells in every)
    for cells in every:
        keys = np.sort(cells.corners, axis=1)
        filled = (cells.nodes >= 0).sum(axis=1)
        order = np.lexsort((-filled, *keys.T))
        same = np.concatenate([[False], ~np.diff(keys[order], axis=0).any(axis=1)])
        first = order[np.maximum.accumulate(np.where(same, 0, np.arange(len(order))))]
        twice = np.flatnonzero(same)
        for repeated in twice:
            later, other = order[repeated], first[repeated]
            names = f"elements {numbers[cells.index[other]]} and {numbers[cells.index[later]]}"
            left, right = materials[cells.index[later]], materials[cells.index[other]]
            if left != right:
                raise MeshError(
                    f"{path.name}: {names} have the same corners and different materials; delete one of them"
                )
            if not set(cells.nodes[later].tolist()) <= {-1, *cells.nodes[other].tolist()}:
                raise MeshError(
                    f"{path.name}: {names} have the same corners and different nodes between; delete one of them"
                )
            pairs.append((numbers[cells.index[other]], numbers[cells.index[later]]))
        stays = np.ones(len(cells.index), dtype=bool)
        stays[order[twice]] = False
        kept.append(SolidCells(cells.family, cells.nodes[stays], cells.index[stays]))
    if not pairs:
        return kept, []
    named = ", ".join(f"{a} and {b}" for a, b in pairs[:NAMED])
    more = ", ..." if len(pairs) > NAMED else ""
    return kept, [
        f"{path.name} holds {len(pairs)} of its {total} solid cells twice (elements {named}{more}); "
        "each is taken once"
    ]


def turn_cells(
    points: FloatArray, every: Sequence[SolidCells]
) -> tuple[list[SolidCells], list[str]]:
    """Return the cells with those turned that are counted from the other side than their
    neighbours.

    A cell of negative volume that agrees with its neighbours is not turned: nodes of it lie in the wrong
    place.

    Args:
        points: ``(n, 3)``.
    """
    volumes = [signed_volumes(points, cells) for cells in every]
    if all((part >= 0.0).all() for part in volumes):
        return list(every), []
    faces = list_cell_faces(every)
    order, starts, lengths = faces.runs()
    pairs = starts[lengths == 2]
    one, two = order[pairs], order[pairs + 1]
    upward = faces.upward()
    vote = np.where(upward[one] == upward[two], 1, -1)
    size = 1 + int(max(cells.index.max(initial=0) for cells in every))
    balance = np.zeros(size, dtype=np.int64)
    np.add.at(balance, faces.owners[one], vote)
    np.add.at(balance, faces.owners[two], vote)
    turned, result = 0, []
    for cells, volume in zip(every, volumes, strict=True):
        wrong = (volume < 0.0) & (balance[cells.index] > 0)
        turned += int(wrong.sum())
        result.append(mirror_cells(cells, wrong))
    if not turned:
        return list(every), []
    return result, [
        f"{turned} cells count their corners from the other side than their neighbours and were turned"
    ]


def check_one_solid(
    path: Path,
    points: FloatArray,
    every: Sequence[SolidCells],
    numbers: IntArray,
    names: Sequence[str],
) -> None:
    """Refuse cells that are no solid: with faces of three cells, within each other, or in several parts.

    Args:
        points: ``(n, 3)``.
        every: Cells of all families, none of them twice.
        names: Of the groups of cells that the file has, for messages.

    Raises:
        MeshError: They are no solid.
    """
    cuts = [cut_cells(cells) for cells in every]
    tets = np.concatenate([cut.corners for cut in cuts])
    owners = np.concatenate([cells.index[cut.rows] for cells, cut in zip(every, cuts, strict=True)])
    # tets may stand behind the two halves of a face of a hex
    pieces = [SolidCells("tet", np.pad(tets, ((0, 0), (0, 6)), constant_values=-1), owners)]
    faces = list_cell_faces(every if len(every) == 1 else pieces)
    order, starts, lengths = faces.runs()
    crowded = np.flatnonzero(lengths > 2)
    if len(crowded):
        start, length = starts[crowded[0]], lengths[crowded[0]]
        sharing = numbers[np.sort(faces.owners[order[start : start + length]])]
        *others, last = map(str, sharing[: NAMED + 1])
        raise MeshError(
            f"{path.name}: {len(crowded)} faces belong to more than two cells, the first to elements "
            f"{', '.join(others)} and {last}: cells overlap; delete what is not of the part"
        )
    if len(every) > 1:
        _check_cuts(path, every, numbers, faces)
    pairs = starts[lengths == 2]
    left, right = faces.owners[order[pairs]], faces.owners[order[pairs + 1]]
    _check_connected(path, points, every, left, right, names)
    tangled = any((signed_volumes(points, cells) <= 0.0).any() for cells in every)
    a, b, c = (points[tets[:, corner]] - points[tets[:, 0]] for corner in (1, 2, 3))
    if tangled or (np.einsum("ci,ci->c", a, np.cross(b, c)) <= 0.0).any():
        return  # what is wrong with single elements is said of them
    upward = faces.upward()
    folded = np.flatnonzero(upward[order[pairs]] == upward[order[pairs + 1]])
    if len(folded):
        _refuse_overlaps(path, numbers, left[folded], right[folded])
    slack = np.zeros(1 + int(owners.max()))
    for cells in every:
        slack[cells.index] = _measure_curvature(points, cells)
    rim = order[starts[lengths == 1]]
    inner, outer = _find_covered_faces(
        points, tets, owners, slack, faces.nodes[rim], faces.owners[rim]
    )
    if len(inner):
        _refuse_overlaps(path, numbers, inner, outer)


def _check_cuts(path: Path, every: Sequence[SolidCells], numbers: IntArray, pieces: _Faces) -> None:
    """Refuse quadrilaterals that meet two triangles cut across the other diagonal, a slit in the mesh.

    Args:
        pieces: Faces of the tets they are cut into.
    """
    order, starts, lengths = pieces.runs()
    open_triangles = {tuple(map(int, key)) for key in pieces.keys[order[starts[lengths == 1]], 1:]}
    faces = list_cell_faces(every)
    order, starts, lengths = faces.runs()
    rim = order[starts[lengths == 1]]
    for row in rim[faces.nodes[rim, 3] >= 0]:
        a, b, c, d = map(int, faces.nodes[row])
        halves = [(a, b, c), (a, c, d)], [(b, c, d), (b, d, a)]
        if all(tuple(sorted(half)) in open_triangles for pair in halves for half in pair):
            raise MeshError(
                f"{path.name}: element {numbers[faces.owners[row]]} has a face of four corners that meets two triangles "
                "across the other diagonal, which leaves a slit; write pyramids between hexes and tets"
            )


def _refuse_overlaps(path: Path, numbers: IntArray, left: IntArray, right: IntArray) -> None:
    pairs = np.unique(np.sort(np.stack([left, right], axis=1), axis=1), axis=0)
    named = ", ".join(f"{numbers[a]} and {numbers[b]}" for a, b in pairs[:NAMED])
    what = f"{len(pairs)} pairs of cells overlap" if len(pairs) > 1 else "a pair of cells overlaps"
    raise MeshError(
        f"{path.name}: {what} (elements {named}{', ...' if len(pairs) > NAMED else ''}); "
        "delete what is not of the part"
    )


def _check_connected(
    path: Path,
    points: FloatArray,
    every: Sequence[SolidCells],
    left: IntArray,
    right: IntArray,
    names: Sequence[str],
) -> None:
    """Refuse cells that hang together by less than faces."""
    index = np.unique(np.concatenate([cells.index for cells in every]))
    size = 1 + int(index.max())
    parts = _count_sets(size, left, right)[index]
    numbers = np.unique(parts)
    if len(numbers) < 2:
        return
    nodes = np.concatenate([cells.corners.ravel() for cells in every])
    cell = np.concatenate([np.repeat(cells.index, CORNERS[cells.family]) for cells in every])
    joined = _count_sets(size + int(nodes.max()) + 1, cell, size + nodes)[index]
    apart = len(np.unique(joined))
    counts = np.sort(np.unique(joined if apart > 1 else parts, return_counts=True)[1])[::-1]
    sizes = f"of {', '.join(str(count) for count in counts[:NAMED])}{', ...' if len(counts) > NAMED else ''} cells"
    remedy = "make one component of each, or merge coincident nodes"
    if names:
        shown = ", ".join(f'"{name}"' for name in names[: 2 * NAMED])
        remedy += f'; solid = {{ mesh = "...", solid = "NAME" }} takes a set of cells: {shown}'
    if apart > 1:
        middles = np.concatenate([points[cells.corners].mean(axis=1) for cells in every])
        near = SAME_PLACE * float(np.ptp(points, axis=0).max())
        twice = len(cKDTree(middles).query_pairs(near, output_type="ndarray"))
        if twice:
            remedy = f"{twice} cells lie in the same place as another, with nodes of their own: delete them, {remedy}"
        raise MeshError(
            f"{path.name}: the mesh falls into {apart} parts that share no node ({sizes}); {remedy}"
        )
    raise MeshError(
        f"{path.name}: the mesh falls into {len(numbers)} parts that meet in single nodes or edges only ({sizes}), as "
        f"hinges do; {remedy}"
    )


def _count_sets(size: int, left: IntArray, right: IntArray) -> IntArray:
    graph = coo_array((np.ones(len(left), dtype=np.int8), (left, right)), shape=(size, size))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)


def _measure_curvature(points: FloatArray, cells: SolidCells) -> FloatArray:
    """Return how far ``(n,)`` cells reach beyond or stay behind tets between their corners."""
    corners, middles = points[cells.corners], cells.middles
    ends = np.array(FAMILY_EDGES[cells.family])
    away = points[np.maximum(middles, 0)] - corners[:, ends].mean(axis=2)
    bent = np.where(middles >= 0, np.linalg.norm(away, axis=2), 0.0).max(axis=1)
    for face in FAMILY_FACES[cells.family]:
        if len(face) == 4:
            a, b, c, d = (corners[:, corner] for corner in face)
            bent = np.maximum(bent, np.linalg.norm(a - b + c - d, axis=1) / 2)
    return np.asarray(bent)


def _find_covered_faces(
    points: FloatArray,
    tets: IntArray,
    owners: IntArray,
    slack: FloatArray,
    faces: IntArray,
    face_owners: IntArray,
) -> tuple[IntArray, IntArray]:
    """Find the pairs of cells of which one has the middle of a face of the surface inside the
    other.

    Where every inner face has a cell on either side, cells overlap only where the surface runs through
    them.

    Args:
        points: ``(n_points, 3)``.
        tets: ``(n, 4)`` of positive volume, which fill the cells.
        owners: ``(n,)`` their cells.
        slack: By cell, how far its faces lie from those of its tets.
        faces: ``(m, 4)`` of the surface, -1 behind the corners of triangles.
        face_owners: ``(m,)`` their cells.
    """
    corners = points[tets]
    centers, low, high = corners.mean(axis=1), corners.min(axis=1), corners.max(axis=1)
    radii = np.linalg.norm(corners - centers[:, None], axis=2).max(axis=1)
    inverse = np.linalg.inv(corners[:, 1:] - corners[:, :1])
    # height of a corner over the face opposite is one over the length of its gradient
    gradients = np.concatenate([-inverse.sum(axis=2, keepdims=True), inverse], axis=2)
    heights = 1.0 / np.linalg.norm(gradients, axis=1)
    present = faces >= 0
    places = np.where(present[:, :, None], points[np.maximum(faces, 0)], 0.0).sum(axis=1)
    places = places / present.sum(axis=1)[:, None]
    inner, outer = [], []
    octaves = np.floor(np.log2(radii))
    for octave in np.unique(octaves):
        mine = np.flatnonzero(octaves == octave)
        tree = cKDTree(centers[mine])
        for start in range(0, len(places), CHUNK):
            near = tree.query_ball_point(places[start : start + CHUNK], 2.0 ** (octave + 1))
            face = start + np.repeat(np.arange(len(near)), [len(cells_near) for cells_near in near])
            if not len(face):
                continue
            tet = mine[
                np.concatenate([np.array(cells_near, dtype=np.int64) for cells_near in near])
            ]
            near_box = (low[tet] <= places[face]) & (places[face] <= high[tet])
            other = near_box.all(axis=1) & (owners[tet] != face_owners[face])
            face, tet = face[other], tet[other]
            away = places[face] - corners[tet, 0]
            shares = np.einsum("ti,tij->tj", away, gradients[tet])
            shares[:, 0] += 1.0
            depth = (shares * heights[tet]).min(axis=1)
            reach = slack[owners[tet]] + slack[face_owners[face]]
            deep = depth > DEPTH * radii[tet] + 2.0 * reach
            inner.append(face_owners[face[deep]])
            outer.append(owners[tet[deep]])
    if not inner:
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    return np.concatenate(inner), np.concatenate(outer)
