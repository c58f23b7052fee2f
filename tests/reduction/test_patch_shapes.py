import numpy as np
import pytest

from headstock.geometry.frames import FloatArray, rigid_map
from headstock.geometry.parts.patches import Outline
from headstock.reduction.patch_shapes import (
    PatchShapes,
    count_patch_shapes,
    gauss_rule,
    list_degrees,
    shape_fields,
)

OUTLINES = (
    *(
        Outline(0.1 * np.array(sides))
        for sides in ([1.0, 1.0], [1.5, 1.0], [1.0, 3.0], [50.0, 1.0])
    ),
    *(Outline(np.full(2, 0.1), hole) for hole in (0.0, 0.4, 0.95)),
)


def shapes_over(outline: Outline, most: int) -> PatchShapes:
    count = count_patch_shapes(list_degrees(outline, most))
    center = np.array([0.3, -0.2, 0.5])
    return PatchShapes(center, 1, outline.half_lengths, count, 6, True, outline.hole)


def moments(shapes: PatchShapes, fields: FloatArray) -> FloatArray:
    points, weights = gauss_rule(shapes)
    own = shape_fields(shapes, points)
    return np.asarray((own * np.repeat(weights, 3)[:, None]).T @ fields)


@pytest.mark.parametrize("outline", OUTLINES, ids=str)
def test_shapes_are_orthonormal_and_orthogonal_to_rigid_motions(outline: Outline) -> None:
    shapes = shapes_over(outline, 60)
    points, _ = gauss_rule(shapes)
    gram = moments(shapes, shape_fields(shapes, points))
    np.testing.assert_allclose(gram, np.eye(shapes.count), atol=1e-13)
    rigid = rigid_map(points, np.array([0.0, 0.7, 0.1]))
    np.testing.assert_allclose(moments(shapes, rigid), 0.0, atol=1e-13)


@pytest.mark.parametrize("outline", OUTLINES, ids=str)
def test_a_basis_contains_every_smaller_one_and_keeps_to_its_limit(outline: Outline) -> None:
    before: list[tuple[int, int]] = []
    for most in range(100):
        degrees = list_degrees(outline, most)
        assert degrees[: len(before)] == before
        assert count_patch_shapes(degrees) <= most
        before = degrees
    assert count_patch_shapes(before) > 70


def test_the_directions_of_a_square_come_together() -> None:
    found = [set(list_degrees(Outline(np.ones(2)), most)) for most in range(60)]
    assert found == [{(j, i) for i, j in degrees} for degrees in found]


def test_along_a_strip_degrees_rise_alone_and_its_edges_may_turn() -> None:
    degrees = list_degrees(Outline(np.array([50.0, 1.0])), 60)
    assert max(i for i, _ in degrees) > 8
    assert {j for _, j in degrees} == {0, 1}


@pytest.mark.parametrize("hole", [0.0, 0.9])
def test_around_a_disk_and_a_ring_sines_and_cosines_come_together(hole: float) -> None:
    found = [set(list_degrees(Outline(np.ones(2), hole), most)) for most in range(60)]
    assert found == [{(zeros, -waves) for zeros, waves in degrees} for degrees in found]


def test_around_a_thin_ring_waves_rise_alone() -> None:
    degrees = list_degrees(Outline(np.ones(2), 0.95), 100)
    assert max(waves for _, waves in degrees) > 8
    assert {zeros for zeros, _ in degrees} == {0, 1}


def test_shapes_of_a_disk_are_zernike_polynomials() -> None:
    shapes = shapes_over(Outline(np.full(2, 0.1), 0.0), 24)
    radius, angle = np.array([0.3, 0.8]), np.array([0.4, 2.5])
    points = shapes.center + 0.1 * np.stack(
        [radius * np.cos(angle), 0.0 * radius, radius * np.sin(angle)], axis=1
    )
    along = shape_fields(shapes, points)[0::3, 3:].reshape(2, -1, 3)[:, :, 0]
    expected = {
        (1, 0): np.sqrt(3.0) * (2.0 * radius**2 - 1.0),
        (0, 2): np.sqrt(6.0) * radius**2 * np.cos(2.0 * angle),
        (0, -2): np.sqrt(6.0) * radius**2 * np.sin(2.0 * angle),
        (1, 1): np.sqrt(8.0) * (3.0 * radius**3 - 2.0 * radius) * np.cos(angle),
        (0, -3): np.sqrt(8.0) * radius**3 * np.sin(3.0 * angle),
    }
    degrees = list_degrees(shapes.outline, 24)[2:]
    for pair, values in expected.items():
        np.testing.assert_allclose(along[:, degrees.index(pair)], values, atol=1e-13)
