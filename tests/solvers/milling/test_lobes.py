"""Stability lobes: closed forms, the published directional factors, and Floquet multipliers by two
methods.
"""

import dataclasses

import numpy as np
import pytest

from headstock.geometry.frames import FloatArray
from headstock.scene.building.cutting import catalogue_coefficients
from headstock.solvers.milling import full_discretisation
from headstock.solvers.milling.forces import (
    CuttingCoefficients,
    EndMill,
    MillingCut,
)
from headstock.solvers.milling.full_discretisation import (
    cut_multiplier,
    node_gains,
    period_matrix,
    scan_limit_depth,
    step_response,
    steps_per_period,
)
from headstock.solvers.milling.lobes import (
    LobeDiagram,
    chatter_shapes,
    find_lobes,
    mean_cutting_stiffness,
)
from headstock.solvers.milling.stability import (
    TipDynamics,
    find_poles,
    largest_multiplier,
    milling_gains,
    tip_dynamics,
)
from headstock.solvers.second_order import ComplexArray

TURN = 2.0 * np.pi
# Insperger and Stepan (2004), Int. J. Numer. Meth. Eng. 61, 117-141, sec. 5: one mode, two teeth
MASS, HZ, ZETA = 0.03993, 922.0, 0.011
CHIP = CuttingCoefficients((6e8, 2e8, 0.0), (0.0, 0.0, 0.0), "Insperger and Stepan (2004)")
# the example of Altintas and Budak (1995): modes across each other, three teeth
PUBLISHED = ((603.0, 0.039, 5.59e6), (666.0, 0.035, 5.715e6))


def receptance(modes: tuple[tuple[float, float, float], ...], omega: FloatArray) -> ComplexArray:
    """A mode along, then one away; nothing moves up."""
    found = np.zeros((len(omega), 3, 3), dtype=complex)
    for axis, (hz, zeta, stiffness) in enumerate(modes):
        ratio = omega / (TURN * hz)
        found[:, axis, axis] = 1.0 / (stiffness * (1.0 - ratio**2 + 2j * zeta * ratio))
    return found


def tip_of(modes: tuple[tuple[float, float, float], ...]) -> TipDynamics:
    hz, zeta, stiffness = (np.array(column) for column in zip(*modes, strict=True))
    mass = stiffness / (TURN * hz) ** 2
    rows = np.eye(3)[:, : len(modes)]
    return tip_dynamics(
        np.diag(mass),
        np.diag(2.0 * zeta * stiffness / (TURN * hz)),
        np.diag(stiffness),
        forced=rows,
        seen=rows[:2],
    )


ONE_MODE = ((HZ, ZETA, MASS * (TURN * HZ) ** 2),)


def lobes_of(
    modes: tuple[tuple[float, float, float], ...],
    mill: EndMill,
    radial_depth: float,
    speeds: FloatArray,
    *,
    lines: int = 4000,
) -> LobeDiagram:
    omega = TURN * np.linspace(20.0, 2000.0, lines)
    return find_lobes(
        lambda at: receptance(modes, at),
        omega,
        mean_cutting_stiffness(mill, CHIP, radial_depth),
        teeth=mill.teeth,
        speeds=speeds,
        deepest=0.05,
    )


def test_mean_stiffness_has_the_published_directional_factors() -> None:
    mill, ratio = EndMill(0.02, 3), 0.07
    coefficients = CuttingCoefficients((600e6, ratio * 600e6, 0.0), (0.0, 0.0, 0.0), "")
    for radial_depth in (0.002, 0.01, 0.017, 0.02):
        # Altintas and Budak (1995), eq. 11, of down-milling: from the start angle to half a turn
        start, end = np.pi - np.arccos(1.0 - 2.0 * radial_depth / mill.diameter), np.pi
        factors = [
            np.array(
                [
                    [
                        np.cos(2.0 * phi) - 2.0 * ratio * phi + ratio * np.sin(2.0 * phi),
                        -np.sin(2.0 * phi) - 2.0 * phi + ratio * np.cos(2.0 * phi),
                    ],
                    [
                        -np.sin(2.0 * phi) + 2.0 * phi + ratio * np.cos(2.0 * phi),
                        -np.cos(2.0 * phi) - 2.0 * ratio * phi - ratio * np.sin(2.0 * phi),
                    ],
                ]
            )
            / 2.0
            for phi in (end, start)
        ]
        expected = 0.5 * 600e6 * mill.teeth / TURN * (factors[0] - factors[1])
        found = mean_cutting_stiffness(mill, coefficients, radial_depth)
        np.testing.assert_allclose(found[:2], expected, rtol=1e-12, atol=1e-4)


def test_mean_stiffness_is_that_of_the_forces_with_any_helix() -> None:
    coefficients = catalogue_coefficients("al7075-t6-dry")
    for helix in (0.0, 0.5):
        mill = EndMill(0.02, 4, helix)
        cut = MillingCut(mill, coefficients, 1000.0, 0.01, 0.006)
        expected = milling_gains(cut, 400).mean(axis=0) / cut.axial_depth
        found = mean_cutting_stiffness(mill, coefficients, 0.006)
        # 3200 samples of a function that jumps where teeth enter
        np.testing.assert_allclose(found, expected, atol=5e-4 * np.abs(expected).max())


def test_limits_lie_on_the_border_in_closed_form() -> None:
    """Of one mode: a = 1 / (2 A Re G), with the speed at which the waves fit (Altintas 2012, 4.2)."""
    mill = EndMill(0.02, 2)
    gain = mean_cutting_stiffness(mill, CHIP, 0.02)[0, 0]
    chatter = TURN * HZ * np.array([1.008, 1.02, 1.05, 1.1])
    response = receptance(ONE_MODE, chatter)[:, 0, 0]
    depth = 0.5 / (gain * response.real)
    # exp(-i omega T) = 1 - 1 / (a A G)
    for waves in (0, 2):
        angle = -np.angle(1.0 - 1.0 / (depth * gain * response)) % TURN
        speeds = TURN * chatter / (mill.teeth * (angle + TURN * waves))
        found = lobes_of(ONE_MODE, mill, 0.02, np.sort(speeds))
        order = np.argsort(speeds)
        same = found.waves == waves
        assert same.sum() >= 2  # beyond the crossing of two lobes the other one is lower
        np.testing.assert_allclose(found.depths[same], depth[order][same], rtol=1e-6)
        np.testing.assert_allclose(found.chatter[same], chatter[order][same], rtol=1e-7)
        assert (found.depths[~same] < depth[order][~same]).all()


def test_lowest_limit_is_that_of_the_published_chain_of_formulas() -> None:
    """Half immersion, three teeth: a = -2 pi Lambda_R (1 + kappa^2) / (N K_t), minimised over the
    frequency (Altintas and Budak 1995, eqs. 18 to 24).
    """
    mill = EndMill(0.02, 3)
    omega = TURN * np.linspace(300.0, 1500.0, 200_001)
    response = receptance(PUBLISHED, omega)
    factors = mean_cutting_stiffness(mill, CHIP, 0.01)[:2] / (0.5 * 6e8 * 3 / TURN)
    a0 = (
        response[:, 0, 0]
        * response[:, 1, 1]
        * (factors[0, 0] * factors[1, 1] - factors[0, 1] * factors[1, 0])
    )
    a1 = factors[0, 0] * response[:, 0, 0] + factors[1, 1] * response[:, 1, 1]
    limits = []
    for sign in (1.0, -1.0):
        root = -(a1 + sign * np.sqrt(a1**2 - 4.0 * a0)) / (2.0 * a0)
        kappa = root.imag / root.real
        depth = -TURN * root.real * (1.0 + kappa**2) / (3 * 6e8)
        limits.append(depth[depth > 0.0].min())
    speeds: FloatArray = np.asarray(np.linspace(2000.0, 12000.0, 2000) * TURN / 60.0, dtype=float)
    found = lobes_of(PUBLISHED, mill, 0.01, speeds)
    assert found.lowest == pytest.approx(min(limits), rel=1e-4)
    assert found.depths.min() == pytest.approx(min(limits), rel=1e-3)


@pytest.mark.parametrize(("lines", "radial_depth"), [(200, 0.002), (200, 0.012), (400, 0.012)])
def test_no_limit_is_below_the_lowest_at_any_speed_which_is_that_of_one_mode(
    lines: int, radial_depth: float
) -> None:
    """2 k zeta (1 +- zeta) over the mean stiffness, from lines up to half a bandwidth apart."""
    _, zeta, stiffness = ONE_MODE[0]
    mill = EndMill(0.02, 2)
    speeds: FloatArray = np.asarray(np.linspace(2000.0, 12000.0, 2000) * TURN / 60.0, dtype=float)
    found = lobes_of(ONE_MODE, mill, radial_depth, speeds, lines=lines)
    mean = float(mean_cutting_stiffness(mill, CHIP, radial_depth)[0, 0])
    exact = 2.0 * stiffness * zeta * (1.0 - np.sign(mean) * zeta) / abs(mean)
    assert found.lowest == pytest.approx(exact, rel=1e-6)
    assert found.lowest <= found.depths.min() < 1.001 * found.lowest


def test_refinement_makes_limits_independent_of_the_grid() -> None:
    speeds: FloatArray = np.asarray(np.linspace(3000.0, 12000.0, 60) * TURN / 60.0, dtype=float)
    coarse, fine = (
        lobes_of(PUBLISHED, EndMill(0.02, 3), 0.01, speeds, lines=lines) for lines in (400, 8000)
    )
    np.testing.assert_allclose(coarse.depths, fine.depths, rtol=1e-3)


def test_both_discretisations_have_the_same_multipliers() -> None:
    tip = tip_of(PUBLISHED)
    for radial_depth, helix, teeth in (
        (0.001, 0.0, 2),
        (0.001, 0.5, 4),
        (0.01, 0.5, 3),
        (0.02, 0.0, 4),
    ):
        cut = MillingCut(EndMill(0.02, teeth, helix), CHIP, 700.0, 2e-3, radial_depth)
        expected = largest_multiplier(tip, milling_gains(cut, 100), cut.tooth_period)
        found = cut_multiplier(step_response(tip, cut.tooth_period, 100), cut)
        assert found == pytest.approx(expected, rel=1e-3)


def machine_tip(count: int) -> TipDynamics:
    """A tip with many modes in all directions, most of which matter little."""
    draw = np.random.default_rng(7)
    hz: FloatArray = np.asarray(np.geomspace(40.0, 2500.0, count), dtype=float)
    mass = np.full(count, 40.0)
    stiffness = mass * (TURN * hz) ** 2
    rows = draw.standard_normal((3, count))
    rows[:, count // 2 :] *= 0.3
    damping = np.diag(2.0 * 0.03 * mass * TURN * hz)
    return tip_dynamics(np.diag(mass), damping, np.diag(stiffness), forced=rows, seen=rows[:2])


def test_fast_multipliers_are_those_of_all_modes_and_the_whole_memory(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Poles that matter, a memory of polynomials and the dominant multipliers only, against
    exponentials of all states, every delayed output and all eigenvalues.
    """
    tip = machine_tip(30)
    poles = find_poles(tip)
    assert poles is not None
    cases = []
    for radial_depth, helix, teeth, speed in (
        (0.001, 0.0, 2, 500.0),
        (0.012, 0.5, 4, 320.0),
        (0.01, 0.5, 3, 900.0),
        (0.02, 0.0, 4, 700.0),
    ):
        for depth in (0.3e-3, 3e-3, 20e-3):
            cut = MillingCut(EndMill(0.02, teeth, helix), CHIP, speed, depth, radial_depth)
            steps = steps_per_period(600.0, cut.tooth_period)
            gains = node_gains(cut, steps)[0]
            stiffest = float(np.linalg.norm(gains, axis=(1, 2)).max())
            response = step_response(poles, cut.tooth_period, steps, stiffest=stiffest)
            cases.append((cut, steps, gains, cut_multiplier(response, cut)))
    monkeypatch.setattr(full_discretisation, "_memory", lambda nodes: np.eye(len(nodes)))
    stable = 0
    for cut, steps, gains, fast in cases:
        whole = period_matrix(step_response(tip, cut.tooth_period, steps), gains)
        slow = float(np.abs(np.linalg.eigvals(whole)).max())
        assert fast == pytest.approx(slow, rel=2e-3), cut
        assert (fast < 1.0) == (slow < 1.0)
        stable += slow < 1.0
    assert 0 < stable < len(cases)


def floquet_limit(
    modes: tuple[tuple[float, float, float], ...], cut: MillingCut, guess: float
) -> float:
    response = step_response(
        tip_of(modes), cut.tooth_period, steps_per_period(800.0, cut.tooth_period)
    )
    return scan_limit_depth(
        lambda depth: cut_multiplier(response, dataclasses.replace(cut, axial_depth=depth)),
        guess,
        0.05,
    )


def test_zeroth_order_is_exact_where_the_engagement_is_constant() -> None:
    """Four teeth in a full slot cut the same at every angle."""
    mill = EndMill(0.02, 4)
    speeds: FloatArray = np.asarray(np.array([4300.0, 8000.0]) * TURN / 60.0, dtype=float)
    found = lobes_of(PUBLISHED, mill, 0.02, speeds)
    for speed, depth in zip(speeds, found.depths, strict=True):
        cut = MillingCut(mill, CHIP, float(speed), depth, 0.02)
        assert floquet_limit(PUBLISHED, cut, depth) == pytest.approx(depth, rel=3e-3)


def test_a_border_is_found_by_few_secants_though_another_multiplier_is_larger_below_it() -> None:
    """The largest multiplier stays what it is up to a depth, then grows nearly as a line."""
    tried: list[float] = []

    def multiplier(depth: float) -> float:
        tried.append(depth)
        ratio = depth / 1.07e-3
        return float(np.exp(max(-7e-4, 0.02 * (ratio - 1.0) + 0.01 * (ratio - 1.0) ** 2)))

    assert scan_limit_depth(multiplier, 1e-3, 0.05) == pytest.approx(1.07e-3, rel=2e-4)
    assert len(tried) == len(set(tried)) <= 11
    known = (0.45e-3, 0.7e-3, 0.95e-3, 1.05e-3)
    tried.clear()
    found = scan_limit_depth(multiplier, 1e-3, 0.05, known)
    assert found == pytest.approx(1.07e-3, rel=2e-4)
    assert set(known) < set(tried) and len(set(tried) - set(known)) <= 6


def test_an_island_that_a_known_depth_lies_in_is_the_limit() -> None:
    def multiplier(depth: float) -> float:
        return 1.01 if 0.6e-3 < depth < 0.8e-3 or depth > 1.4e-3 else 0.99

    found = scan_limit_depth(multiplier, 1e-3, 0.05, (0.45e-3, 0.7e-3, 0.95e-3, 1.05e-3))
    assert found == pytest.approx(0.6e-3, rel=1e-3)


def test_flip_lobes_of_a_low_immersion_are_where_theory_has_them() -> None:
    """Near half the tooth frequency the multiplier that leaves the circle is -1, and the limit is
    well below that by one frequency (Davies et al. 2002).
    """
    mill = EndMill(0.02, 2)
    speed = TURN * 2.0 * 0.98 * HZ / mill.teeth  # teeth at nearly twice the natural frequency
    plain = float(lobes_of(ONE_MODE, mill, 0.001, np.array([speed, 1.01 * speed])).depths[0])
    cut = MillingCut(mill, CHIP, speed, 1e-3, 0.001)
    limit = floquet_limit(ONE_MODE, cut, plain)
    assert limit < 0.7 * plain
    response = step_response(tip_of(ONE_MODE), cut.tooth_period, 200)
    gains = node_gains(dataclasses.replace(cut, axial_depth=limit), 200)[0]
    values = np.linalg.eigvals(period_matrix(response, gains))
    assert abs(values[np.argmax(np.abs(values))] + 1.0) < 2e-3


def test_shares_of_both_modes_add_up_to_the_motion() -> None:
    speeds: FloatArray = np.asarray(np.linspace(3000.0, 9000.0, 20) * TURN / 60.0, dtype=float)
    stiffness = mean_cutting_stiffness(EndMill(0.02, 3), CHIP, 0.01)
    found = lobes_of(PUBLISHED, EndMill(0.02, 3), 0.01, speeds)
    response = receptance(PUBLISHED, found.chatter)
    shapes = chatter_shapes(response, stiffness, found.eigenvalues)
    parts = [
        np.einsum(
            "na,na->n",
            shapes.weights[:, [axis]],
            response[:, [axis], axis] * shapes.forces[:, [axis]],
        )
        for axis in range(2)
    ]
    np.testing.assert_allclose(sum(parts), 1.0, atol=1e-6)
