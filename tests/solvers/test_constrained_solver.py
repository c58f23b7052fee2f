import numpy as np
import pytest
from mpi4py import MPI

from headstock.geometry.frames import rigid_map
from headstock.solvers.constrained_solver import ConstrainedSolver, rigid_motions
from headstock.solvers.elasticity import assemble_elasticity
from headstock.solvers.errors import ModelError

COMM = MPI.COMM_SELF
RNG = np.random.default_rng(11)


@pytest.fixture(scope="module")
def operators(make_box, make_component):
    return assemble_elasticity(make_box((1, 2, 3), (0.1, 0.2, 0.4)), make_component().material, comm=COMM, with_mass=True)


def saddle_solution(operators, held, constraints, loads, targets):
    """The same problem by a dense saddle-point system."""
    free = ~held
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


def means(operators):
    """Mean motions of the upper and the lower face, six each."""
    columns = []
    for level in (0.0, 0.4):
        face = np.abs(operators.points[:, 2] - level) < 1e-9
        motion = rigid_map(operators.points, operators.points[face].mean(axis=0)) * np.repeat(face, 3)[:, None]
        columns.append(motion @ np.linalg.inv(motion.T @ motion))
    return np.hstack(columns)


@pytest.mark.parametrize("held_kind", ["nothing", "a plane in z", "a face"])
def test_answers_are_those_of_a_dense_saddle_point_system(operators, held_kind):
    face = operators.points[:, 2] < 1e-9
    held = np.zeros(operators.owned_dofs, dtype=bool)
    if held_kind == "a plane in z":
        held[2::3] = face
    elif held_kind == "a face":
        held = np.repeat(face, 3)
    constraints = means(operators)[:, 6:]
    loads, targets = RNG.standard_normal((len(held), 3)) * 1e9, RNG.standard_normal((6, 3))
    with ConstrainedSolver(operators, held, constraints) as solver:
        found = solver.solve(loads, targets)
    exact = saddle_solution(operators, held, constraints, loads, targets)
    assert np.abs(found - exact).max() < 1e-9 * np.abs(exact).max()
    assert not found[held].any()
    np.testing.assert_allclose(np.where(held[:, None], 0.0, constraints).T @ found, targets, atol=1e-9 * np.abs(targets).max())


def test_the_pins_of_a_floating_body_carry_no_force(operators):
    held = np.zeros(operators.owned_dofs, dtype=bool)
    constraints = means(operators)
    loads = RNG.standard_normal((len(held), 2))
    with ConstrainedSolver(operators, held, constraints) as solver:
        found = solver.solve(loads)
    forces = loads - operators.stiffness @ found
    # what is left over lies in the span of the constraints alone
    rest = forces - constraints @ np.linalg.lstsq(constraints, forces, rcond=None)[0]
    assert np.abs(rest).max() < 1e-9 * np.abs(loads).max()


def test_means_that_hold_five_of_six_motions_are_refused_with_the_number_left_free(operators):
    held = np.zeros(operators.owned_dofs, dtype=bool)
    with pytest.raises(ModelError, match="1 rigid motions"):
        ConstrainedSolver(operators, held, means(operators)[:, :5])


def test_a_symmetry_plane_alone_leaves_three_motions_free(operators):
    held = np.zeros(operators.owned_dofs, dtype=bool)
    held[2::3] = operators.points[:, 2] < 1e-9
    with pytest.raises(ModelError, match="3 rigid motions"):
        ConstrainedSolver(operators, held, np.zeros((len(held), 0)))


def test_symmetry_planes_in_three_directions_hold_a_body(operators):
    held = np.zeros(operators.owned_dofs, dtype=bool)
    for axis in range(3):
        held[axis::3] = operators.points[:, axis] < 1e-9
    with ConstrainedSolver(operators, held, np.zeros((len(held), 0))) as solver:
        assert solver.motions.shape[1] == 0
        assert np.isfinite(solver.solve(np.ones((len(held), 1)))).all()


def test_the_residual_of_every_solve_is_kept(operators):
    held = np.repeat(operators.points[:, 2] < 1e-9, 3)
    with ConstrainedSolver(operators, held, np.zeros((len(held), 0))) as solver:
        assert solver.largest_residual == 0.0
        solver.solve(RNG.standard_normal((len(held), 1)))
        assert 0.0 < solver.largest_residual < 1e-10


def test_reciprocity_holds_between_any_two_loads(operators):
    held = np.zeros(operators.owned_dofs, dtype=bool)
    loads = RNG.standard_normal((len(held), 6))
    with ConstrainedSolver(operators, held, means(operators)) as solver:
        work = loads.T @ solver.solve(loads)
    assert np.abs(work - work.T).max() < 1e-10 * np.abs(work).max()


def test_rigid_motions_are_of_unit_size_and_free_of_force(operators):
    motions = rigid_motions(operators)
    assert np.linalg.matrix_rank(motions) == 6
    assert np.abs(operators.apply_stiffness(motions)).max() < 1e-12 * operators.stiffness_scale
    np.testing.assert_allclose((motions[:, 3:] ** 2).sum(axis=0).sum() / len(operators.points), 2.0, rtol=1e-12)
