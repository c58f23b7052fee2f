"""Points of a test on the surfaces of a machine: best fit by a rigid motion, nearest place, distance."""

import dataclasses
import itertools
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy.spatial
from scipy.spatial.transform import Rotation

from headstock.geometry.frames import FloatArray, Frame, rotation_about
from headstock.geometry.parts.nearest_places import find_nearest_in_triangles
from headstock.geometry.parts.skins import IntArray, Skin
from headstock.scene.test_data.errors import MeasurementError
from headstock.scene.test_data.records import TestPoint

CLOSE = 0.005  # of the machine's size: points as near as this are taken where the file has them
FAR = 0.03  # of its size: points that stay as far away are those of another machine
TRIMMED = 0.8  # share of the points that a fit counts: some stand on what is not modelled
OTHER_UNITS = {
    1e-3: "mm read as m",
    1e3: "m read as mm",
    0.0254: "inches read as m",
    1 / 0.0254: "m read as inches",
}
TRIES, ROUNDS = 12, 60  # steps of a fit from each start, and of the best ones
KEPT = 4
SMALL = 1e-6  # of the largest singular value: motions that the planes leave open
MOST_NAMED = 8  # points far from all components
AS_GOOD = 1.1  # times the rms distance of the best fit: then it is a rival


@dataclass(frozen=True, eq=False)
class _Class:
    """Triangles of about one size, by their middles."""

    tree: scipy.spatial.cKDTree
    triangles: IntArray
    radius: float


class _MachineSurface:
    """Triangles of components where they stand in a machine.

    Attributes:
        owners: ``(t,)`` index of the component of each triangle.
        normals: ``(t, 3)`` of each triangle; zero of one without area.
        size: Diagonal of the box around all of them [m].
        middle: ``(3,)`` of that box [m].
    """

    def __init__(self, skins: Mapping[str, Skin], frames: Mapping[str, Frame]) -> None:
        self.names = tuple(skins)
        corners = [
            frames[name].origin + (skin.points[skin.triangles] @ frames[name].rotation.T)
            for name, skin in skins.items()
        ]
        self.owners = np.repeat(np.arange(len(corners)), [len(each) for each in corners])
        self._corners = np.concatenate(corners)
        across = np.cross(*np.moveaxis(np.diff(self._corners, axis=1), 1, 0))
        areas = np.linalg.norm(across, axis=1, keepdims=True)
        self.normals = across / np.where(areas > 0.0, areas, 1.0)
        low, high = self._corners.min(axis=(0, 1)), self._corners.max(axis=(0, 1))
        self.size = float(np.linalg.norm(high - low))
        self.middle = 0.5 * (low + high)
        middles = self._corners.mean(axis=1)
        radii = np.linalg.norm(self._corners - middles[:, None], axis=2).max(axis=1)
        # one tree per octave: a few large triangles must not widen the search among small ones
        octaves = np.floor(np.log2(np.maximum(radii, 1e-9 * self.size))).astype(int)
        self._classes = [
            _Class(scipy.spatial.cKDTree(middles[which]), which, float(radii[which].max()))
            for which in (np.flatnonzero(octaves == octave) for octave in np.unique(octaves))
        ]

    def nearest(self, places: FloatArray) -> tuple[FloatArray, FloatArray, IntArray]:
        """Find the nearest place ``(n, 3)``, its distance ``(n,)`` [m] and its triangle ``(n,)``.

        Args:
            places: ``(n, 3)`` [m].
        """
        first = [each.triangles[each.tree.query(places)[1]] for each in self._classes]
        bounds = np.min(
            [
                np.linalg.norm(
                    find_nearest_in_triangles(self._corners[which], places) - places, axis=1
                )
                for which in first
            ],
            axis=0,
        )
        # no triangle with its middle further away than this can be nearer
        points, triangles = [], []
        for each in self._classes:
            near = each.tree.query_ball_point(places, (bounds + each.radius) * (1 + 1e-9))
            counts = list(map(len, near))
            points.append(np.repeat(np.arange(len(places)), counts))
            triangles.append(each.triangles[np.concatenate(near).astype(int)])
        point, triangle = np.concatenate(points), np.concatenate(triangles)
        found = find_nearest_in_triangles(self._corners[triangle], places[point])
        distances = np.linalg.norm(found - places[point], axis=1)
        order = np.lexsort((distances, point))
        best = order[np.unique(point[order], return_index=True)[1]]
        return found[best], distances[best], triangle[best]


@dataclass(frozen=True, eq=False)
class Placement:
    """Where a test stands in the axes of a machine: ``x = rotation @ test + translation``.

    Attributes:
        rotation: ``(3, 3)``.
        translation: ``(3,)`` [m].
        rms: Distance of most points from the surface [m]; inf where nobody has measured it.
        remarks: How it was found.
    """

    rotation: FloatArray
    translation: FloatArray
    rms: float = np.inf
    remarks: tuple[str, ...] = ()

    def move(self, places: FloatArray) -> FloatArray:
        """Return places of the test ``(3,)`` or ``(n, 3)`` in the machine [m]."""
        return places @ self.rotation.T + self.translation

    def describe(self) -> str:
        """Return angle, axis and translation."""
        vector = Rotation.from_matrix(self.rotation).as_rotvec()
        angle = float(np.linalg.norm(vector))
        axis = vector / angle + 0.0 if angle > 0.0 else np.array([0.0, 0.0, 1.0])
        moved = ", ".join(f"{1e3 * value + 0.0:.4g}" for value in self.translation)
        about = ", ".join(f"{value:.3g}" for value in axis)
        return f"turned by {np.degrees(angle):.4g}° about ({about}) and moved by ({moved}) mm"


UNMOVED = Placement(np.eye(3), np.zeros(3))


def place_test(
    points: Mapping[str, TestPoint],
    skins: Mapping[str, Skin],
    frames: Mapping[str, Frame],
    matches: Mapping[str, FloatArray] | None = None,
) -> Placement:
    """Place the points of a test on the surfaces of a machine.

    They stay where the file has them if they lie close to the surfaces there. Otherwise three points
    or more whose place on the machine is known decide; without these the best fit from 25 starts.

    Args:
        points: With one at least [m].
        skins: Surface of each component in its frame.
        frames: Of these components in the machine.
        matches: Places ``(3,)`` on the machine of points that are known [m].

    Raises:
        MeasurementError: The points have another unit, or lie on no placement near the surfaces.
    """
    surface = _MachineSurface(skins, frames)
    places = np.array([point.position for point in points.values()])
    _require_unit(places, surface)
    written = _measure(surface, places, UNMOVED)
    common = [name for name in points if name in (matches or {})]
    known = np.array([points[name].position for name in common]).reshape(-1, 3)
    remarks = []
    if matches and _spans_a_plane(known):
        there = np.array([matches[name] for name in common])
        motion = _measure(surface, places, _fit_motion(known, there))
        left = np.linalg.norm(motion.move(known) - there, axis=1)
        remarks.append(
            f"points of the test are {motion.describe()}, by {len(common)} points that the scene places ({1e3 * left.max():.2g} mm at most"
            " between both)"
        )
    elif written.rms <= CLOSE * surface.size:
        motion = written
        remarks.append(
            "points of the test stand where the file has them, in the axes of the machine"
        )
    else:
        motion, rivals = _search(surface, places, written)
        remarks.append(
            f"points of the test are {motion.describe()}: the best fit to the surfaces (as written they were {1e3 * written.rms:.3g} mm away,"
            " rms of the nearest 80 %)"
        )
        if rivals:
            remarks.append(
                f"{rivals} other placements fit as well; give three sensors of the scene the names of their points to decide"
            )
    if motion.rms > FAR * surface.size:
        raise MeasurementError(
            f"the points of the test lie {1e3 * motion.rms:.3g} mm from the surfaces of the machine (rms of the nearest 80 %) wherever they are"
            " turned and moved; check the scene and its pose, or give three sensors of the scene the names of their points"
        )
    _, distances, triangles = surface.nearest(motion.move(places))
    usual = max(3.0 * motion.rms, CLOSE * surface.size)
    owners = [surface.names[owner] for owner in surface.owners[triangles]]
    far = sorted(zip(distances, points, owners, strict=True), reverse=True)[:MOST_NAMED]
    remarks += [
        f"point {name} lies {1e3 * distance:.3g} mm from the nearest component, {component}"
        for distance, name, component in far
        if distance > usual
    ]
    return dataclasses.replace(motion, remarks=tuple(remarks))


def _measure(surface: _MachineSurface, places: FloatArray, motion: Placement) -> Placement:
    distances = np.sort(surface.nearest(motion.move(places))[1])
    counted = distances[: max(1, round(TRIMMED * len(distances)))]
    return dataclasses.replace(motion, rms=float(np.sqrt((counted**2).mean())))


def _require_unit(places: FloatArray, surface: _MachineSurface) -> None:
    """Refuse points that span what no machine does, and would fit in another unit."""
    span = float(np.linalg.norm(np.ptp(places, axis=0)))
    if 1 / 20 < span / surface.size < 20:
        return
    for factor, what in OTHER_UNITS.items():
        if 0.2 < factor * span / surface.size < 1.5:
            raise MeasurementError(
                f"the points of the test span {span:.4g} m, the machine {surface.size:.4g} m: {what}? Correct set 164 of the file, or its positions"
            )


def _spans_a_plane(places: FloatArray) -> bool:
    if len(places) < 3:
        return False
    sizes = np.linalg.svd(places - places.mean(axis=0), compute_uv=False)
    return bool(sizes[1] > 1e-3 * sizes[0])


def _fit_motion(places: FloatArray, targets: FloatArray) -> Placement:
    """Find the rigid motion of places ``(n, 3)`` onto targets with the least squares.

    Source: Kabsch (1976), Acta Crystallographica A 32, 922.
    """
    middle, target = places.mean(axis=0), targets.mean(axis=0)
    u, _, vt = np.linalg.svd((places - middle).T @ (targets - target))
    hand = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    rotation = (u @ hand @ vt).T
    return Placement(rotation, target - rotation @ middle)


def _search(
    surface: _MachineSurface, places: FloatArray, written: Placement
) -> tuple[Placement, int]:
    """Fit from the file's own axes, and from those of all directions of a cube with middles of boxes
    at one place; and how many other motions fit as well.
    """
    starts = [written]
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            rotation = np.eye(3)[list(order)] * signs
            if np.linalg.det(rotation) > 0.0:
                turned = places @ rotation.T
                middle = 0.5 * (turned.min(axis=0) + turned.max(axis=0))
                starts.append(Placement(rotation, surface.middle - middle))
    tried = [_iterate(surface, places, start, TRIES) for start in starts]
    best = sorted(tried, key=lambda motion: motion.rms)[:KEPT]
    best = sorted(
        (_iterate(surface, places, motion, ROUNDS) for motion in best),
        key=lambda motion: motion.rms,
    )
    good = [motion for motion in best if motion.rms <= AS_GOOD * best[0].rms + 1e-9 * surface.size]
    # of equal ones the one that turns least
    chosen = max(good, key=lambda motion: float(np.trace(motion.rotation)))
    others = [
        motion
        for motion in good
        if np.linalg.norm(motion.move(places) - chosen.move(places), axis=1).max()
        > 10.0 * CLOSE * surface.size
    ]
    return chosen, len(others)


def _iterate(
    surface: _MachineSurface, places: FloatArray, motion: Placement, rounds: int
) -> Placement:
    """Fit points to their nearest places again and again, then to the planes there.

    Source: Besl and McKay (1992), IEEE Trans. Pattern Analysis 14, 239; planes: Chen and Medioni (1992),
    Image and Vision Computing 10, 145; trimmed: Chetverikov and others (2002).
    """
    count = max(3, round(TRIMMED * len(places)))
    best = _measure(surface, places, motion)
    for number in range(rounds):
        moved = motion.move(places)
        nearest, distances, triangles = surface.nearest(moved)
        kept = np.argsort(distances)[:count]
        if number < TRIES:
            motion = _fit_motion(places[kept], nearest[kept])
        else:
            normals = surface.normals[triangles[kept]]
            gaps = np.einsum("ij,ij->i", nearest[kept] - moved[kept], normals)
            slopes = np.concatenate([np.cross(moved[kept], normals), normals], axis=1)
            step = np.linalg.lstsq(slopes, gaps, rcond=SMALL)[0]
            angle = float(np.linalg.norm(step[:3]))
            turn = rotation_about(step[:3], angle) if angle > 0.0 else np.eye(3)
            motion = Placement(turn @ motion.rotation, turn @ motion.translation + step[3:])
        motion = _measure(surface, places, motion)
        if motion.rms < best.rms:
            best = motion
        elif number > TRIES:
            break
    return best
