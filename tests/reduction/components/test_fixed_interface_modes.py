import dataclasses
from collections.abc import Iterator

import numpy as np
import pytest
import scipy.linalg
from mpi4py import MPI

from common import approx, make_box, make_component
from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Eigensolver
from headstock.reduction.components import fixed_interface_modes
from headstock.reduction.components.fixed_interface_modes import (
    _draw_numbers,
    _require_resolved,
    find_fixed_interface_modes,
    verify_mode_count,
)
from headstock.solvers.elastic.constrained_modes import lowest_modes
from headstock.solvers.elastic.constrained_solver import ConstrainedSolver
from headstock.solvers.elastic.eigenpairs import EigenPairs, ModeTarget
from headstock.solvers.elastic.elasticity import assemble_elasticity
from headstock.solvers.errors import AccuracyError

COMM = MPI.COMM_SELF


@pytest.fixture(scope="module")
def solver() -> Iterator[ConstrainedSolver]:
    mesh = make_box((1, 2, 5), (0.1, 0.17, 0.5))
    operators = assemble_elasticity(mesh, make_component().material, comm=COMM, with_mass=True)
    fixed = np.repeat((operators.points[:, 2] < 1e-9) | (operators.points[:, 2] > 0.5 - 1e-9), 3)
    with ConstrainedSolver(operators, fixed, np.zeros((len(fixed), 0))) as made:
        yield made


@pytest.fixture(scope="module")
def exact(solver: ConstrainedSolver) -> FloatArray:
    free = ~solver.fixed
    assert solver.operators.scalar_mass is not None
    mass = np.kron(solver.operators.scalar_mass.toarray(), np.eye(3))[np.ix_(free, free)]
    return np.asarray(
        scipy.linalg.eigvalsh(solver.operators.stiffness.toarray()[np.ix_(free, free)], mass)
    )


@pytest.mark.parametrize(
    "count", [1, 10, 30, 200], ids=["lanczos 1", "lanczos 10", "lanczos 30", "dense 200"]
)
def test_eigenvalues_are_the_lowest_of_the_fixed_component(
    solver: ConstrainedSolver, exact: FloatArray, count: int
) -> None:
    found = find_fixed_interface_modes(solver, ModeTarget(count=count))
    assert len(found.eigenvalues) >= count
    np.testing.assert_allclose(found.eigenvalues, exact[: len(found.eigenvalues)], rtol=1e-9)


@pytest.mark.parametrize("count", [10, 200])
def test_shapes_diagonalise_mass_and_stiffness_and_rest_on_fixed_dofs(
    solver: ConstrainedSolver, count: int
) -> None:
    found = find_fixed_interface_modes(solver, ModeTarget(count=count))
    assert not found.shapes[solver.fixed].any()
    np.testing.assert_allclose(
        found.shapes.T @ solver.operators.apply_mass(found.shapes),
        np.eye(len(found.eigenvalues)),
        atol=1e-10,
    )
    stiffness = found.shapes.T @ solver.operators.apply_stiffness(found.shapes)
    assert np.abs(stiffness - np.diag(found.eigenvalues)).max() < 1e-9 * found.eigenvalues[-1]


def test_a_frequency_keeps_every_mode_up_to_it(
    solver: ConstrainedSolver, exact: FloatArray
) -> None:
    limit = 0.5 * (np.sqrt(exact[6]) + np.sqrt(exact[7])) / (2.0 * np.pi)
    found = find_fixed_interface_modes(solver, ModeTarget(up_to_hz=limit))
    assert len(found.eigenvalues) >= 7
    assert found.cutoff_hz > limit
    assert found.cutoff_hz == approx(
        np.sqrt(exact[len(found.eigenvalues)]) / (2.0 * np.pi), rel=1e-3
    )


def test_a_frequency_below_the_first_mode_keeps_none(
    solver: ConstrainedSolver, exact: FloatArray
) -> None:
    found = find_fixed_interface_modes(
        solver, ModeTarget(up_to_hz=0.1 * np.sqrt(exact[0]) / (2.0 * np.pi))
    )
    assert len(found.eigenvalues) == 0
    assert found.cutoff_hz == approx(np.sqrt(exact[0]) / (2.0 * np.pi), rel=1e-3)


@pytest.mark.parametrize("target", [None, ModeTarget(count=0)])
def test_nothing_asked_for_keeps_no_mode_and_promises_no_frequency(
    solver: ConstrainedSolver, target: ModeTarget | None
) -> None:
    found = find_fixed_interface_modes(solver, target)
    assert found.shapes.shape == (len(solver.fixed), 0)
    assert found.cutoff_hz == 0.0


def test_a_rerun_gives_the_same_bits(solver: ConstrainedSolver) -> None:
    first, second = (find_fixed_interface_modes(solver, ModeTarget(count=12)) for _ in range(2))
    np.testing.assert_array_equal(first.eigenvalues, second.eigenvalues)
    np.testing.assert_array_equal(first.shapes, second.shapes)


def test_a_lost_repeated_mode_is_found_by_the_sturm_count() -> None:
    mesh = make_box((2, 2, 10), (0.05, 0.05, 0.5))
    operators = assemble_elasticity(mesh, make_component().material, comm=COMM, with_mass=True)
    fixed = np.repeat(operators.points[:, 2] < 1e-9, 3)
    with ConstrainedSolver(operators, fixed, np.zeros((len(fixed), 0))) as solver:
        modes = find_fixed_interface_modes(solver, ModeTarget(count=6))
        verify_mode_count(solver, modes)
        lost = dataclasses.replace(modes, eigenvalues=np.delete(modes.eigenvalues, 1))
        with pytest.raises(AccuracyError, match="Sturm count"):
            verify_mode_count(solver, lost)


def test_krylov_schur_finds_what_block_lanczos_does_and_leaves_the_factors_whole(
    solver: ConstrainedSolver, exact: FloatArray
) -> None:
    limit = np.sqrt(0.5 * (exact[9] + exact[10])) / (2.0 * np.pi)
    for target in (ModeTarget(count=20), ModeTarget(up_to_hz=limit)):
        one = find_fixed_interface_modes(solver, target)
        other = find_fixed_interface_modes(solver, target, eigensolver="krylov_schur")
        np.testing.assert_allclose(other.eigenvalues, one.eigenvalues, rtol=1e-9)
        assert other.cutoff_hz == approx(one.cutoff_hz, rel=1e-3)
    loads = np.where(solver.fixed[:, None], 0.0, np.ones((len(solver.fixed), 2)))
    residual = solver.operators.apply_stiffness(solver.solve(loads)) - loads
    assert np.abs(residual[~solver.fixed]).max() < 1e-9 * solver.operators.stiffness_scale


def test_a_frequency_above_every_mode_keeps_them_all(
    solver: ConstrainedSolver, exact: FloatArray
) -> None:
    found = find_fixed_interface_modes(solver, ModeTarget(up_to_hz=1e12))
    assert len(found.eigenvalues) == len(exact)
    assert found.cutoff_hz == np.inf


def sheet_solver(thickness: float) -> ConstrainedSolver:
    mesh = make_box((20, 4, 1), (1.0, 0.2, thickness))
    operators = assemble_elasticity(mesh, make_component().material, comm=COMM, with_mass=True)
    fixed = np.repeat(operators.points[:, 0] < 1e-9, 3)
    return ConstrainedSolver(operators, fixed, np.zeros((len(fixed), 0)))


@pytest.mark.parametrize("thickness", [0.1, 1e-3], ids=["1:10", "1:1000"])
def test_a_search_that_misses_by_more_than_conditioning_allows_is_refused(
    monkeypatch: pytest.MonkeyPatch, thickness: float
) -> None:
    errors = {0.1: (5e-8, 2e-7), 1e-3: (1e-5, 1e-4)}[thickness]
    with sheet_solver(thickness) as solver:
        for error in errors:

            def missing(
                solver: ConstrainedSolver,
                start: FloatArray,
                target: ModeTarget,
                *,
                eigensolver: Eigensolver = "block_lanczos",
                error: float = error,
            ) -> EigenPairs:
                pairs = lowest_modes(solver, start, target, eigensolver=eigensolver)
                return dataclasses.replace(pairs, values=pairs.values * (1.0 + error))

            monkeypatch.setattr(fixed_interface_modes, "lowest_modes", missing)
            if error == errors[0]:
                find_fixed_interface_modes(solver, ModeTarget(count=4))
            else:
                with pytest.raises(
                    AccuracyError, match="between the inverse and the stiffness itself"
                ):
                    find_fixed_interface_modes(solver, ModeTarget(count=4))


def test_eigenvalues_that_rounding_may_have_drowned_are_refused_with_the_remedy() -> None:
    values = np.array([1.0, 2.0])
    _require_resolved(values, values, np.array([0.29, 1e-3]))
    with pytest.raises(AccuracyError, match=r"reaches 0.31 .*too thin.*rigid or segmented"):
        _require_resolved(values, values, np.array([0.31, 1e-3]))


def test_numbers_drawn_for_nodes_do_not_depend_on_who_draws_them() -> None:
    whole = _draw_numbers(np.arange(50_000), 6, seed=3)
    some = np.array([49_999, 7, 0, 31_415])
    np.testing.assert_array_equal(_draw_numbers(some, 6, seed=3), whole[some])
    # evenly spread, and neither columns, nodes nor seeds resemble each other
    assert np.abs(whole.mean(axis=0)).max() < 0.01
    np.testing.assert_allclose(whole.var(axis=0), 1.0 / 3.0, rtol=0.02)
    others = np.column_stack(
        [whole[1:], whole[:-1], _draw_numbers(np.arange(1, 50_000), 6, seed=4)]
    )
    correlation = np.corrcoef(others.T) - np.eye(18)
    assert np.abs(correlation).max() < 0.02
