"""Matrices along an axis: splines of rows, patterns of damping, one basis of unit mass."""

import numpy as np

from common import approx
from headstock.geometry.frames import FloatArray
from headstock.solvers.state_spaces.varying_matrices import (
    Knots,
    PosedMatrices,
    VaryingMatrices,
    VaryingSpring,
    add_springs,
    find_largest_error,
    lay_field,
    respond_posed,
    span_motions,
    split_patterns,
)

PLACES = np.array([-0.2, -0.05, 0.1, 0.2])


def rows_at(place: float) -> FloatArray:
    """A spring on a lever that grows, whose rigid turn about ``place`` stretches nothing."""
    return np.array([[1.0, -place, place**3]])


def test_interpolated_rows_keep_rigid_motions_free_and_stiffness_would_not() -> None:
    stiffness = np.array([[4e6]])
    constant = [np.array([[0.0]])] * len(PLACES)
    spring = VaryingSpring(
        lay_field([rows_at(place) for place in PLACES], [len(PLACES)], 0),
        lay_field([stiffness] * len(PLACES), [len(PLACES)], 0),
        lay_field(constant, [len(PLACES)], 0),
    )
    none = lay_field([np.zeros((1, 3))] * 2, [2], 1)
    knots, ends = {"X": Knots(PLACES)}, {"X": Knots(PLACES[[0, -1]])}
    further = lay_field([np.array([1.0]), np.array([3.0])], [2], 1)
    zero = np.zeros((3, 3))
    system = VaryingMatrices(
        (knots, ends), zero, zero, (spring,), np.eye(3)[None], further, none, none
    )
    found = system.at({"X": 0.03})
    exact = add_springs(zero, [(rows_at(0.03), stiffness)])
    assert found.stiffness == approx(exact, rel=1e-12)
    assert found.damping == approx((2.0 + 0.03 / 0.2) * np.eye(3), rel=1e-12)
    assert np.linalg.eigvalsh(found.stiffness)[:2] == approx(0.0, abs=1e-6)
    assert not spring.stiffness.varies and spring.rows.varies


def test_patterns_sum_to_the_damping() -> None:
    random = np.random.default_rng(0)
    parts = random.standard_normal((2, 5, 5))
    amounts = random.standard_normal((7, 2))
    matrices = np.einsum("nr,rij->nij", amounts, parts + parts.transpose(0, 2, 1))
    shares, patterns = split_patterns(matrices, random.uniform(0.5, 2.0, 5))
    assert patterns.shape == (2, 5, 5)
    assert np.einsum("nr,rij->nij", shares, patterns) == approx(matrices, abs=1e-12)


def test_a_basis_has_unit_mass_and_slows_only_what_is_far_too_fast() -> None:
    omega = 2.0 * np.pi * np.array([0.0, 30.0, 80.0, 900.0, 1e6])
    mass = np.diag([2.0, 3.0, 1.0, 5.0, 1.0])
    stiffness = mass * omega**2
    basis = span_motions(stiffness, stiffness, mass, 100.0)
    moved = basis.T @ mass @ basis
    found = np.sort(np.linalg.eigvals(np.linalg.inv(np.eye(5)) @ basis.T @ stiffness @ basis))
    assert np.diag(moved)[np.argsort(np.diag(moved))][1:] == approx(1.0, abs=1e-9)
    assert np.sqrt(np.abs(found[1:4])) == approx(omega[1:4], rel=1e-6)
    assert np.sqrt(found[4]) == approx(2.0 * np.pi * 2000.0, rel=0.01)


def test_errors_are_shares_of_the_response_at_their_frequency() -> None:
    loads = np.array([[1.0], [0.5]])
    one = PosedMatrices(np.diag([1e4, 4e4]), np.diag([2.0, 4.0]), loads, loads.T)
    other = one._replace(loads=1.02 * loads)
    omega = np.array([10.0, 100.0, 200.0])
    exact = respond_posed(one, omega)
    error = find_largest_error(exact, respond_posed(other, omega), np.ones((1, 1)))
    assert error == approx(0.02, rel=1e-9)
