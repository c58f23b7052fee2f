"""Surfaces with fewer triangles, for pictures that are to stay small: closed ones stay closed and
keep their sharp edges.
"""

from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import BoolArray, FloatArray
from headstock.geometry.parts.skins import IntArray, Skin

# an edge of this many metres costs as much as a surface that is one metre off: flat walls keep
# points with which they can bend
LENGTH_WEIGHT = 0.02
# triangles may turn by this much in one collapse
TURN_COSINE = 0.35
# height over longest side below which a triangle counts as a sliver; one may become a sliver only
# where it was about one before
SLIVER, SLIVER_GROWTH = 0.04, 0.5
# of the vertices that may go, the share tried in one round: less is nearer to one at a time and
# slower
TRIED_SHARE = 0.35
PASSES = 8


@dataclass(frozen=True, eq=False)
class _Fan:
    """Triangles around each vertex: those of vertex ``v`` are ``owners[starts[v]:starts[v + 1]]``,
    with the next two corners.

    Attributes:
        starts: ``(n + 1,)``.
        nexts: ``(3 m, 2)`` the other two corners of each, in the order of the triangle.
    """

    starts: IntArray
    nexts: IntArray


def decimate_skin(skin: Skin, *, largest: int) -> tuple[Skin, IntArray]:
    """Fewer triangles by pulling points into neighbours, those first whose loss changes the surface
    least.

    Points stay where they are, so that fields known at the points are known at those that are left.
    A closed surface without edges of more than two triangles stays one: a point is pulled into
    another only where the two have no neighbours in common but those of their two triangles. A
    point of a sharp edge is pulled along that edge only, a corner never; where that leaves too many
    triangles, both may go like others. Points of open edges and of edges with more than two
    triangles stay.

    Args:
        skin: The surface.
        largest: How many triangles there may be.

    Returns:
        The surface, and which of its points were kept; the same surface where it is small enough.

    Source: Garland and Heckbert (1997), quadric error metrics; Dey et al. (1999), link condition.
    """
    if len(skin.triangles) <= largest:
        return skin, np.arange(len(skin.points))
    triangles, edges = skin.triangles, np.sort(skin.edges, axis=1)
    quadrics, share, keeps_lines = _quadrics(skin.points, triangles), TRIED_SHARE, True
    while len(triangles) > largest:
        pairs = _choose(
            skin.points, triangles, edges, quadrics, share=share, keeps_lines=keeps_lines
        )
        pairs = pairs[: max(1, (len(triangles) - largest + 1) // 2)]
        if len(pairs):
            target = np.arange(len(skin.points))
            target[pairs[:, 0]] = pairs[:, 1]
            np.add.at(quadrics, pairs[:, 1], quadrics[pairs[:, 0]])
            triangles, edges = (
                _whole(target[triangles]),
                np.unique(_whole(np.sort(target[edges], axis=1)), axis=0),
            )
            share = TRIED_SHARE
        elif share < 1.0:
            share = 1.0
        elif keeps_lines:
            share, keeps_lines = TRIED_SHARE, False
        else:
            break
    kept, flat = np.unique(triangles, return_inverse=True)
    numbers = np.full(len(skin.points), -1)
    numbers[kept] = np.arange(len(kept))
    nodes = None if skin.nodes is None else skin.nodes[kept]
    whole = skin.thinned_from or len(skin.triangles)
    drawn = Skin(skin.points[kept], flat.reshape(-1, 3), numbers[edges], skin.source, nodes, whole)
    return drawn, kept


def _choose(
    points: FloatArray,
    triangles: IntArray,
    edges: IntArray,
    quadrics: FloatArray,
    *,
    share: float,
    keeps_lines: bool,
) -> IntArray:
    """Pairs ``(k, 2)`` from, to of points, cheapest first, none of which is near enough to another
    to disturb it.
    """
    count = len(points)
    fan = _fans(triangles, count)
    ways = np.column_stack([np.repeat(np.arange(count), np.diff(fan.starts)), fan.nexts[:, 0]])
    forth, back = ways @ [count, 1], ways @ [1, count]
    keys = np.sort(forth)
    allowed: BoolArray = np.ones(len(ways), dtype=bool)
    repeated = keys[1:][keys[1:] == keys[:-1]]
    # an edge of two triangles with one orientation has one way there and one back
    if len(repeated) or not np.array_equal(keys, np.sort(back)):
        bad = ~_contains(keys, back) | np.isin(forth, repeated) | np.isin(back, repeated)
        allowed = ~np.isin(ways[:, 0], ways[bad])
    if keeps_lines:
        lines = np.bincount(edges.ravel(), minlength=count)[ways[:, 0]]
        along = np.isin(np.sort(ways, axis=1) @ [count, 1], edges @ [count, 1])
        allowed &= (lines == 0) | ((lines == 2) & along)
    ways = ways[allowed]
    cost = _costs(points, quadrics, ways)
    if not len(ways):
        return ways
    limit = np.quantile(cost, share) if share < 1.0 else np.inf
    ways, cost = ways[cost <= limit], cost[cost <= limit]
    good = _keeps_topology(fan, keys, count, ways)
    ways, cost = ways[good], cost[good]
    good = _keeps_shape(points, fan, ways)
    ways, cost = ways[good], cost[good]
    order = np.argsort(cost, kind="stable")
    ways = ways[order]
    _, first = np.unique(ways[:, 0], return_index=True)
    return _apart(fan, ways[np.sort(first)], count)


def _quadrics(points: FloatArray, triangles: IntArray) -> FloatArray:
    """Per point ``(n, 11)``: area-weighted squares of the planes of its triangles, upper half of
    ``(4, 4)``, and their area.
    """
    corners = points[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    normals /= np.where(lengths > 0.0, lengths, 1.0)[:, None]
    planes = np.column_stack([normals, -np.einsum("ij,ij->i", normals, corners[:, 0])])
    rows, columns = np.triu_indices(4)
    squares = np.column_stack([planes[:, rows] * planes[:, columns], np.ones(len(planes))]) * (
        0.5 * lengths[:, None]
    )
    found = np.zeros((len(points), squares.shape[1]))
    for corner in range(3):
        np.add.at(found, triangles[:, corner], squares)
    return found


def _costs(points: FloatArray, quadrics: FloatArray, ways: IntArray) -> FloatArray:
    """What pulling ``ways[:, 0]`` into ``ways[:, 1]`` costs: squared distances to the planes times
    their areas.
    """
    places = np.column_stack([points[ways[:, 1]], np.ones(len(ways))])
    rows, columns = np.triu_indices(4)
    twice = np.where(rows == columns, 1.0, 2.0)
    products = places[:, rows] * places[:, columns] * twice
    both = quadrics[ways[:, 0]] + quadrics[ways[:, 1]]
    lengths = np.linalg.norm(points[ways[:, 1]] - points[ways[:, 0]], axis=1)
    distances = np.maximum(np.einsum("ij,ij->i", both[:, :10], products), 0.0)
    return np.asarray(distances + both[:, 10] * (LENGTH_WEIGHT * lengths) ** 2)


def _keeps_topology(fan: _Fan, keys: IntArray, count: int, ways: IntArray) -> BoolArray:
    """Ways whose two points have exactly two neighbours in common and are no part of a
    tetrahedron.
    """
    owner, near = _around(fan, ways[:, 0])
    common = np.bincount(
        owner, _contains(keys, near[:, 0] * count + ways[owner, 1]), minlength=len(ways)
    )
    valence = np.diff(fan.starts)
    return np.asarray((common == 2) & (valence[ways[:, 0]] + valence[ways[:, 1]] >= 7))


def _keeps_shape(points: FloatArray, fan: _Fan, ways: IntArray) -> BoolArray:
    """Ways after which no triangle has turned over or become a sliver."""
    owner, near = _around(fan, ways[:, 0])
    stays = (near != ways[owner, 1][:, None]).all(axis=1)
    owner, near = owner[stays], near[stays]
    first, second = points[near[:, 0]], points[near[:, 1]]
    side = second - first
    old, new = (np.cross(side, points[ways[owner, end]] - first) for end in (0, 1))
    old_size, new_size = np.linalg.norm(old, axis=1), np.linalg.norm(new, axis=1)
    turned = np.einsum("ij,ij->i", old, new) < TURN_COSINE * old_size * new_size
    heights = []
    for size, end in ((old_size, 0), (new_size, 1)):
        apex = points[ways[owner, end]]
        longest = np.max(
            [np.einsum("ij,ij->i", arm, arm) for arm in (side, apex - first, apex - second)], axis=0
        )
        heights.append(size / np.where(longest > 0.0, longest, 1.0))
    sliver = heights[1] < np.minimum(SLIVER, SLIVER_GROWTH * heights[0])
    return np.asarray(np.bincount(owner, turned | sliver, minlength=len(ways)) == 0)


def _apart(fan: _Fan, ways: IntArray, count: int) -> IntArray:
    """Some of the ways, in the same order, such that the neighbourhoods of the points that go do
    not meet.
    """
    chosen = np.zeros(len(ways), dtype=bool)
    taken, left = np.zeros(count, dtype=bool), np.arange(len(ways))
    for _ in range(PASSES):
        owner, near = _around(fan, ways[left, 0])
        members = np.concatenate([near[:, 0], ways[left, 0]])
        numbers = np.concatenate([owner, np.arange(len(left))])
        free = np.bincount(numbers, taken[members], minlength=len(left)) == 0
        usable = free[numbers]
        members, numbers = members[usable], numbers[usable]
        foremost = np.full(count, len(left))
        np.minimum.at(foremost, members, numbers)
        wins = (np.bincount(numbers, foremost[members] != numbers, minlength=len(left)) == 0) & free
        chosen[left[wins]] = True
        taken[members[wins[numbers]]] = True
        left = left[free & ~wins]
    return np.asarray(ways[chosen])


def _fans(triangles: IntArray, count: int) -> _Fan:
    apexes = triangles.T.ravel()
    nexts = np.vstack([triangles[:, [1, 2]], triangles[:, [2, 0]], triangles[:, [0, 1]]])
    order = np.argsort(apexes, kind="stable")
    return _Fan(
        np.concatenate([[0], np.cumsum(np.bincount(apexes, minlength=count))]), nexts[order]
    )


def _around(fan: _Fan, vertices: IntArray) -> tuple[IntArray, IntArray]:
    """Every triangle around every vertex: position of the vertex ``(k,)``, and the other two
    corners ``(k, 2)``.
    """
    sizes = fan.starts[vertices + 1] - fan.starts[vertices]
    owner = np.repeat(np.arange(len(vertices)), sizes)
    within = np.arange(len(owner)) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    return owner, fan.nexts[np.repeat(fan.starts[vertices], sizes) + within]


def _contains(ordered: IntArray, wanted: IntArray) -> BoolArray:
    places = np.minimum(np.searchsorted(ordered, wanted), len(ordered) - 1)
    return np.asarray(ordered[places] == wanted)


def _whole(simplices: IntArray) -> IntArray:
    """Triangles or edges without those that shrank."""
    return np.asarray(simplices[np.all(simplices != np.roll(simplices, 1, axis=1), axis=1)])
