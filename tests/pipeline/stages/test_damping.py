"""Damping of scenes: a single mass on a spring against its closed forms, above critical damping and
above a loss factor of one; Rayleigh damping of bodies, of joints, and of a machine on drives.
"""

import math
from pathlib import Path

import numpy as np
import pytest

from cases import cases
from common import approx
from fixture_machines import stored_scene, write_scene
from headstock.geometry.frames import FloatArray
from headstock.pipeline.answers.answer import find_answers
from headstock.pipeline.answers.frf import PoseResponse
from headstock.pipeline.answers.modal import PoseModes
from headstock.pipeline.results.results import Results
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.findings import SceneError
from headstock.solvers.second_order import ComplexArray
from scene_runs import compute

COLUMN = Path(__file__).resolve().parents[2] / "data" / "segmented_column.toml"
MASS, STIFFNESS = 2.0, 5e6
OMEGA = math.sqrt(STIFFNESS / MASS)
SLIDER = stored_scene("damping_slider")


def run(folder: Path, text: str, *settings: str) -> tuple[PoseModes, PoseResponse, Results]:
    results = compute(folder, text, *settings)
    return (
        find_answers(results.answers, PoseModes)[0],
        find_answers(results.answers, PoseResponse)[0],
        results,
    )


def receptance(response: PoseResponse) -> tuple[FloatArray, ComplexArray]:
    curves = response.curves
    return 2.0 * np.pi * curves.frequencies_hz, curves.receptance[:, 0, 0]


@pytest.mark.parametrize("ratio", [0.02, 0.99, 1.5, 40.0])
def test_a_mass_on_a_spring_has_the_damping_ratio_it_is_given_above_one_too(
    tmp_path: Path, ratio: float
) -> None:
    viscous = 2.0 * ratio * math.sqrt(STIFFNESS * MASS)
    settings = (
        (f"effects.damping={{ modal = {ratio} }}",)
        if ratio < 1.0
        else ("effects.damping=true", f'joints.spring.damping={{ x = "{viscous!r} N s/m" }}')
    )
    modes, response, results = run(tmp_path, SLIDER, *settings)
    assert modes.frequencies_hz[0] == approx(OMEGA / (2.0 * np.pi), rel=1e-12)
    assert modes.damping_ratio[0] == approx(ratio, rel=1e-9)
    damped = OMEGA / (2.0 * np.pi) * math.sqrt(max(0.0, 1.0 - ratio**2))
    # a double pole, of which roundoff takes half of the digits
    assert modes.damped_hz[0] == approx(damped, rel=1e-9, abs=1e-5)
    assert any("overdamped" in text for text in results.warnings) == (ratio > 1.0)
    omega, found = receptance(response)
    expected = 1.0 / (STIFFNESS - MASS * omega**2 + 2j * ratio * OMEGA * MASS * omega)
    assert found == approx(expected, rel=1e-9)


def test_warnings_of_damping_name_the_pose_where_there_are_several(tmp_path: Path) -> None:
    ratio = f'joints.spring.damping={{ x = "{3.0 * math.sqrt(STIFFNESS * MASS)!r} N s/m" }}'
    settings = ("effects.damping=true", ratio, "poses={ near = {}, far = {} }")
    warnings = run(tmp_path, SLIDER, *settings)[2].warnings
    told = [text for text in warnings if "overdamped" in text]
    assert [text.split(": mode 1")[0] for text in told] == ["pose near", "pose far"]


@pytest.mark.parametrize("loss", [0.1, 0.9])
def test_a_large_loss_factor_acts_as_it_stands_in_a_frequency_response(
    tmp_path: Path, loss: float
) -> None:
    settings = ("effects.damping=true", f"joints.spring.loss_factor={loss}")
    modes, response, results = run(tmp_path, SLIDER, *settings)
    omega, found = receptance(response)
    # structural damping does not act at rest
    expected = 1.0 / (STIFFNESS * (1.0 + 1j * loss * (omega > 0.0)) - MASS * omega**2)
    assert found == approx(expected, rel=1e-9)
    assert modes.damping_ratio[0] == approx(0.5 * loss, rel=1e-9)
    assert any("large loss factors of modes" in text for text in results.warnings) == (loss > 0.3)


def test_rayleigh_damping_of_a_body_and_of_the_machine_add_up(tmp_path: Path) -> None:
    settings = (
        'effects.damping={ rayleigh = { alpha = "30 1/s", beta = "2e-5 s" } }',
        'components.slider.rayleigh={ alpha = "12 1/s", beta = "1 s" }',
    )
    modes, response, _ = run(tmp_path, SLIDER, *settings)
    # the rigid slider has no stiffness that its beta could act on, the spring has
    alpha, beta = 42.0, 2e-5
    omega, found = receptance(response)
    damping = alpha * MASS + beta * STIFFNESS
    expected = 1.0 / (STIFFNESS - MASS * omega**2 + 1j * omega * damping)
    assert found == approx(expected, rel=1e-9)
    assert modes.damping_ratio[0] == approx(0.5 * alpha / OMEGA + 0.5 * beta * OMEGA, rel=1e-9)


def test_every_mode_of_a_deforming_machine_has_the_ratio_of_its_rayleigh_damping(
    tmp_path: Path,
) -> None:
    text = COLUMN.read_text()
    assert "[analyses.frf]" not in text
    rayleigh = 'effects.damping={ rayleigh = { alpha = "20 1/s", beta = "4e-6 s" } }'
    results = compute(tmp_path, text, rayleigh, "analyses.modal={ count = 12 }")
    modes = find_answers(results.answers, PoseModes)[0]
    omega = 2.0 * np.pi * modes.frequencies_hz
    assert modes.damping_ratio == approx(10.0 / omega + 2e-6 * omega, rel=1e-7)


@cases
def test_what_is_no_damping_is_refused(tmp_path: Path, setting: str, words: str) -> None:
    path = write_scene(tmp_path, SLIDER)
    with pytest.raises(SceneError, match=words):
        load_scene(path, overrides=(setting,))
