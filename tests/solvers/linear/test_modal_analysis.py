"""Modal analysis of second-order systems against closed forms; their lowest modes; null spaces."""

import numpy as np
import pytest
import scipy.linalg

from common import approx
from headstock.geometry.frames import FloatArray
from headstock.solvers.errors import AccuracyError, ModelError
from headstock.solvers.linear import modal_analysis
from headstock.solvers.linear.modal_analysis import solve_lowest_modes, solve_modal
from headstock.solvers.linear.symmetric_matrices import find_null_space
from headstock.solvers.linear.symmetric_modes import ModalPairs, solve_symmetric_modes
from headstock.solvers.second_order import SecondOrderSystem


def system_of(mass: FloatArray, stiffness: FloatArray) -> SecondOrderSystem:
    return SecondOrderSystem(
        mass, None, stiffness, {}, {}, tuple(f"q{i}" for i in range(len(mass)))
    )


def chain(
    count: int, *, free: bool = False, stiffness: float = 1.0e6, mass: float = 2.0
) -> tuple[SecondOrderSystem, FloatArray]:
    """Equal masses in a row on equal springs, both ends fixed or both free."""
    matrix = 2.0 * np.eye(count) - np.eye(count, k=1) - np.eye(count, k=-1)
    if free:
        matrix[0, 0] = matrix[-1, -1] = 1.0
    numbers = np.arange(count) if free else np.arange(1, count + 1)
    angles = numbers * np.pi / (2.0 * (count if free else count + 1))
    return system_of(mass * np.eye(count), stiffness * matrix), 2.0 * np.sqrt(
        stiffness / mass
    ) * np.sin(angles) / (2.0 * np.pi)


def random_system(size: int, seed: int = 0, condition: float = 1.0) -> SecondOrderSystem:
    generator = np.random.default_rng(seed)
    factors = [generator.normal(size=(size, size)) for _ in range(2)]
    scales = np.logspace(0.0, 0.5 * np.log10(condition), size)
    mass, stiffness = (factor @ factor.T + size * np.eye(size) for factor in factors)
    return system_of(mass, 1e6 * stiffness * scales * scales[:, None])


@pytest.mark.parametrize("count", [1, 2, 7, 60])
def test_a_fixed_chain_has_its_closed_form_frequencies(count: int) -> None:
    system, expected = chain(count)
    modal = solve_modal(system)
    np.testing.assert_allclose(modal.frequencies_hz, expected, rtol=1e-11)
    assert modal.rigid_count == 0 and modal.infinite_count == 0


@pytest.mark.parametrize("count", [2, 7, 60])
def test_a_free_chain_has_one_rigid_mode_and_its_closed_form_frequencies(count: int) -> None:
    system, expected = chain(count, free=True)
    modal = solve_modal(system)
    assert modal.rigid_count == 1
    assert modal.frequencies_hz[0] < 1e-5 * modal.frequencies_hz[1]
    np.testing.assert_allclose(modal.frequencies_hz[1:], expected[1:], rtol=1e-10)
    np.testing.assert_allclose(np.abs(modal.shapes[:, 0]), 1.0 / np.sqrt(2.0 * count), rtol=1e-12)


@pytest.mark.parametrize(
    "system",
    [random_system(20), random_system(20, condition=1e6), chain(9, free=True)[0]],
    ids=["like", "spread", "free"],
)
def test_shapes_are_mass_normalised_and_diagonalise_both_matrices(
    system: SecondOrderSystem,
) -> None:
    modal = solve_modal(system)
    eigenvalues = (2.0 * np.pi * modal.frequencies_hz) ** 2
    np.testing.assert_allclose(
        modal.shapes.T @ system.mass @ modal.shapes, np.eye(len(eigenvalues)), atol=1e-9
    )
    scaled = (
        modal.shapes.T
        @ system.stiffness
        @ modal.shapes
        / np.sqrt(np.outer(eigenvalues, eigenvalues) + eigenvalues[-1] * 1e-6)
    )
    assert np.abs(scaled - np.diag(scaled.diagonal())).max() < 1e-8
    assert modal.residuals.max() < 1e-10


@pytest.mark.parametrize("condition", [1.0, 1e6])
def test_residuals_of_many_modes_are_bounded_closely_and_a_spoiled_shape_is_refused(
    condition: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    system = random_system(60, condition=condition)
    modal = solve_modal(system)
    shapes, squares = modal.shapes, (2.0 * np.pi * modal.frequencies_hz) ** 2
    weights = system.stiffness.diagonal()[:, None] + system.mass.diagonal()[:, None] * squares
    left = (system.stiffness @ shapes - system.mass @ shapes * squares) / np.sqrt(weights)
    exact = np.abs(left).max(axis=0) / np.sqrt((shapes**2 * weights).sum(axis=0))
    assert (exact <= modal.residuals).all() and modal.residuals.max() < 1e2 * exact.max()

    def spoil(*matrices: FloatArray, **options: float) -> ModalPairs:
        pairs = solve_symmetric_modes(*matrices)
        pairs.shapes[7, 30] += 1e-4 * np.abs(pairs.shapes[:, 30]).max()
        return pairs

    monkeypatch.setattr(modal_analysis, "solve_symmetric_modes", spoil)
    with pytest.raises(AccuracyError, match="mode 31 "):
        solve_modal(system)


def test_repeated_frequencies_keep_their_multiplicity() -> None:
    generator = np.random.default_rng(3)
    basis = np.linalg.qr(generator.normal(size=(12, 12)))[0]
    eigenvalues = np.array([1.0] * 5 + [4.0] * 3 + [9.0, 9.0, 16.0, 25.0]) * 1e6
    stiffness = basis * eigenvalues @ basis.T
    modal = solve_modal(system_of(np.eye(12), 0.5 * (stiffness + stiffness.T)))
    np.testing.assert_allclose(
        modal.frequencies_hz, np.sqrt(eigenvalues) / (2.0 * np.pi), rtol=1e-12
    )
    np.testing.assert_allclose(modal.shapes.T @ modal.shapes, np.eye(12), atol=1e-10)
    # the subspace of the five, not its vectors, is what two methods share
    angles = scipy.linalg.subspace_angles(modal.shapes[:, :5], basis[:, :5])
    assert angles.max() < 1e-6


def test_count_and_upper_frequency_cut_the_list_and_change_no_value() -> None:
    system, expected = chain(20)
    everything = solve_modal(system).frequencies_hz
    np.testing.assert_allclose(
        solve_modal(system, count=4).frequencies_hz, everything[:4], rtol=1e-13
    )
    limit = 0.5 * (expected[6] + expected[7])
    assert len(solve_modal(system, up_to_hz=limit).frequencies_hz) == 7
    assert len(solve_modal(system, count=3, up_to_hz=limit).frequencies_hz) == 3
    assert len(solve_modal(system, count=99).frequencies_hz) == 20
    with pytest.raises(ValueError, match="at least one"):
        solve_modal(system, count=0)


def test_low_frequencies_are_exact_beside_high_ones_fourteen_decades_up_and_so_are_those() -> None:
    eigenvalues = np.logspace(0, 14, 15)
    coupling = np.eye(15) + 0.05 * (np.eye(15, k=1) + np.eye(15, k=-1))
    scales = np.sqrt(eigenvalues)
    system = system_of(np.eye(15), coupling * scales * scales[:, None])
    exact = np.sqrt(np.array([float(value) for value in _exact_eigenvalues(system.stiffness)])) / (
        2.0 * np.pi
    )
    np.testing.assert_allclose(solve_modal(system).frequencies_hz, exact, rtol=1e-8)
    for count in range(15):
        limit = exact[0] / 2.0 if count == 0 else exact[count - 1] * (1.0 + 1e-9)
        np.testing.assert_allclose(
            solve_modal(system, up_to_hz=limit).frequencies_hz, exact[:count], rtol=1e-8
        )


def _exact_eigenvalues(matrix: FloatArray) -> FloatArray:
    """Eigenvalues by Jacobi rotations, which keep the relative accuracy of graded matrices (Demmel
    and Veselic 1992).
    """
    matrix = matrix.astype(np.longdouble)
    size = len(matrix)
    for _ in range(30):
        for p in range(size - 1):
            for q in range(p + 1, size):
                if abs(matrix[p, q]) < 1e-18 * np.sqrt(matrix[p, p] * matrix[q, q]):
                    continue
                theta = (matrix[q, q] - matrix[p, p]) / (2 * matrix[p, q])
                t = (
                    np.sign(theta) / (np.abs(theta) + np.hypot(theta, 1))
                    if theta != 0
                    else np.longdouble(1)
                )
                c = 1 / np.sqrt(t**2 + 1)
                rotation = np.array([[c, t * c], [-t * c, c]])
                matrix[[p, q], :] = rotation.T @ matrix[[p, q], :]
                matrix[:, [p, q]] = matrix[:, [p, q]] @ rotation
                matrix[p, q] = matrix[q, p] = 0
    return np.sort(matrix.diagonal())


@pytest.mark.parametrize("what", ["mass", "stiffness"])
def test_an_unsymmetric_matrix_is_refused_and_not_symmetrised(what: str) -> None:
    matrices = {"mass": np.eye(4), "stiffness": 1e6 * np.eye(4)}
    matrices[what][0, 1] = 1e-9 * matrices[what][0, 0]
    with pytest.raises(ModelError, match=f"the {what} matrix is not symmetric"):
        solve_modal(system_of(**matrices))


@pytest.mark.parametrize("rounding", [-1e-12, 1e-12])
def test_rounding_does_not_choose_the_sign_of_a_shape_with_equal_entries(rounding: float) -> None:
    stiffness = np.array([[2.0, -1.0], [-1.0, 2.0 + rounding]])
    modes = solve_modal(system_of(np.eye(2), stiffness))
    assert np.sqrt(2.0) * modes.shapes == approx(np.array([[1.0, 1.0], [1.0, -1.0]]))


def test_answers_repeat_bitwise() -> None:
    system = random_system(30, seed=4)
    first, second = solve_modal(system), solve_modal(system)
    np.testing.assert_array_equal(first.frequencies_hz, second.frequencies_hz)
    np.testing.assert_array_equal(first.shapes, second.shapes)


def test_a_rougher_solve_keeps_low_frequencies_exact_and_all_shapes_orthogonal() -> None:
    """Over 11 decades of omega squared one LAPACK call is enough where high modes may be off."""
    stiffness = np.diag(np.geomspace(1e-2, 1e9, 40))
    turn = np.linalg.qr(np.random.default_rng(3).standard_normal((40, 40)))[0]
    mass = np.diag(np.linspace(1.0, 2.0, 40)) + 0.2 * turn @ turn[:, :5] @ turn[:, :5].T @ turn.T
    system = SecondOrderSystem(mass, None, stiffness, {}, {}, tuple(map(str, range(40))))
    fine, rough = solve_modal(system), solve_modal(system, resolved=1e-3)
    np.testing.assert_allclose(rough.frequencies_hz[:20], fine.frequencies_hz[:20], rtol=1e-9)
    np.testing.assert_allclose(rough.frequencies_hz, fine.frequencies_hz, rtol=1e-3)
    assert np.abs(rough.shapes.T @ mass @ rough.shapes - np.eye(40)).max() < 1e-12
    assert (rough.frequencies_hz != fine.frequencies_hz).any()  # it took another path


def make_system(size: int, *, free: bool = False, massless: bool = False) -> SecondOrderSystem:
    """A chain of masses on springs of every size, fixed at one end or free."""
    random = np.random.default_rng(size)
    springs = 10.0 ** random.uniform(4.0, 7.0, size)
    stretch = np.eye(size) - np.eye(size, k=-1)
    stretch = stretch[1:] if free else stretch
    stiffness = stretch.T @ (springs[: len(stretch), None] * stretch)
    masses = random.uniform(1.0, 5.0, size)
    masses[size // 2] = 0.0 if massless else masses[size // 2]
    return SecondOrderSystem(np.diag(masses), None, stiffness, {}, {}, tuple(map(str, range(size))))


@pytest.mark.parametrize("size", [8, 30, 200])
def test_few_modes_are_the_first_of_all(size: int) -> None:
    system = make_system(size)
    few, every = solve_lowest_modes(system, count=4), solve_modal(system)
    np.testing.assert_allclose(few.frequencies_hz, every.frequencies_hz[:4], rtol=1e-10)
    np.testing.assert_allclose(
        few.shapes, every.shapes[:, :4], atol=1e-6 * np.abs(every.shapes).max()
    )
    np.testing.assert_allclose(few.shapes.T @ system.mass @ few.shapes, np.eye(4), atol=1e-10)


def test_modes_up_to_a_frequency_are_all_of_them_and_no_others() -> None:
    system = make_system(60)
    every = solve_modal(system).frequencies_hz
    limit = 0.5 * (every[6] + every[7])
    np.testing.assert_allclose(
        solve_lowest_modes(system, up_to_hz=limit).frequencies_hz, every[:7], rtol=1e-10
    )
    assert len(solve_lowest_modes(system, up_to_hz=0.5 * every[0]).frequencies_hz) == 0
    assert len(solve_lowest_modes(system, up_to_hz=limit, count=3).frequencies_hz) == 3


def test_a_free_body_keeps_its_rigid_mode() -> None:
    system = make_system(20, free=True)
    few, every = solve_lowest_modes(system, count=5), solve_modal(system, count=5)
    assert few.rigid_count == every.rigid_count == 1
    np.testing.assert_allclose(few.frequencies_hz[1:], every.frequencies_hz[1:], rtol=1e-10)


def test_a_dof_without_mass_does_not_disturb_low_modes() -> None:
    system = make_system(20, massless=True)
    np.testing.assert_allclose(
        solve_lowest_modes(system, count=5).frequencies_hz,
        solve_modal(system, count=5).frequencies_hz,
        rtol=1e-9,
    )


def test_an_indefinite_system_is_refused() -> None:
    system = make_system(20)
    system.stiffness[0, 0] = -1e9
    with pytest.raises(ModelError):
        solve_lowest_modes(system, count=3)


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
