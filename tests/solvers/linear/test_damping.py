"""Complex modes against closed forms and polynomial roots; hard case H29."""

import numpy as np
import pytest

from common import approx
from headstock.geometry.frames import FloatArray
from headstock.solvers.linear.damping import damping_of_undamped, solve_damped
from headstock.solvers.second_order import SecondOrderSystem


def _system(
    mass: FloatArray, damping: FloatArray | None, stiffness: FloatArray
) -> SecondOrderSystem:
    return SecondOrderSystem(
        mass, damping, stiffness, {}, {}, tuple(str(i) for i in range(len(mass)))
    )


@pytest.mark.parametrize("zeta", [0.0, 1e-6, 0.02, 0.5, 0.999])
def test_one_mass_oscillates_at_the_damped_frequency(zeta: float) -> None:
    omega = 2.0 * np.pi * 80.0
    found = solve_damped(
        _system(np.eye(1) * 3.0, np.eye(1) * 6.0 * zeta * omega, np.eye(1) * 3.0 * omega**2)
    )
    assert found.poles == approx([complex(-zeta * omega, omega * np.sqrt(1.0 - zeta**2))], rel=1e-9)
    ratios, frequencies = damping_of_undamped(found, 1)
    assert ratios[0] == approx(zeta, abs=1e-12)
    assert frequencies[0] == approx(80.0 * np.sqrt(1.0 - zeta**2), rel=1e-9)


def test_an_overdamped_mass_keeps_both_real_roots() -> None:
    omega, zeta = 50.0, 3.0
    found = solve_damped(_system(np.eye(1), np.eye(1) * 2.0 * zeta * omega, np.eye(1) * omega**2))
    root = np.sqrt(zeta**2 - 1.0)
    assert np.sort(found.poles.real) == approx(
        [-omega * (zeta + root), -omega * (zeta - root)], rel=1e-9
    )
    assert found.frequencies_hz == approx([0.0, 0.0])
    assert damping_of_undamped(found, 1)[0][0] == approx(zeta, rel=1e-9)


def test_a_negative_damper_shows_as_a_negative_ratio() -> None:
    found = solve_damped(_system(np.eye(1), -np.eye(1), np.eye(1) * 1e4))
    assert found.damping_ratios[0] == approx(-0.005)


def test_a_dof_without_mass_follows_its_springs_as_long_as_no_damper_acts_on_it() -> None:
    # a mass on two springs in a row, nothing between them
    near, far, mass, dash = 3e4, 5e4, 2.0, 4.0
    stiffness = np.array([[near + far, -far], [-far, far]])
    found = solve_damped(_system(np.diag([0.0, mass]), np.diag([0.0, dash]), stiffness))
    series = near * far / (near + far)
    assert found.damping_ratios == approx([dash / (2.0 * np.sqrt(series * mass))], rel=1e-9)


@pytest.mark.parametrize("dash", [4.0, 400.0])
def test_a_damper_on_a_dof_without_mass_gives_the_roots_of_a_cubic(dash: float) -> None:
    # a massless point between two springs, held by a damper; a mass behind it
    near, far, mass = 3e4, 5e4, 2.0
    stiffness = np.array([[near + far, -far], [-far, far]])
    found = solve_damped(_system(np.diag([0.0, mass]), np.diag([dash, 0.0]), stiffness))
    point, body = np.poly1d([dash, near + far]), np.poly1d([mass, 0.0, far])
    roots = (point * body - far**2).roots
    expected = sorted((root for root in roots if root.imag >= 0.0), key=abs)
    # the little mass adds one pole far away
    assert found.poles[: len(expected)] == approx(expected, rel=1e-6)
    assert np.abs(found.poles[len(expected) :]).min() > 1e6 * np.abs(expected).min()


def _chain(size: int, strength: float) -> SecondOrderSystem:
    """Masses in a row from ground, with dampers at a third of them."""
    random = np.random.default_rng(7)
    springs = 1e6 * random.uniform(0.5, 2.0, size + 1)
    stiffness = (
        np.diag(springs[:-1] + springs[1:]) - np.diag(springs[1:-1], 1) - np.diag(springs[1:-1], -1)
    )
    damping = np.diag(
        np.where(np.arange(size) % 3 == 0, strength * random.uniform(0.1, 1.0, size), 0.0)
    )
    return _system(np.eye(size), damping, stiffness)


@pytest.mark.parametrize("strength", [0.1, 30.0, 3e3, 1e5])
def test_the_lowest_modes_alone_are_those_of_the_whole_state_matrix(strength: float) -> None:
    system = _chain(150, strength)
    few, whole = solve_damped(system, lowest=8), solve_damped(system)
    found, expected = (sum(damping_of_undamped(each, 8), ()) for each in (few, whole))
    assert len(found) == 16 and found == approx(expected, rel=1e-8)


def test_the_lowest_modes_of_a_lightly_damped_system_do_not_need_the_whole_state_matrix() -> None:
    assert len(solve_damped(_chain(150, 30.0), lowest=8).poles) < 40


def test_a_negative_damper_on_a_high_mode_is_seen_when_only_the_lowest_are_wanted() -> None:
    system = _chain(150, 30.0)
    stiffness = system.stiffness.copy()
    stiffness[149, 149] += 1e9
    damping = system.damping.copy() if system.damping is not None else np.zeros((150, 150))
    damping[149, 149] = -50.0
    assert solve_damped(_system(system.mass, damping, stiffness), lowest=8).poles.real.max() > 1.0


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("brake", [0.0, 3.0])
def test_a_free_motion_is_at_rest_or_comes_to_rest_and_never_grows(brake: float, seed: int) -> None:
    """Two bodies on a spring with a damper, free to move together, on stiff and soft springs
    inside; a brake to ground or none.
    """
    random = np.random.default_rng(seed)
    springs = 10.0 ** random.uniform(4.0, 9.0, 11)
    stiffness = (
        np.diag(np.append(springs, 0.0) + np.append(0.0, springs))
        - np.diag(springs, 1)
        - np.diag(springs, -1)
    )
    line = np.zeros(12)
    line[[2, 7]] = 1.0, -1.0
    damping = 300.0 * np.outer(line, line)
    damping[0, 0] += brake
    found = solve_damped(_system(np.diag(random.uniform(0.5, 5.0, 12)), damping, stiffness))
    slowest = np.abs(found.poles[found.frequencies_hz > 0.0]).min()
    assert found.poles.real.max() <= 1e-6 * slowest
    if not brake:
        assert (found.poles[:2] == 0.0).all() and found.poles.real.max() <= 0.0
