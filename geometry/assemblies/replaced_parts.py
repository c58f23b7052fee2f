"""A part whose shape has changed: where it was, and which of its new faces its old ones are."""

import itertools
from collections.abc import Iterator, Sequence

import numpy as np

from headstock.geometry.assemblies.equal_solids import IDENTITY, Motion, point_frame
from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.cad_faces import CadFace

SAME_PLACE = 1e-5  # of surfaces, and of the middles of faces that did not change [m]
SAME_SIZE = 1e-5  # relative, of their areas
SAME_DIRECTION = 1e-6  # 1 - cosine
RAREST = 9  # faces of which threes are tried
COLLINEAR = 1e-2  # height over side of three middles on a line
HALF = 0.5  # of the faces that stay where they are show that the part was not moved


def find_old_position(old: Sequence[CadFace], new: Sequence[CadFace]) -> Motion:
    """Find the motion that brings a new part to where the old one is: the identity where at least
    half of the old faces are there already, else that under which most faces lie on old ones.
    """
    middles = [np.array([face.center for face in faces]) for faces in (old, new)]
    pairs = _pair_sizes(old, new)
    if _count_middles(middles, pairs, IDENTITY) >= HALF * len(old):
        return IDENTITY
    planes = [_list_planes(faces) for faces in (old, new)]

    def score(motion: Motion) -> int:
        # symmetric middles leave several motions; planes that became larger or smaller decide
        return _count_middles(middles, pairs, motion) + _count_planes(planes, motion)

    return max([IDENTITY, *_propose(middles, pairs)], key=score)


def find_faces_again(old: Sequence[CadFace], new: Sequence[CadFace]) -> dict[int, tuple[int, ...]]:
    """Find the faces of a new part at the place of the old ones.

    Returns:
        For each old face by number the same face of the new part, or else all on the same plane or
        cylinder that overlap it; empty where there is none.
    """
    again: dict[int, tuple[int, ...]] = {}
    for face in old:
        on_it = [other for other in new if _lie_together(face, other)]
        same = [other for other in on_it if _is_same(face, other)]
        again[face.number] = tuple(other.number for other in same or on_it)
    return again


def _lie_together(one: CadFace, other: CadFace) -> bool:
    """Return whether two faces lie on one plane or cylinder and overlap; others are the same."""
    if one.kind != other.kind:
        return False
    if one.kind not in ("plane", "cylinder"):
        return _is_same(one, other)
    low = np.maximum(one.low, other.low)
    high = np.minimum(one.high, other.high)
    gaps = low - high
    # flat boxes overlap in a line at least, which neighbours share: the second side decides
    if (gaps > SAME_PLACE).any() or np.sort(-gaps)[1] <= SAME_PLACE:
        return False
    if one.kind == "plane":
        apart = np.subtract(other.center, one.center) @ one.normal
        return _cosine(one.normal, other.normal) > 1.0 - SAME_DIRECTION and abs(apart) <= SAME_PLACE
    across = np.subtract(other.axis_point, one.axis_point)
    across = across - (across @ one.axis) * np.array(one.axis)
    return (
        one.hollow == other.hollow
        and abs(one.radius - other.radius) <= SAME_PLACE
        and abs(_cosine(one.axis, other.axis)) > 1.0 - SAME_DIRECTION
        and float(np.linalg.norm(across)) <= SAME_PLACE
    )


def _is_same(one: CadFace, other: CadFace) -> bool:
    apart = np.subtract(one.center, other.center)
    return float(np.linalg.norm(apart)) <= SAME_PLACE and _is_as_large(one, other)


def _is_as_large(one: CadFace, other: CadFace) -> bool:
    return one.kind == other.kind and abs(one.area - other.area) <= SAME_SIZE * one.area


def _cosine(one: Sequence[float], other: Sequence[float]) -> float:
    return float(np.dot(one, other))


def _pair_sizes(old: Sequence[CadFace], new: Sequence[CadFace]) -> dict[int, list[int]]:
    """Return for each old face, by index, the new ones of its kind and area."""
    pairs = {
        i: [j for j, other in enumerate(new) if _is_as_large(face, other)]
        for i, face in enumerate(old)
    }
    return {i: others for i, others in pairs.items() if others}


def _count_middles(
    middles: Sequence[FloatArray], pairs: dict[int, list[int]], motion: Motion
) -> int:
    """Return how many old middles a new one of the same size lies at after a motion."""
    old, new = middles
    moved = new @ motion.rotation.T + motion.shift
    return sum(
        float(np.linalg.norm(moved[others] - old[i], axis=1).min()) <= SAME_PLACE
        for i, others in pairs.items()
    )


def _list_planes(faces: Sequence[CadFace]) -> tuple[FloatArray, FloatArray]:
    """Return the normals ``(n, 3)`` of plane faces and their distances from the origin ``(n,)`` [m]."""
    normals = np.array([face.normal for face in faces if face.kind == "plane"]).reshape(-1, 3)
    middles = np.array([face.center for face in faces if face.kind == "plane"]).reshape(-1, 3)
    return normals, np.einsum("ij,ij->i", normals, middles)


def _count_planes(planes: Sequence[tuple[FloatArray, FloatArray]], motion: Motion) -> int:
    """Return on how many old planes a new one lies after a motion."""
    (old, heights), (normals, distances) = planes
    moved = normals @ motion.rotation.T
    parallel = old @ moved.T > 1.0 - SAME_DIRECTION
    apart = np.abs(heights[:, None] - (distances + moved @ motion.shift))
    return int((parallel & (apart <= SAME_PLACE)).any(axis=1).sum())


def _propose(middles: Sequence[FloatArray], pairs: dict[int, list[int]]) -> Iterator[Motion]:
    """Yield the motions that bring three new middles to old ones, of sizes that few faces have."""
    old, new = middles
    rarest = sorted(pairs, key=lambda i: len(pairs[i]))[:RAREST]
    for three in itertools.combinations(rarest, 3):
        a, b, c = old[list(three)]
        normal = np.cross(b - a, c - a)
        if np.linalg.norm(normal) < COLLINEAR * np.linalg.norm(b - a) ** 2:
            continue
        sides = [np.linalg.norm(b - a), np.linalg.norm(c - a), np.linalg.norm(c - b)]
        for others in itertools.islice(itertools.product(*(pairs[i] for i in three)), 64):
            p, q, r = new[list(others)]
            lengths = [np.linalg.norm(q - p), np.linalg.norm(r - p), np.linalg.norm(r - q)]
            if np.abs(np.subtract(sides, lengths)).max() <= SAME_PLACE:
                rotation = point_frame(b - a, c - a) @ point_frame(q - p, r - p).T
                yield Motion(rotation, a - rotation @ p, 0.0)
