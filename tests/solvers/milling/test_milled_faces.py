"""The profile of a milled face against closed forms and against removal on a raster."""

import numpy as np
import pytest
import scipy.optimize

from common import approx
from headstock.geometry.frames import FloatArray
from headstock.solvers.errors import ModelError
from headstock.solvers.milling.forces import EndMill, Sense, spin_of
from headstock.solvers.milling.milled_faces import (
    ToolMotion,
    measure_profile,
    mill_profile,
    waviness_profile,
)

pytestmark = pytest.mark.slow

MILL = EndMill(0.02, 4)
RADIUS, SPINDLE, FEED = 0.01, 13000.0 * np.pi / 30.0, 5.0 / 60.0
PER_TOOTH = FEED * 2.0 * np.pi / SPINDLE / 4
STEP = 2.0 * np.pi / SPINDLE / 96


def move(length: float, off: FloatArray | float = 0.0, feed: float = FEED) -> ToolMotion:
    times: FloatArray = np.asarray(np.arange(-5e-3, length / feed + 5e-3, STEP))
    outward = RADIUS + np.broadcast_to(off, times.shape)
    return ToolMotion(times, feed * times, outward)


def cusp_of_trochoids(feed: float, sense: Sense = "down") -> float:
    """Height at which two trochoids meet half-way between them, from their equations."""
    # of the axis per radian; milling up an edge passes the face along the travel
    per_turn = feed / SPINDLE * (1.0 if sense == "down" else -1.0)
    half = 0.5 * feed * 2.0 * np.pi / SPINDLE / 4
    psi = scipy.optimize.brentq(
        lambda angle: RADIUS * np.sin(angle) - per_turn * angle - half, 0.0, 0.5, xtol=1e-15
    )
    return float(RADIUS * (1.0 - np.cos(psi)))


@pytest.mark.parametrize("sense", ["down", "up"])
@pytest.mark.parametrize("feed", [FEED, 0.5, 2.0])
def test_cusps_of_a_rigid_machine_are_as_high_as_trochoids_say(feed: float, sense: Sense) -> None:
    positions = np.linspace(1e-3, 9e-3, 40_001, dtype=np.float64)
    profile = mill_profile(MILL, SPINDLE, move(0.01, feed=feed), positions, sense=sense)
    exact = cusp_of_trochoids(feed, sense)
    # the sampled peak may lie half a spacing from the cusp
    slope = feed * 2.0 * np.pi / SPINDLE / 4 / (2.0 * RADIUS)
    spacing = float(positions[1] - positions[0])
    assert exact - spacing * slope < profile.max() <= exact + 1e-14
    assert 0.0 <= profile.min() < spacing**2 / RADIUS
    # Martellotti (1941): the mill draws a smaller circle as it climbs; f_z^2 / (8 R) for small feeds
    per_tooth, per_turn = feed * 2.0 * np.pi / SPINDLE / 4, feed / SPINDLE
    per_turn *= 1.0 if sense == "down" else -1.0
    martellotti = per_tooth**2 / (8.0 * (RADIUS - 2.0 * per_turn))
    # R sin psi - p psi = f / 2 and h = R (1 - cos psi), in powers of psi: the series goes on with
    # psi^2 / 4, and the circle is (R - p)^2 / R, which is p^2 / R larger than Martellotti's
    first = per_tooth / (2.0 * (RADIUS - per_turn))
    series = martellotti * (1.0 + first**2 / 4.0 - (per_turn / RADIUS) ** 2)
    assert exact == approx(series, rel=2.0 * (first + abs(per_turn) / RADIUS) ** 3)


def test_parameters_of_cusps_are_those_of_parabolas() -> None:
    spacing = PER_TOOTH / 64
    positions: FloatArray = np.asarray(np.arange(1e-3, 21e-3, spacing))
    profile = mill_profile(MILL, SPINDLE, move(0.022), positions)
    inside = slice(round(5e-3 / spacing), round(15e-3 / spacing))
    found = measure_profile(profile, spacing, 0.8e-3, inside, 1.5 * PER_TOOTH)
    height = cusp_of_trochoids(FEED)
    assert found.location == approx(height / 3.0, rel=2e-3)
    assert found.ra == approx(4.0 * height / (9.0 * np.sqrt(3.0)), rel=2e-3)
    # a sample lies within half a spacing of a cusp
    assert height - 0.25 * PER_TOOTH / RADIUS * spacing < found.rz <= height
    assert found.wt < 1e-4 * height
    # a tool pushed off by a steady force leaves as much more material
    pushed = mill_profile(MILL, SPINDLE, move(0.022, 7.3e-6), positions)
    assert np.abs(pushed - profile - 7.3e-6).max() < 1e-15


@pytest.mark.parametrize("ratio", [0.5, 1.0, 2.0, 5.0])
def test_a_wave_passes_the_filter_as_the_standard_says(ratio: float) -> None:
    spacing, wave = 5e-6, 1e-6
    places = spacing * np.arange(20_000)
    inside = slice(4_000, 16_000)
    profile = wave * np.sin(2.0 * np.pi * places / (0.8e-3 * ratio))
    left = np.ptp(waviness_profile(profile, spacing, 0.8e-3)[inside]) / (2.0 * wave)
    assert left == approx(2.0 ** -(1.0 / ratio**2), rel=1e-4)


def vibrate(times: FloatArray) -> ToolMotion:
    slow, fast, bend = (np.sin(2.0 * np.pi * hz * times) for hz in (182.0, 1111.0, 300.0))
    return ToolMotion(times, FEED * times + 2e-6 * bend, RADIUS + 1.5e-6 * slow + 4e-7 * fast)


def removed_on_a_raster(
    mill: EndMill,
    span: tuple[float, float],
    positions: FloatArray,
    height: float,
    spin: float = 1.0,
) -> FloatArray:
    """Lowest place of any edge in cells around positions, edges sampled densely in time."""
    cell = float(positions[1] - positions[0])
    times: FloatArray = np.asarray(np.arange(*span, 2e-8))
    dense = vibrate(times)
    found = np.full(len(positions), np.inf)
    for tooth in range(mill.teeth):
        lag = 2.0 * np.pi * tooth / mill.teeth
        radius = RADIUS + mill.runout * np.cos(lag + mill.runout_angle)
        twist = 2.0 * height * np.tan(mill.helix) / mill.diameter
        theta = spin * (-SPINDLE * times - lag + twist)
        near = np.sin(theta) < -0.9
        edge = dense.along[near] + radius * np.cos(theta[near])
        cells = np.rint((edge - positions[0]) / cell).astype(int)
        good = (cells >= 0) & (cells < len(positions))
        np.minimum.at(
            found, cells[good], (dense.outward[near] + radius * np.sin(theta[near]))[good]
        )
    return found


@pytest.mark.parametrize("sense", ["down", "up"])
@pytest.mark.parametrize(("runout", "height"), [((), 4e-3), ((1e-6, 0.3), 0.0)])
def test_a_vibrating_face_is_what_removal_on_a_raster_leaves(
    sense: Sense, runout: tuple[float, ...], height: float
) -> None:
    positions: FloatArray = np.asarray(np.arange(1e-3, 3e-3, 5e-7))
    motion = vibrate(move(0.004).times)
    span = float(motion.times[0]), float(motion.times[-1])
    mill = EndMill(0.02, 4, np.deg2rad(30.0), *runout)
    profile = mill_profile(mill, SPINDLE, motion, positions, height, sense=sense)
    raster = removed_on_a_raster(mill, span, positions, height, spin_of(sense))
    # a cell of the raster takes the lowest place within half a cell
    assert np.ptp(profile) > 2e-6
    slope = np.abs(np.gradient(profile, positions)).max()
    assert slope < 0.04
    assert np.abs(profile - raster).max() < 0.5 * slope * 5e-7 + 1e-9


def test_what_cannot_be_milled_is_refused() -> None:
    positions = np.linspace(1e-3, 3e-3, 100, dtype=np.float64)
    with pytest.raises(ModelError, match="covers"):
        mill_profile(MILL, SPINDLE, move(0.002), positions)
    still = move(0.004)
    with pytest.raises(ModelError, match="does not advance"):
        mill_profile(
            MILL, SPINDLE, ToolMotion(still.times, 0.0 * still.along, still.outward), positions
        )
    wild = 1e-2 * np.sin(2.0 * np.pi * 50.0 * still.times)
    with pytest.raises(ModelError, match="may have left a place"):
        mill_profile(
            MILL, SPINDLE, ToolMotion(still.times, still.along, still.outward + wild), positions
        )
    with pytest.raises(ModelError, match="shorter than the cut-off"):
        measure_profile(np.zeros(100), 1e-6, 0.8e-3, slice(0, 100), 1e-4)
