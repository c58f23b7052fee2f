import dataclasses

import numpy as np
import pytest

from common import approx
from headstock.geometry.frames import FloatArray
from headstock.solvers.errors import ModelError
from headstock.solvers.milling.forces import (
    CuttingCoefficients,
    EndMill,
    MillingCut,
    Sense,
    chip_stiffness,
    cutting_forces,
    engaged,
    engagement_angles,
    regeneration_stiffness,
    repeated_forces,
    tooth_angles,
)

COEFFICIENTS = CuttingCoefficients((600.46e6, 180.96e6, 90e6), (17.9e3, 20.42e3, 1e3), "test")
CUT = MillingCut(
    EndMill(0.02, 4, np.radians(30.0)), COEFFICIENTS, 13000.0 * 2.0 * np.pi / 60.0, 0.01, 0.005
)
FEED = 5.0 / 60.0


def one_turn(cut: MillingCut, count: int) -> tuple[FloatArray, FloatArray]:
    times = np.arange(count) * cut.tooth_period * cut.mill.teeth / count
    return times, np.full(count, FEED)


def test_mean_forces_are_those_of_the_integral_over_the_immersion() -> None:
    times, feed = one_turn(CUT, 7200)
    chip, low, high = FEED * CUT.tooth_period, np.radians(-90.0), np.radians(-30.0)
    (ktc, krc, kac), (kte, kre, kae) = COEFFICIENTS.chip, COEFFICIENTS.edge
    square, mixed = (
        0.5 * (high - low) + 0.25 * (np.sin(2 * high) - np.sin(2 * low)),
        0.5 * (np.sin(high) ** 2 - np.sin(low) ** 2),
    )
    sine, cosine = np.cos(low) - np.cos(high), np.sin(high) - np.sin(low)
    scale = CUT.mill.teeth * CUT.axial_depth / (2.0 * np.pi)
    along = scale * (-ktc * chip * mixed - kte * sine - krc * chip * square - kre * cosine)
    away = scale * (ktc * chip * square + kte * cosine - krc * chip * mixed - kre * sine)
    down = -scale * (kac * chip * cosine + kae * (high - low))
    assert np.allclose(
        cutting_forces(CUT, times, feed).mean(axis=0), [along, away, down], rtol=2e-3, atol=0.0
    )


@pytest.mark.parametrize("sense", ["down", "up"])
@pytest.mark.parametrize("immersion", [0.1, 0.6, 1.0])
def test_energy_of_a_turn_is_that_of_the_chips_and_the_edges(
    sense: Sense, immersion: float
) -> None:
    mill = EndMill(0.02, 1)
    cut = dataclasses.replace(CUT, mill=mill, radial_depth=immersion * 0.02, sense=sense)
    times, feed = one_turn(cut, 36000)
    theta = tooth_angles(cut, times)[0][:, 0, 0]
    # the edge moves against the force on the tool: towards falling angles milling down
    edge = 0.01 * cut.spin * np.stack([np.sin(theta), -np.cos(theta)], axis=-1)
    force = cutting_forces(cut, times, feed)[:, :2]
    work = -(force * edge).sum() * 2.0 * np.pi / len(times)
    arc = np.arccos(1.0 - 2.0 * immersion)
    removed = FEED * cut.tooth_period * cut.radial_depth * cut.axial_depth
    expected = COEFFICIENTS.chip[0] * removed + COEFFICIENTS.edge[0] * 0.01 * arc * cut.axial_depth
    assert work == approx(expected, rel=1e-3)


def test_milling_down_a_tooth_leaves_at_the_finished_face_and_up_it_enters_there() -> None:
    angles = engagement_angles(CUT.mill, CUT.radial_depth)
    assert np.degrees(angles) == approx([-90.0, -30.0])
    mill = EndMill(0.02, 1)
    senses: dict[Sense, tuple[float, float]] = {"down": (-30.0, -90.0), "up": (-90.0, -30.0)}
    for sense, (first, last) in senses.items():
        cut = dataclasses.replace(CUT, mill=mill, sense=sense)
        theta = tooth_angles(cut, one_turn(cut, 3600)[0])[0][:, 0, 0]
        inside = np.degrees(np.mod(theta[engaged(cut, theta) > 0.0] + np.pi, 2 * np.pi) - np.pi)
        assert (inside[0], inside[-1]) == approx((first, last), abs=0.2)


def test_up_milling_is_down_milling_with_the_tangential_force_and_the_time_turned_round() -> None:
    times, feed = one_turn(CUT, 960)
    up = dataclasses.replace(CUT, sense="up")
    (ktc, krc, kac), (kte, kre, kae) = COEFFICIENTS.chip, COEFFICIENTS.edge
    turned = CuttingCoefficients((-ktc, krc, -kac), (-kte, kre, -kae), "")
    mill = dataclasses.replace(CUT.mill, helix=-CUT.mill.helix)
    back = dataclasses.replace(CUT, mill=mill, coefficients=turned)
    # angles of one are those of the other at the opposite time
    found = cutting_forces(up, times, feed)
    assert np.allclose(found, cutting_forces(back, -times, feed), rtol=1e-9, atol=1e-6)


@pytest.mark.parametrize("helix", [0.0, 0.5, -0.5])
@pytest.mark.parametrize("radial_depth", [0.002, 0.014, 0.02])
def test_the_helix_in_closed_form_is_that_of_slices_in_up_milling(
    helix: float, radial_depth: float
) -> None:
    mill = EndMill(0.02, 3, helix)
    cut = MillingCut(mill, COEFFICIENTS, 700.0, 0.013, radial_depth, slices=4000, sense="up")
    times = np.linspace(0.0, cut.tooth_period, 7)[:-1] + 1.3e-5
    found = chip_stiffness(cut, times, cut.axial_depth)
    assert np.allclose(
        found, regeneration_stiffness(cut, times)[:, :, :2], rtol=2e-3, atol=2e-3 * found.max()
    )


def test_mean_forces_do_not_depend_on_the_helix_and_hardly_on_runout() -> None:
    times, feed = one_turn(CUT, 7200)
    straight = dataclasses.replace(CUT, mill=dataclasses.replace(CUT.mill, helix=1e-9))
    eccentric = dataclasses.replace(CUT, mill=dataclasses.replace(CUT.mill, runout=5e-6))
    means = [cutting_forces(cut, times, feed).mean(axis=0) for cut in (CUT, straight, eccentric)]
    assert np.allclose(means[1], means[0], rtol=5e-3, atol=0.0) and np.allclose(
        means[2], means[0], rtol=3e-2, atol=0.0
    )


def test_runout_brings_the_spindle_frequency_and_teeth_alone_do_not() -> None:
    count = 960
    times, feed = one_turn(CUT, count)
    eccentric = dataclasses.replace(CUT, mill=dataclasses.replace(CUT.mill, runout=5e-6))
    lines = [
        np.abs(np.fft.rfft(cutting_forces(cut, times, feed)[:, 1])) / count
        for cut in (CUT, eccentric)
    ]
    assert lines[0][1] < 1e-10 < 5.0 < lines[1][1]


def test_an_opposite_helix_pushes_the_tool_up() -> None:
    times, feed = one_turn(CUT, 960)
    left = dataclasses.replace(CUT, mill=dataclasses.replace(CUT.mill, helix=-CUT.mill.helix))
    assert cutting_forces(CUT, times, feed)[:, 2].mean() == approx(
        -cutting_forces(left, times, feed)[:, 2].mean(), rel=5e-3
    )


@pytest.mark.parametrize("runout", [0.0, 5e-6])
def test_turns_evaluated_once_are_those_evaluated_each(runout: float) -> None:
    cut = dataclasses.replace(CUT, mill=dataclasses.replace(CUT.mill, runout=runout))
    feed = FEED * np.clip(np.linspace(-0.2, 1.0, 1000), 0.0, 1.0)
    times = np.arange(1000) * 2.0 * np.pi / cut.spindle / 96
    assert np.allclose(
        repeated_forces(cut, 96, feed), cutting_forces(cut, times, feed), rtol=1e-9, atol=1e-6
    )


def test_no_feed_no_force() -> None:
    times, _ = one_turn(CUT, 96)
    assert not cutting_forces(CUT, times, np.zeros(96)).any()


def test_regeneration_is_the_slope_of_the_force_by_a_motion_since_the_last_tooth() -> None:
    times, feed = one_turn(CUT, 96)
    # a motion along the travel makes every chip thicker as a higher feed does
    step = 1e-9
    slope = (
        cutting_forces(CUT, times, feed + step / CUT.tooth_period)
        - cutting_forces(CUT, times, feed)
    ) / step
    assert np.allclose(regeneration_stiffness(CUT, times)[:, :, 0], slope, rtol=1e-5, atol=1.0)


def test_a_cut_deeper_than_the_tool_is_refused() -> None:
    with pytest.raises(ModelError, match="radial depth"):
        cutting_forces(dataclasses.replace(CUT, radial_depth=0.021), np.zeros(1), np.ones(1))
