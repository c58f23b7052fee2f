"""The visible surface of a component: triangles and the sharp edges between them, for pictures; of
parametric solids, and a box of equal inertia for bodies of unknown shape.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray, Frame
from headstock.geometry.parts.patches import planar_boxes
from headstock.geometry.parts.solids import Box, HollowColumn, Plate, PointMass, Solid, Tube

IntArray = NDArray[np.int64]

MARK, AXIS = 0.012, 0.1  # half of a mark and length of an axis, of the extent of a body
SPIKE = 0.3  # thickness of an axis over that of a mark
MOST_AXES = 100
SHARP_COSINE = float(np.cos(np.radians(40.0)))


@dataclass(frozen=True, eq=False)
class Skin:
    """A triangulated surface in the component frame.

    Attributes:
        points: ``(n, 3)`` [m].
        triangles: ``(m, 3)`` outward, indices into ``points``.
        edges: ``(k, 2)`` sharp edges, indices into ``points``.
        source: What it was made of: the mesh, the solid, or, where neither is at hand, a box of
            equal inertia.
        nodes: ``(n, k)`` mesh points around each point; None where there is no mesh.
        weights: ``(n, k)`` their shares in what moves it, of sum one.
        thinned_from: How many triangles it had before some were taken out; None where none were.
        kept_whole: Why none were taken out though there are very many; None where that is not so.
    """

    points: FloatArray
    triangles: IntArray
    edges: IntArray
    source: str
    nodes: IntArray | None = None
    weights: FloatArray | None = None
    thinned_from: int | None = None
    kept_whole: str | None = None


def sharp_edges(points: FloatArray, triangles: IntArray) -> IntArray:
    """Return the edges ``(k, 2)`` where two triangles meet at more than 40 degrees, or that belong
    to one or more than two triangles.
    """
    if not len(triangles):
        return np.zeros((0, 2), dtype=np.int64)
    corners = points[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    normals /= np.where(lengths > 0.0, lengths, 1.0)
    every = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    owners = np.repeat(np.arange(len(triangles)), 3)
    edges, inverse, counts = np.unique(every, axis=0, return_inverse=True, return_counts=True)
    order = np.argsort(inverse.ravel(), kind="stable")
    first = np.concatenate([[0], np.cumsum(counts)[:-1]])
    left = owners[order[first]]
    right = owners[order[first + np.minimum(counts, 2) - 1]]
    cosine = np.einsum("ij,ij->i", normals[left], normals[right])
    return edges[(counts != 2) | (cosine < SHARP_COSINE)]


def split_skin(skin: Skin) -> Skin:
    """Return the same surface with every triangle cut into four and every edge into two at their
    middles.
    """
    every = np.sort(
        np.vstack(
            [
                skin.triangles[:, [0, 1]],
                skin.triangles[:, [1, 2]],
                skin.triangles[:, [2, 0]],
                skin.edges,
            ]
        ),
        axis=1,
    )
    pairs, inverse = np.unique(every, axis=0, return_inverse=True)
    middles = len(skin.points) + inverse.ravel()
    count = len(skin.triangles)
    a, b, c = skin.triangles.T
    ab, bc, ca = middles[:count], middles[count : 2 * count], middles[2 * count : 3 * count]
    halves = middles[3 * count :]
    return Skin(
        np.vstack([skin.points, skin.points[pairs].mean(axis=1)]),
        np.vstack(
            [
                np.column_stack(corners)
                for corners in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
            ]
        ),
        np.vstack(
            [
                np.column_stack([skin.edges[:, 0], halves]),
                np.column_stack([halves, skin.edges[:, 1]]),
            ]
        ),
        skin.source,
    )


def join_skins(skins: list[Skin]) -> Skin:
    """Return several surfaces as one."""
    starts = np.cumsum([0, *(len(skin.points) for skin in skins)])[:-1]
    return Skin(
        np.vstack([skin.points for skin in skins]),
        np.vstack([skin.triangles + start for skin, start in zip(skins, starts, strict=True)]),
        np.vstack([skin.edges + start for skin, start in zip(skins, starts, strict=True)]),
        skins[0].source,
    )


SIDES = 48
DRAWN_DENSITY = 7850.0  # of the cube that stands for a point mass [kg/m^3]: steel
# corners of a box in binary order of x y z; outward
BOX_QUADS = ((0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5))
Source = Literal["solid", "inertia"]


def solid_skin(solid: Solid) -> Skin | None:
    """Return what is seen of a parametric solid from outside, of a point mass a steel cube of its
    mass; None for solids that are read from files.
    """
    if isinstance(solid, Tube):
        return _tube_skin(solid)
    if isinstance(solid, Box | HollowColumn):
        x, y, z = solid.size
        return box_skin(np.array([-x / 2, -y / 2, 0.0]), np.array([x / 2, y / 2, z]))
    if isinstance(solid, PointMass):
        half = 0.5 * (solid.mass / DRAWN_DENSITY) ** (1.0 / 3.0)
        return box_skin(np.full(3, -half), np.full(3, half))
    if isinstance(solid, Plate):
        return join_skins(
            [box_skin(low, high) for sign, low, high in planar_boxes(solid) if sign > 0.0]
        )
    return None


def prism_skin(solid: Solid, axis: int, places: FloatArray) -> Skin:
    """Return the surface of a box, plate or tube that has one section along an axis, cut across at
    places so that it can bend.

    Args:
        axis: Direction of the bar, 0..2.
        places: ``(n,)`` ascending along the axis, from end to end [m].
    """
    around = [(axis + 1) % 3, (axis + 2) % 3]
    loops = _round_loops(solid) if isinstance(solid, Tube) else [_box_loop(solid, around)]
    points: list[FloatArray] = []
    triangles: list[IntArray] = []
    starts: list[int] = []
    for number, loop in enumerate(loops):
        rings = np.zeros((len(places), len(loop), 3))
        rings[:, :, around] = loop
        rings[:, :, axis] = places[:, None]
        starts.append(len(places) * sum(len(before) for before in loops[:number]))
        points.append(rings.reshape(-1, 3))
        triangles.append(_wall_triangles(len(places), len(loop), starts[-1], outward=number == 0))
    last = (len(places) - 1) * len(loops[0])
    triangles += [
        _cap_triangles(starts, 0, len(loops[0]), upward=False),
        _cap_triangles(starts, last, len(loops[0]), upward=True),
    ]
    every, corners = np.vstack(points), np.vstack(triangles)
    return Skin(every, corners, sharp_edges(every, corners), "solid")


def box_skin(low: FloatArray, high: FloatArray, source: Source = "solid") -> Skin:
    """Return a block between two corners [m].

    Args:
        low: Lowest corner, ``(3,)`` [m].
        high: Highest corner, ``(3,)`` [m].
        source: What the skin is made from.
    """
    points = np.array(
        [np.where(bits, high, low) for bits in itertools.product((False, True), repeat=3)]
    )[:, :]
    # product runs z fastest; BOX_QUADS counts x fastest
    points = points[[4 * (i & 1) + 2 * (i >> 1 & 1) + (i >> 2) for i in range(8)]]
    triangles = np.array([t for a, b, c, d in BOX_QUADS for t in ((a, b, c), (a, c, d))])
    return Skin(points, triangles, sharp_edges(points, triangles), source)


def inertia_skin(mass: float, center: FloatArray, inertia: FloatArray) -> Skin:
    """Return the block of equal mass, centre and inertia: ``m (a^2 + b^2) / 12`` about each
    principal axis; a speck without mass.

    Args:
        mass: Of the body [kg].
        center: Its centre of mass, ``(3,)`` [m].
        inertia: About it, ``(3, 3)`` [kg m^2].
    """
    moments, axes = np.linalg.eigh(inertia / mass if mass > 0.0 else np.zeros((3, 3)))
    squares = 6.0 * (moments.sum() - 2.0 * moments)
    half = 0.5 * np.sqrt(np.maximum(squares, 1e-6))
    if np.linalg.det(axes) < 0.0:
        axes = -axes
    box = box_skin(-half, half, "inertia")
    return Skin(center + box.points @ axes.T, box.triangles, box.edges, "inertia")


def mark_places(skin: Skin, frames: Sequence[Frame]) -> Skin:
    """Return a skin with a small octahedron at the origin of each frame, and a spike along each of its
    axes; of more than ``MOST_AXES`` frames the octahedra alone.
    """
    places = np.array([frame.origin for frame in frames])
    extent = float(np.linalg.norm(np.ptp(np.vstack([skin.points, places]), axis=0)))
    # six corners x+ y+ z+ x- y- z- of the octahedron, and the tips of the spikes on its faces
    ball = MARK * extent * np.vstack([np.eye(3), -np.eye(3)])
    corners = np.vstack([ball, AXIS * extent * np.eye(3), SPIKE * ball])
    upper = np.array([(0, 1, 2), (1, 3, 2), (3, 4, 2), (4, 0, 2)])
    faces: IntArray = np.vstack([upper, np.where(upper == 2, 5, upper)[:, ::-1]])
    lines: IntArray = np.zeros((0, 2), dtype=np.int64)
    if len(frames) <= MOST_AXES:
        around = [[9 + (axis + turn) % 6 for turn in (1, 2, 4, 5)] for axis in range(3)]
        spikes = [
            (ring[k], ring[(k + 1) % 4], 6 + axis)
            for axis, ring in enumerate(around)
            for k in range(4)
        ]
        faces, lines = np.vstack([faces, spikes]), np.array([(0, 6), (1, 7), (2, 8)])
    first = len(skin.points) + len(corners) * np.arange(len(frames))[:, None, None]
    points = [frame.origin + corners @ frame.rotation.T for frame in frames]
    return replace(
        skin,
        points=np.vstack([skin.points, *points]),
        triangles=np.vstack([skin.triangles, (first + faces).reshape(-1, 3)]),
        edges=np.vstack([skin.edges, (first + lines).reshape(-1, 2)]),
    )


def _tube_skin(tube: Tube) -> Skin:
    angles = 2.0 * np.pi * np.arange(SIDES) / SIDES
    circle = np.column_stack([np.cos(angles), np.sin(angles)])
    outer, inner = 0.5 * tube.outer_diameter, 0.5 * tube.inner_diameter
    # rings: outer bottom, outer top, inner top, inner bottom; the surface runs round through them
    rings = [(outer, 0.0), (outer, tube.length), (inner, tube.length), (inner, 0.0)]
    points = np.vstack(
        [np.column_stack([radius * circle, np.full(SIDES, height)]) for radius, height in rings]
    )
    k = np.arange(SIDES)
    after = (k + 1) % SIDES
    triangles = []
    for ring in range(4 if inner > 0.0 else 3):
        low, high = SIDES * ring, SIDES * ((ring + 1) % 4)
        triangles += [
            np.column_stack([low + k, low + after, high + after]),
            np.column_stack([low + k, high + after, high + k]),
        ]
    if inner == 0.0:  # the inner bottom ring closes the bottom
        triangles.append(np.column_stack([3 * SIDES + k, after, k]))
    faces = np.vstack(triangles)
    corners = points[faces]
    areas = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    faces = faces[areas > 1e-12 * max(outer, tube.length) ** 2]
    edges = [
        np.column_stack([SIDES * ring + k, SIDES * ring + after])
        for ring in range(4)
        if rings[ring][0] > 0.0
    ]
    return Skin(points, faces, np.vstack(edges), "solid")


def _box_loop(solid: Solid, around: list[int]) -> FloatArray:
    """Return the corners ``(4, 2)`` of a block's section, counterclockwise."""
    if not isinstance(solid, Box | Plate):
        raise ValueError("only a block or a tube has one section")
    low = np.array([-solid.size[0] / 2, -solid.size[1] / 2, 0.0])[around]
    high = np.array([solid.size[0] / 2, solid.size[1] / 2, solid.size[2]])[around]
    return np.array([[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]])


def _round_loops(tube: Tube) -> list[FloatArray]:
    """Return the outer circle and, where there is a bore, inner circle ``(SIDES, 2)``,
    counterclockwise.
    """
    angles = 2.0 * np.pi * np.arange(SIDES) / SIDES
    circle = np.column_stack([np.cos(angles), np.sin(angles)])
    return [
        0.5 * diameter * circle
        for diameter in (tube.outer_diameter, tube.inner_diameter)
        if diameter > 0.0
    ]


def _wall_triangles(rings: int, corners: int, start: int, *, outward: bool) -> IntArray:
    k = np.tile(np.arange(corners), rings - 1)
    level = np.repeat(np.arange(rings - 1), corners) * corners + start
    after = (k + 1) % corners
    a, b, c, d = level + k, level + after, level + corners + after, level + corners + k
    quads = np.vstack([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    return quads if outward else quads[:, ::-1]


def _cap_triangles(starts: list[int], ring: int, corners: int, *, upward: bool) -> IntArray:
    """Return an end face: a fan, or the ring between two loops."""
    if len(starts) == 1:
        k = np.arange(1, corners - 1)
        fan = ring + np.column_stack([np.zeros_like(k), k, k + 1])
    else:
        k, outer, inner = np.arange(corners), starts[0] + ring, starts[1] + ring
        after = (k + 1) % corners
        fan = np.vstack(
            [
                np.column_stack([outer + k, outer + after, inner + after]),
                np.column_stack([outer + k, inner + after, inner + k]),
            ]
        )
    return fan if upward else fan[:, ::-1]
