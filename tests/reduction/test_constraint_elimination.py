"""Elimination by an orthonormal null space, with graded coordinates."""

import numpy as np
import pytest

from headstock.reduction.constraint_elimination import eliminate_constraints


@pytest.mark.parametrize("seed", range(5))
def test_constraints_vanish_and_the_scaled_basis_is_orthonormal(seed):
    generator = np.random.default_rng(seed)
    rows, scale = generator.normal(size=(4, 12)), np.where(np.arange(12) % 2, 1.0, 3.0)
    found = eliminate_constraints(rows, [], scale)
    assert found.basis.shape == (12, 8)
    np.testing.assert_allclose(rows @ found.basis, 0.0, atol=1e-13)
    scaled = found.basis / scale[:, None]
    np.testing.assert_allclose(scaled.T @ scaled, np.eye(8), atol=1e-13)


def test_rank_does_not_depend_on_units_of_rotations():
    lever = np.array([[1.0, 0.0, -1.0, 1e-5], [0.0, 1.0, 0.0, -1.0]])
    for unit in (1e-6, 1.0, 1e6):
        scale = np.array([1.0, 1.0 / unit, 1.0, 1.0 / unit])
        found = eliminate_constraints(lever * np.array([1.0, unit, 1.0, unit]), [], scale)
        assert found.basis.shape[1] == 2 and found.redundant == ()


def test_untouched_dofs_stay_themselves():
    found = eliminate_constraints(np.array([[0.0, 1.0, -1.0, 0.0]]), [], np.ones(4))
    np.testing.assert_array_equal(found.basis[:, :2], np.eye(4)[:, [0, 3]])


def test_rows_that_others_imply_are_named():
    rows = np.array([[1.0, -1.0, 0.0], [0.0, 1.0, -1.0], [2.0, 0.0, -2.0], [0.0, 0.0, 0.0]])
    found = eliminate_constraints(rows, [], np.ones(3))
    assert found.basis.shape == (3, 1)
    assert len(found.redundant) == 2 and 3 in found.redundant


def test_stiff_groups_are_seen_only_by_their_own_coordinates():
    generator = np.random.default_rng(0)
    held, stiff, middle = (generator.normal(size=(count, 10)) for count in (2, 3, 2))
    found = eliminate_constraints(held, [stiff, middle], np.ones(10))
    assert sorted(found.levels.tolist()) == [0, 0, 0, 1, 1, 1, 2, 2]
    np.testing.assert_allclose((stiff @ found.basis)[:, found.levels != 1], 0.0, atol=1e-13)
    np.testing.assert_allclose((middle @ found.basis)[:, found.levels == 0], 0.0, atol=1e-13)
    np.testing.assert_allclose(found.basis.T @ found.basis, np.eye(8), atol=1e-13)
