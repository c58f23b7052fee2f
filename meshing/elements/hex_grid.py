"""Structured hexahedral meshes of boxes, with grid lines along rectangular imprints."""

import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Patch
from headstock.geometry.parts.patches import FACE_DIRECTIONS, imprint_window, in_plane_axes
from headstock.geometry.parts.solids import Box
from headstock.meshing.component_mesh import CellKind, IntArray
from headstock.meshing.elements.topology import reference_nodes
from headstock.meshing.errors import MeshError
from headstock.meshing.process.job import MeshData

MERGE_TOLERANCE = 1e-9


def mesh_box_grid(
    box: Box, groups: Mapping[str, Sequence[Patch]], *, size: float, order: int, across: int = 4
) -> MeshData:
    """Mesh a box with 8- or 27-node hexes.

    Args:
        groups: Patches of each group: whole faces, rects and strips.
        size: Largest element side [m].
        order: 1 or 2.
        across: Least number of elements across a patch.

    Raises:
        MeshError: A patch is a disk or lies on no face of the box.
    """
    lines = grid_lines(
        box, (patch for patches in groups.values() for patch in patches), size, across
    )
    points, cells = _grid_cells(lines, order)
    facets = {
        name: np.concatenate([_patch_facets(box, lines, patch, order) for patch in patches])
        for name, patches in groups.items()
    }
    kind: CellKind = "hex8" if order == 1 else "hex27"
    return MeshData(points, cells, kind, facets, size=size)


def grid_lines(
    box: Box, patches: Iterable[Patch], size: float, across: int = 4
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the positions of the grid planes along x, y and z [m]: patch edges, and evenly spaced
    planes between them.

    Args:
        size: Largest distance of planes [m].
        across: Fewest elements across a patch.
    """
    low, high = _corners(box)
    cuts: list[list[float]] = [[low[axis], high[axis]] for axis in range(3)]
    narrow: list[list[tuple[float, float]]] = [[], [], []]
    for patch in patches:
        for axis, (start, end) in _patch_window(box, patch).items():
            if (start, end) != (low[axis], high[axis]):
                cuts[axis] += [start, end]
                narrow[axis].append((start, end))
    return (
        _spread(cuts[0], narrow[0], size, across),
        _spread(cuts[1], narrow[1], size, across),
        _spread(cuts[2], narrow[2], size, across),
    )


def count_grid_cells(lines: Sequence[FloatArray]) -> int:
    """Return the number of hexes a grid makes."""
    return math.prod(len(axis) - 1 for axis in lines)


def _corners(box: Box) -> tuple[FloatArray, FloatArray]:
    x, y, z = box.size
    return np.array([-x / 2, -y / 2, 0.0]), np.array([x / 2, y / 2, z])


def _spread(
    cuts: list[float], patches: list[tuple[float, float]], size: float, across: int
) -> FloatArray:
    tolerance = MERGE_TOLERANCE * (max(cuts) - min(cuts))
    edges: list[float] = []
    for cut in sorted(cuts):
        if not edges or cut - edges[-1] > tolerance:
            edges.append(cut)
    parts = [np.array(edges[:1])]
    for start, end in pairwise(edges):
        limit = size
        for low, high in patches:
            if low - tolerance <= start and end <= high + tolerance:
                limit = min(limit, (high - low) / across)
        count = max(1, int(np.ceil((end - start) / limit - 1e-6)))
        parts.append(start + (end - start) * np.arange(1, count + 1) / count)
    return np.concatenate(parts)


def _patch_window(box: Box, patch: Patch) -> dict[int, tuple[float, float]]:
    """Return the extent of a patch along the two axes of its face, cut to the box."""
    if patch.face not in FACE_DIRECTIONS:
        raise MeshError(
            f"face {patch.face!r} selects nothing on a hex-meshed box; available: {', '.join(FACE_DIRECTIONS)}"
        )
    if not patch.is_grid_aligned:
        what = f"a turned {patch.shape}" if patch.angle else f"the {patch.shape}"
        raise MeshError(
            f'{what} on face {patch.face!r} cannot follow the grid of a hex mesh; write cells = "tet", or a rect along the axes'
        )
    low, high = _corners(box)
    axis, _ = FACE_DIRECTIONS[patch.face]
    first, second = in_plane_axes(axis)
    window = (
        (-np.inf, np.inf, -np.inf, np.inf)
        if patch.shape == "whole"
        else imprint_window(axis, patch)
    )
    result: dict[int, tuple[float, float]] = {}
    for direction, start, end in ((first, window[0], window[1]), (second, window[2], window[3])):
        cut = (float(max(start, low[direction])), float(min(end, high[direction])))
        if not cut[1] > cut[0]:
            span = f"{1e3 * low[direction]:.6g} .. {1e3 * high[direction]:.6g} mm along {'xyz'[direction]}"
            raise MeshError(
                f"the {patch.shape} on face {patch.face!r} does not touch it; the face spans {span}"
            )
        result[direction] = cut
    return result


def _grid_cells(
    lines: tuple[FloatArray, FloatArray, FloatArray], order: int
) -> tuple[FloatArray, IntArray]:
    axes = [
        line if order == 1 else np.sort(np.concatenate([line, (line[1:] + line[:-1]) / 2]))
        for line in lines
    ]
    shape = [len(axis) for axis in axes]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    starts = np.stack(
        np.meshgrid(*(order * np.arange(len(line) - 1) for line in lines), indexing="ij"), axis=-1
    ).reshape(-1, 3)
    steps = np.rint(
        (reference_nodes("hex8" if order == 1 else "hex27") + 1.0) / 2.0 * order
    ).astype(np.int64)
    index = starts[:, None, :] + steps[None, :, :]
    return points, (index[..., 0] * shape[1] + index[..., 1]) * shape[2] + index[..., 2]


def _patch_facets(
    box: Box, lines: tuple[FloatArray, FloatArray, FloatArray], patch: Patch, order: int
) -> IntArray:
    """Return the corner nodes ``(n, 4)`` of the grid's facets inside a patch."""
    axis, sign = FACE_DIRECTIONS[patch.face]
    shape = [order * (len(line) - 1) + 1 for line in lines]
    spans = {}
    for direction, (start, end) in _patch_window(box, patch).items():
        middles = (lines[direction][1:] + lines[direction][:-1]) / 2
        spans[direction] = order * np.flatnonzero((start < middles) & (middles < end))
    first, second = in_plane_axes(axis)
    a, b = (grid.ravel() for grid in np.meshgrid(spans[first], spans[second], indexing="ij"))
    corners = []
    for step_a, step_b in ((0, 0), (order, 0), (order, order), (0, order)):
        index = np.zeros((len(a), 3), dtype=np.int64)
        index[:, axis] = 0 if sign < 0.0 else shape[axis] - 1
        index[:, first], index[:, second] = a + step_a, b + step_b
        corners.append((index[:, 0] * shape[1] + index[:, 1]) * shape[2] + index[:, 2])
    return np.column_stack(corners)
