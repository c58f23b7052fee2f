"""Equal solids: the motion that moved them is found, and mirrored or slightly changed ones differ."""

import dataclasses

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from common import approx
from headstock.geometry.assemblies.equal_solids import SolidPoints, find_motion, group_equal
from headstock.geometry.frames import FloatArray, rotation_about

MIRROR = np.diag([-1.0, 1.0, 1.0])
# corners of a wedge without any symmetry, and one face inside
WEDGE = np.array([[0, 0, 0], [90, 0, 0], [0, 60, 0], [0, 0, 30], [20, 15, 5]]) * 1e-3


def solid_of(points: FloatArray) -> SolidPoints:
    """Corners, of which those behind the fourth are faces of 1, 2, ... mm^2."""
    faces = np.arange(len(points)) >= 4
    sizes = np.where(faces, np.arange(len(points)) - 3.0, 0.0) * 1e-6
    return SolidPoints(1e-5, points.mean(axis=0), points, np.where(faces, 2, 0), sizes)


def moved(solid: SolidPoints, rotation: FloatArray, shift: FloatArray) -> SolidPoints:
    return dataclasses.replace(
        solid,
        points=solid.points @ rotation.T + shift,
        center=rotation @ solid.center + shift,
        rotation=rotation @ solid.rotation,
    )


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000))
def test_a_moved_solid_is_found_in_any_order_of_its_points(seed: int) -> None:
    random = np.random.default_rng(seed)
    rotation, shift = Rotation.random(random_state=seed).as_matrix(), random.normal(size=3)
    first = solid_of(WEDGE)
    second = moved(first, rotation, shift)
    order = random.permutation(len(WEDGE))
    second = dataclasses.replace(
        second,
        points=second.points[order],
        dimensions=second.dimensions[order],
        sizes=second.sizes[order],
    )
    motion = find_motion(first, second)
    assert motion is not None
    assert motion.residual < 1e-12
    assert motion.rotation == approx(rotation, abs=1e-9)
    assert motion.shift == approx(shift, abs=1e-9)
    placement = motion.placement(7)
    assert placement.solid == 7
    assert np.array(placement.rotation) == approx(rotation, abs=1e-9)


def test_a_mirrored_solid_and_one_with_its_hole_moved_by_10_um_are_others() -> None:
    first = solid_of(WEDGE)
    assert find_motion(first, moved(first, MIRROR, np.zeros(3))) is None
    for shift, equal in ((1e-5, False), (1e-8, True)):
        points = WEDGE.copy()
        points[4, 0] += shift
        motion = find_motion(first, dataclasses.replace(first, points=points))
        assert (motion is not None) is equal
    assert motion is not None
    assert 0.0 < motion.residual < 2e-8
    larger = dataclasses.replace(first, volume=1.001e-5)
    assert find_motion(first, larger) is None
    assert find_motion(first, solid_of(WEDGE[:4])) is None


def test_a_solid_that_is_its_own_mirror_image_is_found_mirrored() -> None:
    flat = WEDGE * [1.0, 1.0, 0.0]
    motion = find_motion(solid_of(flat), moved(solid_of(flat), MIRROR, np.zeros(3)))
    assert motion is not None
    assert np.linalg.det(motion.rotation) == approx(1.0)
    assert motion.residual < 1e-12


def test_a_symmetric_solid_rotates_least() -> None:
    """A square plate that was rotated by 100 degrees comes back by 10, a round one not at all about
    its axis, and a bolt that was turned over by half a turn.
    """
    z = np.array([0.0, 0.0, 1.0])
    square = np.array([[x, y, 0.0] for x in (-0.1, 0.1) for y in (-0.1, 0.1)])
    motion = find_motion(
        solid_of(square), moved(solid_of(square), rotation_about(z, np.radians(100)), z)
    )
    assert motion is not None
    assert motion.rotation == approx(rotation_about(z, np.radians(10)), abs=1e-9)
    line = np.array([[0.0, 0.0, h] for h in (0.0, 0.0, 0.0, 0.0, 0.02, 0.05)])
    turned = rotation_about(z, 1.0) @ rotation_about(np.array([1.0, 0.0, 0.0]), np.pi)
    motion = find_motion(solid_of(line), moved(solid_of(line), turned, z))
    assert motion is not None
    assert np.trace(motion.rotation) == approx(-1.0)
    assert motion.residual < 1e-12
    tilted = rotation_about(np.array([1.0, 1.0, 0.0]), 0.7) @ rotation_about(z, 2.0)
    motion = find_motion(solid_of(line), moved(solid_of(line), tilted, z))
    assert motion is not None
    assert motion.rotation == approx(rotation_about(np.array([1.0, 1.0, 0.0]), 0.7), abs=1e-9)


def test_a_rotation_that_the_tree_states_counts_where_it_fits() -> None:
    z = np.array([0.0, 0.0, 1.0])
    square = np.array([[x, y, 0.0] for x in (-0.1, 0.1) for y in (-0.1, 0.1)])
    first = dataclasses.replace(solid_of(square), product=3, rotation=np.eye(3))
    quarter = rotation_about(z, np.pi / 2)
    second = moved(first, quarter, z)
    motion = find_motion(first, second)
    assert motion is not None
    assert motion.rotation == approx(quarter, abs=1e-9)
    wrong = dataclasses.replace(second, rotation=rotation_about(z, 0.3))
    other = dataclasses.replace(second, product=4)
    for solid in (wrong, other):
        motion = find_motion(first, solid)
        assert motion is not None
        assert motion.rotation == approx(np.eye(3), abs=1e-9)


def test_solids_are_grouped_by_shape() -> None:
    first, other = solid_of(WEDGE), solid_of(WEDGE * [2.0, 1.0, 1.0])
    copy = moved(first, np.eye(3), np.ones(3))
    mirrored = moved(first, MIRROR, np.zeros(3))
    groups = group_equal([first, other, copy, mirrored, copy])
    assert [[index for index, _ in group] for group in groups] == [[0, 2, 4], [1], [3]]
    assert groups[0][0][1].residual == 0.0
    assert groups[0][1][1].shift == approx(np.ones(3))
