"""Motions that the contacts of two solids leave free, and the joint that the pair may be."""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from headstock.geometry.assemblies.contacts import Contact
from headstock.geometry.assemblies.parts import Assembly
from headstock.geometry.frames import FloatArray, find_axis
from headstock.geometry.parts.cad_faces import Vector
from headstock.geometry.parts.plane_shapes import plane_axes

JointGuess = Literal["bonded", "guide", "bearing", "screw", "fit"]

BLOCKED = 1e-3  # singular values of wrenches and normals, over the largest: what blocks a motion
PITCHLESS = 1e-3  # advance of a rotation over the extent of its contacts
OPPOSITE = 1e-3  # 1 + cosine between walls that face each other
ROUND_POINTS = 8  # around each end of a cylinder
SMALL = 0.2  # volume of a screw or dowel over that of either solid it holds together
SHORT = 0.6  # overlap of a guide along its motion, over the length of the rail
COAXIAL = 1e-4  # distance of axes of one ring [m]
DIGITS = 12  # of directions and points [m]
ALIKE = 2  # digits to which contacts of equal pairs agree
WORDS = {
    "guide": r"rail|schiene|guideway|führung|carriage|wagen|runner",
    "bearing": r"bearing|lager",
    "screw": r"ball.?screw|lead.?screw|feed.?screw|kugelgewinde|gewindetrieb|kgt",
    "fit": r"dowel|\bpin\b|stift",
}


@dataclass(frozen=True)
class PairMotion:
    """A pair of solids that touch: what they can still do, and which joint it may be.

    Attributes:
        solids: Numbers of the solids, the smaller first.
        contacts: Indices of their contacts.
        slides: Orthonormal directions that no normal blocks: none, one or two.
        turns: A point [m] and the direction of each axis that it may turn about.
        likely: The joint that geometry, names and repetition speak for: ``bonded`` where nothing
            speaks against it; a ``guide``; a ``bearing``; a ``screw`` that drives an axis; the ``fit``
            of a pin or shaft in its bore.
        reason: Why, in words of geometry.
    """

    solids: tuple[int, int]
    contacts: tuple[int, ...]
    slides: tuple[Vector, ...]
    turns: tuple[tuple[Vector, Vector], ...]
    likely: JointGuess
    reason: str


@dataclass(frozen=True)
class _Pair:
    """A pair with what surrounds it.

    Attributes:
        words: Names of both solids, in lower case.
        fasteners: Small solids that hold on to both.
        equal: Pairs like this one, itself included.
        ring: Whether one solid is a ring of which this is the inner or the outer cylinder; None for
            no ring.
        rail: Share of the longer solid's length over which the other embraces it; None where it
            does not.
    """

    contacts: tuple[Contact, ...]
    slides: tuple[Vector, ...]
    turns: tuple[tuple[Vector, Vector], ...]
    words: str
    fasteners: int
    equal: int
    ring: Literal["inner", "outer"] | None
    rail: float | None


def find_pair_motions(assembly: Assembly, contacts: Sequence[Contact]) -> tuple[PairMotion, ...]:
    """Find what each pair of solids that touch can still do, and which joint it may be."""
    solids = {solid.number: solid for solid in assembly.solids}
    volumes = {number: solid.volume for number, solid in solids.items()}
    words = {
        number: " ".join((solid.product, *solid.names[-1:])).lower()
        for number, solid in solids.items()
    }
    indices: dict[tuple[int, int], list[int]] = {}
    for i, contact in enumerate(contacts):
        indices.setdefault(contact.solids, []).append(i)
    touching = {pair: tuple(contacts[i] for i in rows) for pair, rows in indices.items()}
    groups = group_equal_pairs(assembly, contacts)
    sizes = {pair: len(group) for group in groups for pair in group}
    motions = []
    for pair, members in touching.items():
        slides, turns = free_motions(members)
        evidence = _Pair(
            members,
            slides,
            turns,
            " ".join(words[number] for number in pair),
            _count_fasteners(pair, touching, volumes),
            sizes[pair],
            _find_ring(pair, touching),
            _share_of_rail(
                members, slides, *(np.subtract(solids[n].high, solids[n].low) for n in pair)
            ),
        )
        likely, reason = _guess_joint(evidence)
        if evidence.equal > 1:
            reason += f"; {evidence.equal} equal pairs"
        motions.append(PairMotion(pair, tuple(indices[pair]), slides, turns, likely, reason))
    return tuple(motions)


def free_motions(
    contacts: Sequence[Contact],
) -> tuple[tuple[Vector, ...], tuple[tuple[Vector, Vector], ...]]:
    """Return the directions in which two solids can slide, and the axes about which they can turn,
    without a part of their contacts opening or closing.

    A motion ``(v, w)`` is free where it does no work against a unit force along any normal: ``n v +
    (p x n) w = 0``.

    Source: Ohwovoriole and Roth (1981), An extension of screw theory.
    """
    points, normals = (
        np.concatenate(arrays) for arrays in zip(*map(_sample, contacts), strict=True)
    )
    origin = np.average(
        [contact.center for contact in contacts], axis=0, weights=[one.area for one in contacts]
    )
    scale = float(np.linalg.norm(points - origin, axis=1).max())
    wrenches = np.hstack([normals, np.cross((points - origin) / scale, normals)])
    slides = _null_space(normals)
    if len(slides) == 2:
        slides = plane_axes(np.cross(*slides))
    free = _null_space(wrenches)
    turns = []
    _, sizes, shapes = np.linalg.svd(free[:, 3:])
    for shape in shapes[: int((sizes > BLOCKED).sum())]:
        motion = (free[:, 3:] @ shape) @ free
        velocity, rotation = np.split(motion / np.linalg.norm(motion[3:]), 2)
        velocity = velocity - (velocity @ slides.T) @ slides
        if abs(float(velocity @ rotation)) <= PITCHLESS:
            axis = _point_ahead(rotation)
            at = origin + scale * np.cross(rotation, velocity)
            turns.append((_vector(at), _vector(axis)))
    return tuple(_vector(_point_ahead(slide)) for slide in slides), tuple(turns)


def group_equal_pairs(
    assembly: Assembly, contacts: Sequence[Contact]
) -> tuple[tuple[tuple[int, int], ...], ...]:
    """Group the pairs of solids of the same parts that touch in the same way, wherever along a guide
    they do.
    """
    parts = {one.solid: part.name for part in assembly.parts for one in part.placements}
    signatures: dict[tuple[int, int], list[tuple[object, ...]]] = {}
    for contact in contacts:
        sizes = (f"{contact.area:.{ALIKE}e}", round(contact.gap, 5), contact.wide)
        signatures.setdefault(contact.solids, []).append((contact.kind, *sizes))
    groups: dict[object, list[tuple[int, int]]] = {}
    for pair, signature in signatures.items():
        names = tuple(sorted(parts[number] for number in pair))
        key = (names, tuple(sorted(signature, key=str)))
        groups.setdefault(key, []).append(pair)
    return tuple(map(tuple, groups.values()))


def _sample(contact: Contact) -> tuple[FloatArray, FloatArray]:
    """Return points of a contact and its normals there, ``(n, 3)`` each."""
    axis, center = np.array(contact.axis), np.array(contact.center)
    if contact.kind == "plane":
        points = np.concatenate(contact.outlines)
        return points, np.broadcast_to(axis, points.shape)
    angles = 2.0 * np.pi * np.arange(ROUND_POINTS) / ROUND_POINTS
    normals = np.column_stack([np.cos(angles), np.sin(angles)]) @ plane_axes(axis)
    half = 0.5 * (contact.length or 0.0) * axis
    ends = [center + end + (contact.radius or 0.0) * normals for end in (-half, half)]
    return np.concatenate(ends), np.vstack([normals, normals])


def _null_space(rows: FloatArray) -> FloatArray:
    """Return an orthonormal basis ``(k, n)`` of what rows ``(m, n)`` leave free."""
    _, sizes, shapes = np.linalg.svd(rows, full_matrices=True)
    return np.asarray(shapes[int((sizes > BLOCKED * sizes[0]).sum()) :])


def _count_fasteners(
    pair: tuple[int, int],
    touching: Mapping[tuple[int, int], Sequence[Contact]],
    volumes: Mapping[int, float],
) -> int:
    """Count the small round solids that hold on to both of a pair."""
    holders: Counter[int] = Counter()
    for one, other in touching:
        for inner, outer in ((one, other), (other, one)):
            if outer in pair and inner not in pair:
                holders[inner] += 1
    smallest = min(volumes[number] for number in pair)
    return sum(
        count == 2
        and volumes[number] < SMALL * smallest
        and any(
            contact.kind == "cylinder"
            for outer in pair
            for contact in touching[min(number, outer), max(number, outer)]
        )
        for number, count in holders.items()
    )


def _find_ring(
    pair: tuple[int, int], touching: Mapping[tuple[int, int], Sequence[Contact]]
) -> Literal["inner", "outer"] | None:
    """Return which side of a ring a pair is whose one solid has another cylinder around the same
    axis.
    """
    for contact in touching[pair]:
        for other, members in touching.items():
            if other == pair or not {*other} & {*pair} or contact.kind == "plane":
                continue
            for one in members:
                if one.kind == "cylinder" and _share_axis(contact, one):
                    inner, outer = contact.radius or 0.0, one.radius or 0.0
                    if abs(inner - outer) > COAXIAL:
                        return "inner" if inner < outer else "outer"
    return None


def _share_axis(one: Contact, other: Contact) -> bool:
    """Return whether two cylinders lie around one axis and overlap along it."""
    axis = np.array(one.axis)
    offset = np.subtract(one.center, other.center)
    along = float(offset @ axis)
    reach = 0.5 * ((one.length or 0.0) + (other.length or 0.0))
    parallel = abs(float(axis @ np.array(other.axis))) > 1.0 - OPPOSITE
    return (
        parallel and float(np.linalg.norm(offset - along * axis)) <= COAXIAL and abs(along) < reach
    )


def _share_of_rail(
    contacts: Sequence[Contact], slides: Sequence[Vector], size: FloatArray, other: FloatArray
) -> float | None:
    """Return over which share of its length along the only slide a solid is embraced by the other;
    None where none is.

    Args:
        size: Sides of the bounding box of the first solid, ``(3,)`` [m].
        other: Of the second.
    """
    planes = [contact for contact in contacts if contact.kind == "plane"]
    if len(slides) != 1 or len(planes) < 3:
        return None
    slide = np.array(slides[0])
    normals = np.array([contact.axis for contact in planes])
    centers = np.array([contact.center for contact in planes])
    walls = np.argwhere(normals @ normals.T < OPPOSITE - 1.0)
    if not len(walls):
        return None
    a, b = walls[0]
    # normals that point out of the first solid point away from each other where it is between
    rail = size if float((centers[a] - centers[b]) @ normals[a]) > 0.0 else other
    overlap = np.ptp(np.concatenate(planes[a].outlines) @ slide)
    return float(overlap / (np.abs(slide) @ rail))


def _guess_joint(pair: _Pair) -> tuple[JointGuess, str]:
    """Return the joint that a pair may be, and why: what could move is bonded, or fits, unless
    something besides geometry says that it does move.
    """
    named = {kind: re.search(words, pair.words) for kind, words in WORDS.items()}
    if pair.fasteners:
        several = (
            f"{pair.fasteners} screws or pins hold"
            if pair.fasteners > 1
            else "a screw or pin holds"
        )
        return "bonded", f"{several} on to both"
    if len(pair.slides) == 2:
        return "bonded", "they touch on one plane"
    if not pair.slides and not pair.turns:
        return "bonded", "their contacts block every motion"
    if not pair.turns:
        return _guess_guide(pair, named=named["guide"] is not None)
    axis = _format_direction(pair.turns[0][1])
    free = f"a cylinder leaves them free to turn{' and slide' if pair.slides else ''} about {axis}"
    if named["screw"]:
        return "screw", f"{free}, and it is called a {named['screw'][0]}"
    if named["bearing"] and pair.ring != "outer":
        return "bearing", f"{free}, and it is called a {named['bearing'][0]}"
    if named["bearing"]:
        return "fit", f"{free}, but it is the outer ring of a bearing in its seat"
    if named["fit"]:
        return "fit", f"{free}, and it is called a {named['fit'][0]}"
    if pair.ring:
        return "fit", f"{free}; a ring around a shaft is a bearing, a bushing or a spacer"
    return "fit", f"{free}; the seat of a bearing and a pin in its hole look the same"


def _guess_guide(pair: _Pair, *, named: bool) -> tuple[JointGuess, str]:
    """Return whether a pair that can slide in one direction is a guide, and why."""
    count = len({tuple(np.round(contact.axis, 3)) for contact in pair.contacts})
    free = f"faces on {count} sides leave {_format_direction(pair.slides[0])} free"
    air = max((contact.gap for contact in pair.contacts if contact.wide), default=0.0)
    if pair.rail is None:
        return "bonded", f"{free}, but nothing embraces the other: a rail on a shoulder looks so"
    if pair.rail > SHORT:
        return "bonded", f"{free}, but over all its length: a key in its groove looks so"
    if air:
        return "guide", f"{free} with {1e3 * air:.3g} mm of air"
    if named or pair.equal > 1:
        return "guide", f"{free} along a longer rail"
    return "bonded", f"{free} along a longer rail, but there is only one such pair"


def _format_direction(vector: Vector) -> str:
    if axis := find_axis(vector, 1e-6):
        return axis[0]
    return f"({', '.join(f'{value:.3g}' for value in vector)})"


def _point_ahead(vector: FloatArray) -> FloatArray:
    """Return a direction either way so that its largest component is positive."""
    return np.asarray(vector * np.sign(vector[int(np.argmax(np.abs(vector)))]))


def _vector(values: FloatArray) -> Vector:
    x, y, z = (float(value) for value in np.round(values, DIGITS) + 0.0)
    return x, y, z
