import numpy as np
import pytest
from elastic_pencils import Operator, eigen_problem

from common import approx
from headstock.geometry.frames import FloatArray
from headstock.solvers.elastic.block_lanczos import block_lanczos_pairs
from headstock.solvers.elastic.eigenpairs import EigenPairs, ModeTarget, cluster_end
from headstock.solvers.errors import ConvergenceError

SIZE = 400
# K^-1 and M as operators
Pencil = tuple[FloatArray, Operator, Operator]


@pytest.fixture(scope="module")
def pencil() -> Pencil:
    rng = np.random.default_rng(4)
    values = np.cumsum(rng.uniform(0.5, 2.0, SIZE)) ** 2
    shapes = np.linalg.qr(rng.standard_normal((SIZE, SIZE)))[0]
    weights = rng.uniform(0.5, 2.0, SIZE)
    # M = diag(w), K = M^1/2 Q L Q^T M^1/2
    root = np.sqrt(weights)[:, None]
    inverse = (shapes / values) @ shapes.T / root / root.T
    return values, lambda x: inverse @ x, lambda x: weights[:, None] * x


def search(
    pencil: Pencil, target: ModeTarget, width: int = 6, seed: int = 0, dimension: int = SIZE
) -> EigenPairs:
    _, inverse, mass = pencil
    start = np.random.default_rng(seed).standard_normal((SIZE, width))
    return block_lanczos_pairs(eigen_problem(inverse, mass, SIZE, dimension), start, target)


@pytest.mark.parametrize("width", [1, 4, 12])
def test_the_lowest_pairs_come_out_whatever_the_width_of_the_block(
    pencil: Pencil, width: int
) -> None:
    found = search(pencil, ModeTarget(count=20), width)
    np.testing.assert_allclose(found.values, pencil[0][: len(found.values)], rtol=1e-10)
    assert len(found.values) >= 20


def test_vectors_are_orthonormal_in_the_mass(pencil: Pencil) -> None:
    found = search(pencil, ModeTarget(count=20))
    gram = found.vectors.T @ pencil[2](found.vectors)
    np.testing.assert_allclose(gram, np.eye(len(gram)), atol=1e-11)


def test_residuals_are_as_small_as_the_bounds_say(pencil: Pencil) -> None:
    values, inverse, mass = pencil
    found = search(pencil, ModeTarget(count=15))
    flexibilities = 1.0 / found.values
    rest = inverse(mass(found.vectors)) - found.vectors * flexibilities
    sizes = np.sqrt(np.einsum("ij,ij->j", rest, mass(rest))) / flexibilities
    assert (sizes < found.residuals + 1e-12 * values[20] / values[0]).all()


def test_one_more_step_than_was_solved_for_is_in_the_shapes(pencil: Pencil) -> None:
    found = search(pencil, ModeTarget(count=20), width=4)
    exact = search(pencil, ModeTarget(count=40), width=4).vectors[:, :20]
    exact *= np.sign(np.einsum("ij,ij->j", exact, pencil[2](found.vectors)))
    off = found.vectors - exact
    sizes = np.sqrt(np.einsum("ij,ij->j", off, pencil[2](off)))
    assert found.solves <= 64 and found.residuals.max() > 1e-6
    assert sizes.max() < 0.2 * found.residuals.max()


def test_a_frequency_target_is_complete_up_to_it(pencil: Pencil) -> None:
    limit = np.sqrt(pencil[0][11] * 1.0001) / (2.0 * np.pi)
    found = search(pencil, ModeTarget(up_to_hz=limit))
    assert len(found.values) >= 12
    assert found.next_value > (2.0 * np.pi * limit) ** 2


def test_all_pairs_of_a_small_space_are_found_and_none_follows(pencil: Pencil) -> None:
    found = search(pencil, ModeTarget(count=SIZE))
    np.testing.assert_allclose(found.values, pencil[0], rtol=1e-7)
    assert found.next_value == np.inf


def test_a_target_beyond_the_limit_of_the_search_is_refused_with_what_was_reached() -> None:
    # 1500 frequencies below the limit, of which a search by frequency takes a thousand vectors at
    # most
    values = np.linspace(1.0, 9.0, 1500)[:, None]
    start = np.random.default_rng(0).standard_normal((1500, 125))
    target = ModeTarget(up_to_hz=0.5)
    with pytest.raises(ConvergenceError, match="ask for fewer modes"):
        block_lanczos_pairs(eigen_problem(lambda x: x / values, lambda x: x, 1500), start, target)


def test_a_space_that_closes_early_is_widened_until_every_mode_is_found() -> None:
    # only three different values: from two directions no more than six vectors can be reached
    values = np.repeat([1.0, 4.0, 9.0], 20)
    start = np.random.default_rng(8).standard_normal((60, 2))
    problem = eigen_problem(lambda x: x / values[:, None], lambda x: x, 60)
    found = block_lanczos_pairs(problem, start, ModeTarget(count=25))
    np.testing.assert_allclose(found.values, values[: len(found.values)], rtol=1e-9)
    assert len(found.values) == 40


@pytest.mark.parametrize(("count", "end"), [(0, 0), (1, 1), (2, 4), (3, 4), (4, 4), (5, 5)])
def test_a_cluster_is_never_cut(count: int, end: int) -> None:
    assert cluster_end(np.array([1.0, 2.0, 2.004, 2.009, 3.0]), count) == end


def test_a_spectrum_without_gaps_is_cut_at_its_widest_soon_after_the_modes_wanted(
    pencil: Pencil,
) -> None:
    # the widest gap is the one after 15
    frequencies = np.cumprod(np.where(np.arange(200) == 15, 1.004, 1.001))
    assert cluster_end(frequencies, 6) == 15


@pytest.mark.slow
@pytest.mark.trials
def test_of_a_count_no_more_are_found_than_converge_and_the_next_lies_above_its_bound() -> None:
    values = np.concatenate([[1.0, 2.0], 4.0 + 1e-6 * np.arange(1198) ** 1.5])
    start = np.random.default_rng(3).standard_normal((1200, 6))
    problem = eigen_problem(lambda x: x / values[:, None], lambda x: x, 1200)
    found = block_lanczos_pairs(problem, start, ModeTarget(count=6))
    assert not found.complete
    np.testing.assert_allclose(found.values, values[: len(found.values)], rtol=1e-9)
    assert len(found.values) >= 2 and found.next_value <= values[len(found.values)] * (1.0 + 1e-9)


def test_with_a_frequency_and_a_count_the_fewer_are_found(pencil: Pencil) -> None:
    limit = np.sqrt(pencil[0][11] * 1.0001) / (2.0 * np.pi)
    assert len(search(pencil, ModeTarget(count=5, up_to_hz=limit)).values) < 12
    assert len(search(pencil, ModeTarget(count=50, up_to_hz=limit)).values) == len(
        search(pencil, ModeTarget(up_to_hz=limit)).values
    )
    few = search(pencil, ModeTarget(count=5, up_to_hz=limit))
    assert few.next_value == approx(pencil[0][len(few.values)], rel=1e-3)
