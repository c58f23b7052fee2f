import dataclasses

import numpy as np
import pytest

from headstock.geometry.frames import FloatArray
from headstock.solvers.errors import ModelError
from headstock.solvers.milling.forces import (
    CuttingCoefficients,
    EndMill,
    MillingCut,
    cutting_forces,
    regeneration_stiffness,
    repeated_forces,
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
    assert cutting_forces(CUT, times, feed)[:, 2].mean() == pytest.approx(
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
        cutting_forces(dataclasses.replace(CUT, radial_depth=0.011), np.zeros(1), np.ones(1))
