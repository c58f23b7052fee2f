"""A fit finds the values the targets were computed with, and says what it cannot know."""

from pathlib import Path

import numpy as np
import pytest

from headstock.pipeline.identification import identify
from headstock.validation.identification_samples import prepare_text, solve_truth, write_frequencies, write_parameters

TRUTH = {"guide_normal": 70e6, "guide_lateral": 55e6, "drive": 90e6, "feet_z": 170e6}
CASES = """
[fit]
starts = 8
[cases.written]
frequencies = {written}
compliances = [{{ point = "tcp", motion = "z", force = "z", value = "{compliance!r} um/kN" }}]
[cases.stiff]
variant = "stiff"
pose = "out"
frequencies = {stiff}
"""


def make_targets(folder: Path) -> str:
    """Targets that the true values meet exactly."""
    any_hz = write_frequencies(np.arange(10.0, 16.0))
    problem = prepare_text(folder, CASES.format(written=any_hz, stiff=any_hz, compliance=1.0) + write_parameters(TRUTH))
    written, stiff = solve_truth(problem, TRUTH).states
    return CASES.format(
        written=write_frequencies(written.frequencies_hz[:6]),
        stiff=write_frequencies(stiff.frequencies_hz[:6]),
        compliance=1e9 * float(written.compliances[0]),
    )


def test_a_fit_without_noise_finds_the_true_stiffnesses(tmp_path: Path) -> None:
    found = identify(prepare_text(tmp_path, make_targets(tmp_path) + write_parameters(TRUTH)), "test")
    assert found.converged
    assert found.values == pytest.approx(TRUTH, rel=1e-6)
    assert all(item.low < TRUTH[item.parameter.name] < item.high for item in found.parameters)
    assert all(abs(outcome.deviation) < 1e-7 for outcome in found.outcomes)
