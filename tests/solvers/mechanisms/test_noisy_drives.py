"""noisy measured leg lengths must not become noise in the motion, and no filter is needed."""

import numpy as np
import pytest

from headstock.geometry.frames import FloatArray
from headstock.solvers.mechanisms.modes import PoseDamping
from headstock.solvers.milling.contouring import linear_motion
from headstock.solvers.milling.path_drives import PathDrive, follow_path, smooth_samples
from headstock.solvers.milling.tool_path import SquareContour, plan_contour
from headstock.solvers.motion.alpha import integrate_linear
from headstock.validation.mechanisms.tripteor_machine import Tripteor, load_tripteor

pytestmark = pytest.mark.hard("H34")

CONTOUR = SquareContour(0.2, (0.0, 0.0), 0.2, 0.01, 0.02, 5.0 / 60.0, 0.01)
SPAN, NOISE, RATE = 0.6, 1e-6, 1e-3
HIGHEST_HZ = 640.0  # of the machine's six modes


@pytest.fixture(scope="module")
def machine() -> Tripteor:
    return load_tripteor()


@pytest.fixture(scope="module")
def clean(machine: Tripteor) -> PathDrive:
    path = plan_contour(CONTOUR).path
    nodes = np.linspace(0.0, SPAN, 151, dtype=np.float64)
    return follow_path(machine.scene.mounted, nodes, path.at(nodes), machine.scene.tool)


def gaps(machine: Tripteor, drive: PathDrive, step: float) -> tuple[FloatArray, FloatArray]:
    times = np.arange(0.0, SPAN, step, dtype=np.float64)
    motion = linear_motion(machine.model, drive, times, PoseDamping((0.02,)))
    return times, motion.tool_motion(integrate_linear(motion, motion.load).compliant)


def share_above(values: FloatArray, step: float, hz: float) -> float:
    """Content above a frequency over the whole, both as root mean square, offset and trend taken
    out.
    """
    line = np.linspace(0.0, 1.0, len(values))[:, None]
    flat = values - values[0] - line * (values[-1] - values[0])
    spectrum = np.abs(np.fft.rfft(flat * np.hanning(len(flat))[:, None], axis=0)) ** 2
    high = np.fft.rfftfreq(len(flat), step) > hz
    return float(np.sqrt(spectrum[high].sum() / spectrum[1:].sum()))


def test_smoothed_measurements_give_a_motion_without_noise(
    machine: Tripteor, clean: PathDrive
) -> None:
    times = np.arange(0.0, SPAN + 0.5 * RATE, RATE, dtype=np.float64)
    measured = clean.at(times).position
    measured[:, :3] += NOISE * np.random.default_rng(34).normal(size=(len(times), 3))
    law = smooth_samples(times, measured, 0.02)
    found = gaps(machine, PathDrive(clean.times, clean.states, law), 5e-5)[1]
    assert share_above(found, 5e-5, 2.0 * HIGHEST_HZ) < 0.01


def test_a_finer_step_changes_less_than_a_hundredth(machine: Tripteor, clean: PathDrive) -> None:
    coarse, fine = (gaps(machine, clean, step)[1] for step in (5e-5, 5e-5 / 4.0))
    change = np.abs(fine[::4][: len(coarse)] - coarse).max()
    assert change < 0.01 * np.ptp(coarse, axis=0).max()
    assert share_above(coarse, 5e-5, 2.0 * HIGHEST_HZ) < 0.01
