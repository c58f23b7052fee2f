"""Derivatives of eigenvalues, shapes and compliances agree with complex steps and high-order
differences.
"""

import numpy as np
import pytest
import scipy.linalg

from common import approx
from headstock.geometry.frames import FloatArray
from headstock.solvers.linear.modal_analysis import slope_shape, slope_squares

STEP = 1e-3
STENCIL = ((-2, 1 / 12), (-1, -2 / 3), (1, 2 / 3), (2, -1 / 12))


def chain(size: int, seed: int) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """A random stiffness and mass with random symmetric changes of both."""
    rng = np.random.default_rng(seed)
    factors = rng.standard_normal((4, size, size))
    stiffness, mass = (factor @ factor.T + size * np.eye(size) for factor in factors[:2])
    stiffness_slope, mass_slope = (0.5 * (factor + factor.T) for factor in factors[2:])
    return stiffness, mass, stiffness_slope, mass_slope


def modes(stiffness: FloatArray, mass: FloatArray) -> tuple[FloatArray, FloatArray]:
    eigenvalues, shapes = scipy.linalg.eigh(stiffness, mass)
    return eigenvalues, shapes


@pytest.mark.parametrize("seed", range(5))
def test_eigenvalue_slopes_are_those_of_a_complex_step(seed: int) -> None:
    stiffness, mass, stiffness_slope, mass_slope = chain(12, seed)
    eigenvalues, shapes = modes(stiffness, mass)
    slopes = slope_squares(shapes, stiffness_slope @ shapes - mass_slope @ shapes * eigenvalues)
    # a step along the imaginary axis cancels no digits
    moved = np.linalg.eigvals(
        np.linalg.solve(mass + 1e-8j * mass_slope, stiffness + 1e-8j * stiffness_slope)
    )
    moved = moved[np.argsort(moved.real)]
    assert slopes == approx(moved.imag / 1e-8, rel=1e-6, abs=1e-6 * np.abs(slopes).max())


@pytest.mark.parametrize("index", [0, 4, 8])
@pytest.mark.parametrize("seed", range(3))
def test_shape_slopes_are_those_of_fourth_order_differences(seed: int, index: int) -> None:
    stiffness, mass, stiffness_slope, mass_slope = chain(9, seed)
    eigenvalues, shapes = modes(stiffness, mass)
    shape = shapes[:, index]
    force = (stiffness_slope - eigenvalues[index] * mass_slope) @ shape
    slope = slope_shape(
        stiffness,
        mass,
        eigenvalues,
        shapes,
        index,
        forces=force[:, None],
        mass_terms=np.array([shape @ mass_slope @ shape]),
    )
    expected = np.zeros(9)
    for reach, weight in STENCIL:
        moved = modes(stiffness + reach * STEP * stiffness_slope, mass + reach * STEP * mass_slope)[
            1
        ][:, index]
        expected += weight / STEP * moved * np.sign(moved @ mass @ shape)
    assert slope[:, 0] == approx(expected, rel=1e-6, abs=1e-7 * np.abs(expected).max())


def test_shapes_of_a_repeated_eigenvalue_change_as_a_plane() -> None:
    """A square column: two equal bending modes, a third one they couple to; the plane they span has
    a definite slope.
    """
    stiffness, mass = np.diag([1.0, 1.0, 4.0]), np.eye(3)
    change = np.array([[0.0, 0.0, 0.3], [0.0, 0.0, -0.2], [0.3, -0.2, 0.0]])
    eigenvalues, shapes = modes(stiffness, mass)
    slopes = np.column_stack(
        [
            slope_shape(
                stiffness,
                mass,
                eigenvalues,
                shapes,
                index,
                forces=(change @ shapes[:, index])[:, None],
                mass_terms=np.zeros(1),
            )[:, 0]
            for index in (0, 1)
        ]
    )
    pair = shapes[:, :2]
    plane = slopes @ pair.T + pair @ slopes.T
    expected = np.zeros((3, 3))
    for reach, weight in STENCIL:
        moved = modes(stiffness + reach * STEP * change, mass)[1][:, :2]
        expected += weight / STEP * moved @ moved.T
    assert plane == approx(expected, abs=1e-8)


def test_a_repeated_eigenvalue_does_not_spoil_the_trace_of_the_slopes() -> None:
    """Each slope depends on the basis the solver chose, their sum does not."""
    rng = np.random.default_rng(3)
    change = rng.standard_normal((3, 3))
    change += change.T
    turn = scipy.linalg.qr(rng.standard_normal((2, 2)))[0]
    shapes = np.eye(3)
    shapes[:2, :2] = turn
    slopes = slope_squares(shapes, change @ shapes)
    assert slopes[:2].sum() == approx(change[0, 0] + change[1, 1], rel=1e-12)
