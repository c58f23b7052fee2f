import numpy as np
import pytest

from headstock.geometry.frames import FloatArray, rigid_map
from headstock.reduction.patch_shapes import (
    PatchShapes,
    count_shapes,
    gauss_rule,
    list_degrees,
    shape_fields,
)

SIDES = ([1.0, 1.0], [1.5, 1.0], [1.0, 3.0], [50.0, 1.0])


def shapes_over(sides: list[float], most: int) -> PatchShapes:
    half = 0.1 * np.array(sides)
    count = count_shapes(list_degrees(half, most))
    return PatchShapes(np.array([0.3, -0.2, 0.5]), 1, half, count, 6, True)


def moments(shapes: PatchShapes, fields: FloatArray) -> FloatArray:
    points, weights = gauss_rule(shapes)
    own = shape_fields(shapes, points)
    return np.asarray((own * np.repeat(weights, 3)[:, None]).T @ fields)


@pytest.mark.parametrize("sides", SIDES)
def test_shapes_are_orthonormal_and_orthogonal_to_rigid_motions(sides: list[float]) -> None:
    shapes = shapes_over(sides, 30)
    points, _ = gauss_rule(shapes)
    gram = moments(shapes, shape_fields(shapes, points))
    np.testing.assert_allclose(gram, np.eye(shapes.count), atol=1e-13)
    rigid = rigid_map(points, np.array([0.0, 0.7, 0.1]))
    np.testing.assert_allclose(moments(shapes, rigid), 0.0, atol=1e-13)


@pytest.mark.parametrize("sides", SIDES)
def test_a_basis_contains_every_smaller_one_and_keeps_to_its_limit(sides: list[float]) -> None:
    half = np.array(sides)
    before: list[tuple[int, int]] = []
    for most in range(100):
        degrees = list_degrees(half, most)
        assert degrees[: len(before)] == before
        assert count_shapes(degrees) <= most
        before = degrees
    assert count_shapes(before) > 70


def test_the_directions_of_a_square_come_together() -> None:
    for most in range(60):
        degrees = set(list_degrees(np.ones(2), most))
        assert degrees == {(j, i) for i, j in degrees}


def test_along_a_strip_degrees_rise_alone_and_its_edges_may_turn() -> None:
    degrees = list_degrees(np.array([50.0, 1.0]), 60)
    assert max(i for i, _ in degrees) > 8
    assert {j for _, j in degrees} == {0, 1}
