"""Poles in a circle against all poles of the whole state matrix: none missing, however damped."""

import numpy as np
import pytest

from common import approx
from headstock.geometry.frames import FloatArray
from headstock.solvers.linear.damping import damping_of_undamped, solve_damped
from headstock.solvers.linear.quadratic_poles import SMALL, _find_poles_within, state_eigenpairs
from headstock.solvers.second_order import ComplexArray, SecondOrderSystem

pytestmark = pytest.mark.slow

SIZE, INSIDE = 240, 24


def _modal(strength: float, kind: str) -> tuple[FloatArray, FloatArray]:
    """Squares and damping of a chain in modal coordinates: dashpots at some masses, or a loss
    factor that differs from spring to spring; ``equals`` are two equal chains.
    """
    random = np.random.default_rng(3)
    size = SIZE // 2 if kind == "repeated" else SIZE
    springs = 1e6 * random.uniform(0.5, 2.0, size + 1)
    stiffness = np.diag(springs[:-1] + springs[1:])
    stiffness -= np.diag(springs[1:-1], 1) + np.diag(springs[1:-1], -1)
    eigenvalues, shapes = np.linalg.eigh(stiffness)
    if kind == "losses":
        losses = np.diag(np.sqrt(random.uniform(0.0, 1.0, size)))
        damping = strength * 1e-6 * losses @ stiffness @ losses
    else:
        damping = np.zeros((size, size))
        places = random.choice(size, size // 20, replace=False)
        damping[places, places] = strength * random.uniform(0.2, 1.0, len(places))
    modal = shapes.T @ damping @ shapes
    if kind == "repeated":
        eigenvalues = np.repeat(eigenvalues, 2)
        modal = np.kron(modal, np.eye(2))
    return eigenvalues, 0.5 * (modal + modal.T)


def _all_within(eigenvalues: FloatArray, viscous: FloatArray, radius: float) -> ComplexArray:
    poles, _ = state_eigenpairs(eigenvalues, viscous)
    real = np.abs(poles.imag) <= 1e-6 * np.abs(poles)  # equal ones may come as a conjugate pair
    return np.asarray(poles[(real | (poles.imag > 0.0)) & (np.abs(poles) <= radius)])


@pytest.mark.parametrize("kind", ["dashpots", "losses", "repeated"])
@pytest.mark.parametrize("strength", [0.1, 30.0, 1e3, 3e4, 1e7])
def test_no_pole_in_the_circle_is_missing_or_off(kind: str, strength: float) -> None:
    eigenvalues, viscous = _modal(strength, kind)
    radius = 0.5 * float(np.sqrt(eigenvalues[INSIDE - 1]) + np.sqrt(eigenvalues[INSIDE]))
    expected = _all_within(eigenvalues, viscous, radius)
    found = _find_poles_within(eigenvalues, viscous, radius, tolerance=1e-10)
    if found is None:
        # nearly all motions creep in the circle: as many poles as a whole state matrix has
        assert strength >= 3e4 and kind == "losses"
        return
    assert len(found.poles) == len(expected) > 5
    # what a state matrix of such norm resolves
    rounding = 1e-15 * float(np.abs(viscous).max())
    for pole in expected:
        near = found.poles[np.argmin(np.abs(found.poles - pole))]
        assert abs(near - pole) <= 1e-8 * abs(pole) + rounding
        if pole.imag > 1e-6 * abs(pole):
            assert near.imag == approx(pole.imag, rel=1e-8)
            assert near.real / abs(near) == approx(
                pole.real / abs(pole), rel=1e-8, abs=1e-11 + rounding / abs(pole)
            )
    matched = {int(np.argmin(np.abs(expected - pole))) for pole in found.poles}
    if kind != "repeated":
        assert len(matched) == len(expected)
    residuals = (found.poles**2 + eigenvalues[:, None]) * found.shapes
    residuals += found.poles * (viscous @ found.shapes)
    weights = eigenvalues[:, None] + np.abs(found.poles) ** 2
    assert np.abs(residuals / weights).max() < 1e-3


def test_a_negative_damper_is_left_to_the_whole_state_matrix() -> None:
    eigenvalues, viscous = _modal(30.0, "dashpots")
    viscous -= 0.5 * np.eye(SIZE)
    assert (
        _find_poles_within(eigenvalues, viscous, float(np.sqrt(eigenvalues[20])), tolerance=1e-9)
        is None
    )


@pytest.mark.parametrize("strength", [0.1, 30.0, 300.0])
def test_damping_of_undamped_modes_is_that_of_the_whole_state_matrix(strength: float) -> None:
    eigenvalues, viscous = _modal(strength, "dashpots")
    assert len(eigenvalues) > SMALL
    names = tuple(map(str, range(SIZE)))
    system = SecondOrderSystem(np.eye(SIZE), viscous, np.diag(eigenvalues), {}, {}, names)
    few, whole = solve_damped(system, lowest=12), solve_damped(system)
    assert len(few.poles) < 0.5 * len(whole.poles)
    for found, expected in zip(
        damping_of_undamped(few, 12), damping_of_undamped(whole, 12), strict=True
    ):
        assert len(found) == 12 and found == approx(expected, rel=1e-8)


def test_the_fast_pole_of_an_overdamped_mode_is_found_beyond_the_circle() -> None:
    eigenvalues = np.linspace(1.0, 300.0, SIZE) ** 2
    viscous = np.diag(0.02 * np.sqrt(eigenvalues))
    viscous[3, 3] = 8.0 * np.sqrt(eigenvalues[3])
    system = SecondOrderSystem(
        np.eye(SIZE), viscous, np.diag(eigenvalues), {}, {}, tuple(map(str, range(SIZE)))
    )
    ratios, frequencies = damping_of_undamped(solve_damped(system, lowest=6), 6)
    assert ratios == approx([0.01, 0.01, 0.01, 4.0, 0.01, 0.01], rel=1e-9)
    assert frequencies[3] == 0.0


def test_defective_poles_of_critical_dampers_and_poles_that_nearly_meet_are_all_there() -> None:
    eigenvalues, viscous = _modal(30.0, "dashpots")
    # modes 3 and 4 stand alone, critically damped; 7 and 8 have one frequency to seven digits
    eigenvalues[8] = eigenvalues[7] * (1.0 + 1e-7)
    viscous[[3, 4]] = viscous[:, [3, 4]] = 0.0
    omega = np.sqrt(eigenvalues[[3, 4]])
    viscous[[3, 4], [3, 4]] = 2.0 * omega
    radius = 0.5 * float(np.sqrt(eigenvalues[INSIDE - 1]) + np.sqrt(eigenvalues[INSIDE]))
    expected = _all_within(eigenvalues, viscous, radius)
    found = _find_poles_within(eigenvalues, viscous, radius, tolerance=1e-10)
    assert found is not None
    for double in omega:
        # half the digits, as both parts of a defective pole move with the root of rounding
        near = found.poles[np.abs(found.poles + double) <= 1e-6 * double]
        assert near.sum().real == approx(-double * len(near), rel=1e-9) and len(near) in (1, 2)
    apart = [p for p in expected if np.abs(p + omega).min() > 1e-6 * omega[0]]
    rest = [p for p in found.poles if np.abs(p + omega).min() > 1e-6 * omega[0]]
    assert len(rest) == len(apart) > 20
    for pole in apart:
        assert np.abs(found.poles - pole).min() <= 1e-9 * abs(pole)
    assert len({int(np.argmin(np.abs(np.array(rest) - pole))) for pole in apart}) == len(apart)


@pytest.mark.parametrize(
    "seed", [*range(4), *(pytest.param(seed, marks=pytest.mark.trials) for seed in range(4, 12))]
)
def test_poles_of_lattices_with_equal_springs_and_dampers_of_any_strength(seed: int) -> None:
    random = np.random.default_rng(seed)
    line = np.diag(np.full(7, 2e6)) - np.diag(np.full(6, 1e6), 1) - np.diag(np.full(6, 1e6), -1)
    plane = np.kron(line, np.eye(7)) + np.kron(np.eye(7), line)
    stiffness = np.kron(plane, np.eye(5)) + np.kron(np.eye(49), line[:5, :5])
    eigenvalues, shapes = np.linalg.eigh(stiffness)
    damping = np.zeros_like(stiffness)
    places = random.choice(len(stiffness), 8, replace=False)
    damping[places, places] = 10.0 ** random.uniform(-1.0, 5.0)
    viscous = shapes.T @ damping @ shapes
    viscous = (
        0.5 * (viscous + viscous.T) + random.uniform(0.0, 2.0) * np.diag(np.sqrt(eigenvalues)) / 50
    )
    radius = 1.02 * float(np.sqrt(eigenvalues[int(random.integers(5, 40))]))
    if seed % 2:
        # the rim passes a pole by a millionth
        rim = float(np.abs(_all_within(eigenvalues, viscous, radius)).max())
        radius = rim * (1.0 + random.choice([-1e-6, 1e-6]))
    found = _find_poles_within(eigenvalues, viscous, radius, tolerance=1e-10)
    assert found is not None
    expected = _all_within(eigenvalues, viscous, radius)
    assert len(found.poles) == len(expected)
    rounding = 1e-15 * float(np.abs(viscous).max())
    for pole in expected:
        close = 1e-8 * abs(pole) + rounding
        # repeated ones as often as they are
        assert np.count_nonzero(np.abs(found.poles - pole) <= 3.0 * close) >= np.count_nonzero(
            np.abs(expected - pole) <= close
        )
