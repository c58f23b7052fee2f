"""Elimination by an orthonormal null space, with graded coordinates."""

import numpy as np
import pytest
import scipy.linalg

from headstock.geometry.frames import FloatArray
from headstock.reduction.coupling.elimination import RANK_TOLERANCE, eliminate_constraints


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
def test_rank_does_not_depend_on_units_of_rotations(unit: float) -> None:
    lever = np.array([[1.0, 0.0, -1.0, 1e-5], [0.0, 1.0, 0.0, -1.0]])
    scale = np.array([1.0, 1.0 / unit, 1.0, 1.0 / unit])
    found = eliminate_constraints(lever * np.array([1.0, unit, 1.0, unit]), [], scale)
    assert found.basis.shape[1] == 2 and found.redundant == ()


def test_untouched_dofs_stay_themselves() -> None:
    found = eliminate_constraints(np.array([[0.0, 1.0, -1.0, 0.0]]), [], np.ones(4))
    np.testing.assert_array_equal(found.basis[:, :2], np.eye(4)[:, [0, 3]])


def test_rows_that_others_imply_are_named() -> None:
    rows = np.array([[1.0, -1.0, 0.0], [0.0, 1.0, -1.0], [2.0, 0.0, -2.0], [0.0, 0.0, 0.0]])
    found = eliminate_constraints(rows, [], np.ones(3))
    assert found.basis.shape == (3, 1)
    assert len(found.redundant) == 2 and 3 in found.redundant


def test_stiff_groups_are_seen_only_by_their_own_coordinates() -> None:
    generator = np.random.default_rng(0)
    fixed, stiff, middle = (generator.normal(size=(count, 10)) for count in (2, 3, 2))
    found = eliminate_constraints(fixed, [stiff, middle], np.ones(10))
    assert np.sort(found.levels).tolist() == [0, 0, 0, 1, 1, 1, 2, 2]
    np.testing.assert_allclose((stiff @ found.basis)[:, found.levels != 1], 0.0, atol=1e-13)
    np.testing.assert_allclose((middle @ found.basis)[:, found.levels == 0], 0.0, atol=1e-13)
    np.testing.assert_allclose(found.basis.T @ found.basis, np.eye(8), atol=1e-13)


def rigid_joints(
    bodies: int, joints: list[tuple[int, int]], seed: int
) -> tuple[FloatArray, FloatArray]:
    """Rows that hold bodies of two faces together, six dofs a face, and a scale of the dofs."""
    generator = np.random.default_rng(seed)
    rows = np.zeros((6 * len(joints), 12 * bodies))
    for number, (first, second) in enumerate(joints):
        own = slice(6 * number, 6 * number + 6)
        rows[own, 12 * first + 6 : 12 * first + 12] = np.eye(6)
        rows[own, 12 * second : 12 * second + 6] = -np.eye(6)
        rows[own, 12 * second + 3 : 12 * second + 6] += 0.3 * generator.normal(size=(6, 3))
    return rows, np.where(np.arange(12 * bodies) % 6 < 3, 1.0, 4.0)


@pytest.mark.parametrize("seed", range(4))
def test_sets_taken_apart_span_what_one_decomposition_of_all_rows_does_on_random_graphs(
    seed: int,
) -> None:
    generator = np.random.default_rng(seed)
    joints = [
        (int(first), int(second))
        for first, second in (generator.choice(8, 2, replace=False) for _ in range(7))
    ]
    # some joints twice: redundant
    rows, scale = rigid_joints(8, [*joints, *joints[:2]], seed)
    rows[-12:] = rows[:12]
    stiff = generator.normal(size=(3, rows.shape[1])) * (np.arange(rows.shape[1]) // 12 == 3)
    found = eliminate_constraints(rows, [stiff], scale)
    null = scipy.linalg.null_space(rows * scale, rcond=RANK_TOLERANCE)
    scaled = found.basis / scale[:, None]
    scaled /= np.linalg.norm(scaled, axis=0)  # dofs that no row sees stay themselves
    assert scaled.shape == null.shape
    np.testing.assert_allclose(scaled @ scaled.T, null @ null.T, atol=1e-12)
    assert len(found.redundant) == len(rows) - np.linalg.matrix_rank(rows * scale)
    np.testing.assert_allclose((stiff @ found.basis)[:, found.levels == 0], 0.0, atol=1e-12)
    # without the rows called redundant the others hold the same
    kept = np.delete(rows, found.redundant, axis=0)
    assert np.linalg.matrix_rank(kept * scale) == len(kept) == np.linalg.matrix_rank(rows * scale)


def test_coordinates_of_joints_that_share_no_dof_stay_apart() -> None:
    rows, scale = rigid_joints(30, [(body, body + 1) for body in range(29)], 0)
    found = eliminate_constraints(rows, [], scale)
    assert found.basis.shape == (360, 360 - 6 * 29) and found.redundant == ()
    # each coordinate moves the two faces at one joint at most
    assert np.count_nonzero(found.basis, axis=0).max() <= 12
