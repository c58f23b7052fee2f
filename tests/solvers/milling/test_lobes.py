"""Stability lobes by a single frequency: closed forms and the published directional factors."""

import numpy as np
import pytest

from common import approx
from headstock.geometry.frames import FloatArray
from headstock.scene.building.cutting import catalogue_coefficients
from headstock.solvers.milling.coefficients import CuttingCoefficients
from headstock.solvers.milling.forces import EndMill, MillingCut
from headstock.solvers.milling.lobes import (
    LobeDiagram,
    chatter_shapes,
    find_lobes,
    mean_cutting_stiffness,
)
from headstock.solvers.second_order import ComplexArray
from headstock.validation.mechanisms.semi_discretisation import milling_gains

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


ONE_MODE = ((HZ, ZETA, MASS * (TURN * HZ) ** 2),)


def cut_of(
    mill: EndMill, radial_depth: float, coefficients: CuttingCoefficients = CHIP
) -> MillingCut:
    return MillingCut(mill, coefficients, 1.0, 0.0, radial_depth)


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
        mean_cutting_stiffness(cut_of(mill, radial_depth)),
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
        found = mean_cutting_stiffness(cut_of(mill, radial_depth, coefficients))
        np.testing.assert_allclose(found[:2], expected, rtol=1e-12, atol=1e-4)


def test_mean_stiffness_is_that_of_the_forces_with_any_helix() -> None:
    coefficients = catalogue_coefficients("al7075-t6-dry")
    for helix in (0.0, 0.5):
        mill = EndMill(0.02, 4, helix)
        cut = MillingCut(mill, coefficients, 1000.0, 0.01, 0.006)
        expected = milling_gains(cut, 400).mean(axis=0) / cut.axial_depth
        found = mean_cutting_stiffness(cut)
        # 3200 samples of a function that jumps where teeth enter
        np.testing.assert_allclose(found, expected, atol=5e-4 * np.abs(expected).max())


@pytest.mark.parametrize("waves", [0, 2])
def test_limits_lie_on_the_border_in_closed_form(waves: int) -> None:
    """Of one mode: a = 1 / (2 A Re G), with the speed at which the waves fit (Altintas 2012, 4.2)."""
    mill = EndMill(0.02, 2)
    gain = mean_cutting_stiffness(cut_of(mill, 0.02))[0, 0]
    chatter = TURN * HZ * np.array([1.008, 1.02, 1.05, 1.1])
    response = receptance(ONE_MODE, chatter)[:, 0, 0]
    depth = 0.5 / (gain * response.real)
    # exp(-i omega T) = 1 - 1 / (a A G)
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
    factors = mean_cutting_stiffness(cut_of(mill, 0.01))[:2] / (0.5 * 6e8 * 3 / TURN)
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
    assert found.depths.min() == approx(min(limits), rel=1e-3)


def test_refinement_makes_limits_independent_of_the_grid() -> None:
    speeds: FloatArray = np.asarray(np.linspace(3000.0, 12000.0, 60) * TURN / 60.0, dtype=float)
    coarse, fine = (
        lobes_of(PUBLISHED, EndMill(0.02, 3), 0.01, speeds, lines=lines) for lines in (400, 8000)
    )
    np.testing.assert_allclose(coarse.depths, fine.depths, rtol=1e-3)


def test_shares_of_both_modes_add_up_to_the_motion() -> None:
    speeds: FloatArray = np.asarray(np.linspace(3000.0, 9000.0, 20) * TURN / 60.0, dtype=float)
    stiffness = mean_cutting_stiffness(cut_of(EndMill(0.02, 3), 0.01))
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
