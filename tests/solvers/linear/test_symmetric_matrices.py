"""Null spaces are found by their structure, not by an absolute threshold."""

import numpy as np
import pytest

from headstock.solvers.errors import ModelError
from headstock.solvers.linear.symmetric_matrices import find_null_space


@pytest.mark.parametrize("dimension", [0, 1, 6])
@pytest.mark.parametrize("units", [1e-9, 1.0, 1e12])
def test_the_dimension_is_found_in_any_units_and_the_vectors_vanish(
    dimension: int, units: float
) -> None:
    generator = np.random.default_rng(dimension)
    factor = generator.normal(size=(14, 14 - dimension))
    scales = np.logspace(-4, 4, 14)
    matrix = units * (factor @ factor.T) * scales * scales[:, None]
    null = find_null_space(matrix)
    assert null.dimension == dimension
    np.testing.assert_allclose(
        matrix @ null.vectors / (np.abs(matrix) @ np.abs(null.vectors) + 1e-300), 0.0, atol=1e-11
    )
    np.testing.assert_array_equal(null.vectors[null.pinned], np.eye(dimension))
    assert sorted([*null.pinned, *null.free]) == list(range(14))


def test_a_spring_fourteen_decades_softer_in_its_own_coordinate_is_seen() -> None:
    assert find_null_space(np.diag([1e14, 1e7, 1.0])).dimension == 0


def test_zero_rows_and_an_all_zero_matrix_are_free() -> None:
    assert find_null_space(np.diag([2.0, 0.0, 1.0])).pinned.tolist() == [1]
    assert find_null_space(np.zeros((4, 4))).dimension == 4


def test_negative_directions_are_refused_even_when_no_diagonal_entry_is_negative() -> None:
    with pytest.raises(ModelError, match="unstable"):
        find_null_space(np.array([[1.0, 2.0], [2.0, 1.0]]))
    with pytest.raises(ModelError, match="mass matrix"):
        find_null_space(np.diag([1.0, -1.0]), what="mass")
