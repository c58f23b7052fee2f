import numpy as np
import pytest
from mpi4py import MPI

from common import make_box, make_component
from headstock.geometry.frames import BoolArray, FloatArray, rigid_map
from headstock.solvers.elastic.constrained_solver import (
    NEGLIGIBLE_ROUNDOFF,
    ConstrainedSolver,
    rigid_node_motions,
)
from headstock.solvers.elastic.elasticity import ElasticOperators, assemble_elasticity
from headstock.solvers.errors import ConvergenceError, ModelError

COMM = MPI.COMM_SELF
RNG = np.random.default_rng(11)


@pytest.fixture(scope="module")
def operators() -> ElasticOperators:
    return assemble_elasticity(
        make_box((1, 2, 3), (0.1, 0.2, 0.4)), make_component().material, comm=COMM, with_mass=True
    )


def saddle_solution(
    operators: ElasticOperators,
    fixed: BoolArray,
    constraints: FloatArray,
    loads: FloatArray,
    targets: FloatArray,
) -> FloatArray:
    """The same problem by a dense saddle-point system."""
    free = ~fixed
    size, count = int(free.sum()), constraints.shape[1]
    system = np.zeros((size + count, size + count))
    scale = operators.stiffness_scale
    system[:size, :size] = operators.stiffness.toarray()[np.ix_(free, free)] / scale
    system[:size, size:] = -constraints[free]
    system[size:, :size] = constraints[free].T
    answer = np.linalg.solve(system, np.vstack([loads[free] / scale, targets]))
    result = np.zeros(loads.shape)
    result[free] = answer[:size]
    return result


def means(operators: ElasticOperators) -> FloatArray:
    """Mean motions of the upper and the lower face, six each."""
    columns = []
    for level in (0.0, 0.4):
        face = np.abs(operators.points[:, 2] - level) < 1e-9
        motion = (
            rigid_map(operators.points, operators.points[face].mean(axis=0))
            * np.repeat(face, 3)[:, None]
        )
        columns.append(motion @ np.linalg.inv(motion.T @ motion))
    return np.hstack(columns)


@pytest.mark.parametrize("fixed_kind", ["nothing", "a plane in z", "a face"])
def test_answers_are_those_of_a_dense_saddle_point_system(
    operators: ElasticOperators, fixed_kind: str
) -> None:
    face = operators.points[:, 2] < 1e-9
    fixed = np.zeros(operators.owned_dofs, dtype=bool)
    if fixed_kind == "a plane in z":
        fixed[2::3] = face
    elif fixed_kind == "a face":
        fixed[:] = np.repeat(face, 3)
    constraints = means(operators)[:, 6:]
    loads, targets = RNG.standard_normal((len(fixed), 3)) * 1e9, RNG.standard_normal((6, 3))
    with ConstrainedSolver(operators, fixed, constraints) as solver:
        found = solver.solve(loads, targets)
    exact = saddle_solution(operators, fixed, constraints, loads, targets)
    assert np.abs(found - exact).max() < 1e-9 * np.abs(exact).max()
    assert not found[fixed].any()
    np.testing.assert_allclose(
        np.where(fixed[:, None], 0.0, constraints).T @ found,
        targets,
        atol=1e-9 * np.abs(targets).max(),
    )


def test_the_pins_of_a_floating_body_carry_no_force(operators: ElasticOperators) -> None:
    fixed = np.zeros(operators.owned_dofs, dtype=bool)
    constraints = means(operators)
    loads = RNG.standard_normal((len(fixed), 2))
    with ConstrainedSolver(operators, fixed, constraints) as solver:
        found = solver.solve(loads)
    forces = loads - operators.stiffness @ found
    # what is left over lies in the span of the constraints alone
    rest = forces - constraints @ np.linalg.lstsq(constraints, forces, rcond=None)[0]
    assert np.abs(rest).max() < 1e-9 * np.abs(loads).max()


def test_means_that_hold_five_of_six_motions_are_refused_with_the_number_left_free(
    operators: ElasticOperators,
) -> None:
    fixed = np.zeros(operators.owned_dofs, dtype=bool)
    with pytest.raises(ModelError, match="1 rigid motions"):
        ConstrainedSolver(operators, fixed, means(operators)[:, :5])


def test_a_symmetry_plane_alone_leaves_three_motions_free(operators: ElasticOperators) -> None:
    fixed = np.zeros(operators.owned_dofs, dtype=bool)
    fixed[2::3] = operators.points[:, 2] < 1e-9
    with pytest.raises(ModelError, match="3 rigid motions"):
        ConstrainedSolver(operators, fixed, np.zeros((len(fixed), 0)))


def test_symmetry_planes_in_three_directions_hold_a_body(operators: ElasticOperators) -> None:
    fixed = np.zeros(operators.owned_dofs, dtype=bool)
    for axis in range(3):
        fixed[axis::3] = operators.points[:, axis] < 1e-9
    with ConstrainedSolver(operators, fixed, np.zeros((len(fixed), 0))) as solver:
        assert solver.motions.shape[1] == 0
        assert np.isfinite(solver.solve(np.ones((len(fixed), 1)))).all()


def test_the_residual_of_every_solve_is_kept(operators: ElasticOperators) -> None:
    fixed = np.repeat(operators.points[:, 2] < 1e-9, 3)
    with ConstrainedSolver(operators, fixed, np.zeros((len(fixed), 0))) as solver:
        assert solver.largest_residual == 0.0
        solver.solve(RNG.standard_normal((len(fixed), 1)))
        assert 0.0 < solver.largest_residual < 1e-10


def test_rigid_motions_are_of_unit_size_and_free_of_force(operators: ElasticOperators) -> None:
    motions = rigid_node_motions(operators)
    assert np.linalg.matrix_rank(motions) == 6
    assert np.abs(operators.apply_stiffness(motions)).max() < 1e-12 * operators.stiffness_scale
    np.testing.assert_allclose(
        (motions[:, 3:] ** 2).sum(axis=0).sum() / len(operators.points), 2.0, rtol=1e-12
    )


def strip_operators(thickness: float) -> ElasticOperators:
    mesh = make_box((40, 1, 1), (1.0, 0.02, thickness))
    return assemble_elasticity(mesh, make_component().material, comm=COMM, with_mass=True)


@pytest.mark.parametrize("thickness", [0.02, 1e-3, 4e-4], ids=["1:50", "1:1000", "1:2500"])
def test_a_thin_strip_finds_the_shape_back_that_its_forces_come_from(thickness: float) -> None:
    operators = strip_operators(thickness)
    x, _, z = operators.points.T
    fixed = np.repeat(x < 1e-9, 3)
    shape = np.zeros((len(fixed), 1))
    shape[2::3, 0], shape[0::3, 0] = x**2, -2.0 * x * (z - z.mean())
    with ConstrainedSolver(operators, fixed, np.zeros((len(fixed), 0))) as solver:
        forces = operators.apply_stiffness_precisely(shape)
        found = solver.solve(forces)
        # forces of double precision are rounded, and that alone moves a thin strip: by 1e-13 at
        # 1:50, by 5e-8 to 1e-7 at 1:1000
        # (one draw in ten moves it by far less)
        half = np.finfo(float).eps * np.random.default_rng(1).uniform(-0.5, 0.5, (len(fixed), 8))
        moved = np.abs(solver.solve(forces * (1.0 + half)) - found).max()
        negligible = solver.roundoff if solver.roundoff <= NEGLIGIBLE_ROUNDOFF else 0.0
        allowed = max(solver.attainable_change, negligible)
    error, size = np.abs(found - shape).max(), np.abs(shape).max()
    # what refinement leaves is within what conditioning allows
    assert error < allowed * size
    if thickness >= 1e-3:
        # a Cholesky factorisation alone is off by 1e-3 at 1:1000
        assert error < 1e-8 * size + moved
        assert moved < 1e-6 * size


def test_a_translation_of_a_thin_sheet_has_no_strain_energy_beside_its_bending() -> None:
    operators = strip_operators(1e-3)
    moved = np.zeros((operators.owned_dofs, 1))
    moved[2::3] = 1.0
    bending = make_component().material.youngs_modulus * 0.02 * 1e-9 / 12.0
    assert abs((moved.T @ operators.apply_stiffness_precisely(moved))[0, 0]) < 1e-9 * bending
    assert abs((moved.T @ (operators.stiffness @ moved))[0, 0]) > 1e-5 * bending
    assert operators.energy_roundoff(moved)[0] > 1e-5 * bending


def test_a_load_that_the_means_carry_alone_moves_nothing(operators: ElasticOperators) -> None:
    fixed = np.repeat(operators.points[:, 2] < 1e-9, 3)
    constraints = means(operators)[:, 6:]
    with ConstrainedSolver(operators, fixed, constraints) as solver:
        found = solver.solve(1e6 * constraints[:, 2:3])
        moved = solver.solve(np.where(fixed, 0.0, 1.0)[:, None])
    assert (
        np.abs(found).max() * operators.stiffness_scale
        < 1e-9 * np.abs(1e6 * constraints[:, 2]).max()
    )
    assert np.abs(moved).max() * operators.stiffness_scale > 1.0


def test_a_stiffness_that_its_factors_miss_by_far_is_refused(
    operators: ElasticOperators, monkeypatch: pytest.MonkeyPatch
) -> None:
    fixed = np.repeat(operators.points[:, 2] < 1e-9, 3)
    with ConstrainedSolver(operators, fixed, np.zeros((len(fixed), 0))) as solver:
        good = solver._factorization.solve
        for share, accepted in ((1e-3, True), (0.3, False)):
            monkeypatch.setattr(
                solver._factorization,
                "solve",
                lambda loads, share=share: (1.0 + share) * good(loads),
            )
            if accepted:
                solver.solve(np.where(fixed, 0.0, 1.0)[:, None])
            else:
                with pytest.raises(ConvergenceError, match=r"residual of .* \(allowed 1e-11\)"):
                    solver.solve(np.where(fixed, 0.0, 1.0)[:, None])


@pytest.mark.parametrize("share", [1e-3, 0.5], ids=["a thousandth", "half"])
def test_a_soft_shape_that_factors_miss_by_half_is_refused_though_its_forces_are_small(
    monkeypatch: pytest.MonkeyPatch, share: float
) -> None:
    operators = strip_operators(1e-3)
    fixed = np.repeat(operators.points[:, 0] < 1e-9, 3)
    load = np.zeros((len(fixed), 1))
    load[2::3] = 1.0
    load[fixed] = 0.0
    with ConstrainedSolver(operators, fixed, np.zeros((len(fixed), 0))) as solver:
        right, good = solver.solve(load), solver._factorization.solve
        monkeypatch.setattr(
            solver._factorization, "solve", lambda loads: (1.0 + share) * good(loads)
        )
        wrong = solver._residual((1.0 + share) * right, load)[1]
        assert wrong < 1e-10
        if share < 0.5:
            assert (
                np.abs(solver.solve(load) - right).max()
                < solver.attainable_change * np.abs(right).max()
            )
        else:
            with pytest.raises(ConvergenceError, match=r"displacements.*conditioning"):
                solver.solve(load)
