"""The exact derivatives of a fit are those of high-order differences of the coupled machine,
whatever a parameter moves.
"""

from pathlib import Path

import numpy as np
import pytest

from common import approx
from headstock.geometry.frames import FloatArray
from headstock.studies.identification.problem import FitProblem, data_jacobian, evaluate
from headstock.validation.machines.identification_cases import SCENE, _prepare_text

pytestmark = pytest.mark.slow

STEP = 5e-4
STENCIL = ((-3, -1 / 60), (-2, 3 / 20), (-1, -3 / 4), (1, 3 / 4), (2, -3 / 20), (3, 1 / 60))
TARGETS = """
[cases.written]
frequencies = ["40 Hz", "65 Hz", "70 Hz", "95 Hz"]
modes = [
  {{ frequency = "120 Hz", vectors = {{ "slider.tool" = [0.3, 1.0, 0.1], "column.head" = [0.2, 0.6, 0.0] }} }},
  {{ frequency = "150 Hz", moves = [{{ bodies = ["slider", "column"], rotation = "x" }}], ignore = ["base"] }},
]
compliances = [
  {{ point = "tcp", motion = "z", force = "z", value = "65 um/kN" }},
  {{ point = "tcp", motion = "x", force = "z", force_at = "column.head", value = "10 um/kN" }},
]
at_most = {{ modes = 1, below = "200 Hz" }}
[cases.turned]
variant = "{variant}"
pose = "out"
frequencies = ["40 Hz", "60 Hz", "80 Hz", "100 Hz", "120 Hz"]
compliances = [{{ point = "tcp", motion = "y", force = "y", value = "65 um/kN" }}]
"""
LENGTH, STIFFNESS = 'bounds = ["10 mm", "900 mm"]', 'bounds = ["10 N/um", "800 N/um"]'
PARAMETERS = {
    "stiffness": ('keys = ["joints.guide_*.stiffness.normal"]', STIFFNESS),
    "tied": (
        'keys = ["joints.drive.stiffness.axial"]',
        'multiplies = [{ key = "joints.feet.stiffness.rx", power = 2 }]',
        STIFFNESS,
    ),
    "place_of_joints": (
        'keys = ["joints.guide_1.at[1]", { key = "joints.guide_2.at[1]", factor = -1 },',
        '{ key = "joints.guide_3.at[1]", factor = 0.8, offset = "3 mm" }]',
        LENGTH,
    ),
    "place_of_bodies": (
        'shifts = ["components.slider.at[2]", "joints.guide_*.at[2]", { key = "components.column.at[1]", factor = 0.5 }]',
        'bounds = ["-50 mm", "50 mm"]',
        'scale = "linear"',
    ),
    "thickness": (
        'keys = ["components.column.solid.box[0]"]',
        'shifts = [{ key = "components.slider.at[0]", factor = 0.5 }]',
        LENGTH,
    ),
    "height": (
        'keys = ["components.column.solid.box[2]"]',
        'shifts = ["components.slider.at[2]", "joints.guide_*.at[2]", "joints.drive.at[2]"]',
        LENGTH,
    ),
    "mass": ('keys = ["components.slider.mass"]', 'bounds = ["5 kg", "50 kg"]'),
    "modulus": ('keys = ["materials.steel.E"]', 'bounds = ["100 GPa", "300 GPa"]'),
    "poisson": ('keys = ["materials.steel.nu"]', "bounds = [0.1, 0.4]"),
    "density": ('keys = ["materials.steel.rho"]', 'bounds = ["5000 kg/m^3", "9000 kg/m^3"]'),
    "angle": ('multiplies = ["components.column.rotate.angle"]', "bounds = [0.3, 5.0]"),
}


def differences(problem: FitProblem, place: FloatArray) -> FloatArray:
    """Sixth-order differences of the residuals, modes followed from the middle."""
    anchor, columns = evaluate(problem, place), []
    for direction in np.eye(len(place)):
        moved = [
            weight * evaluate(problem, place + reach * STEP * direction, anchor).residuals
            for reach, weight in STENCIL
        ]
        columns.append(np.sum(moved, axis=0) / STEP)
    return np.column_stack(columns)


def slopes(problem: FitProblem) -> tuple[FloatArray, FloatArray]:
    """Where a fit starts, and its exact derivatives there."""
    place = problem.coordinates([parameter.start for parameter in problem.parameters])
    return place, data_jacobian(problem, evaluate(problem, place))


@pytest.mark.parametrize("variant", ["stiff", "turned"])
def test_the_jacobian_is_that_of_sixth_order_differences(tmp_path: Path, variant: str) -> None:
    text = "".join(
        "\n".join([f"[parameters.{name}]", *lines, ""]) for name, lines in PARAMETERS.items()
    )
    problem = _prepare_text(tmp_path, TARGETS.format(variant=variant) + text)
    place, exact = slopes(problem)
    expected = differences(problem, place)
    scale = np.abs(expected).max(axis=0)
    assert (scale > 0.0).all()
    worst = np.abs(exact - expected).max(axis=0) / scale
    named = dict(zip(PARAMETERS, worst, strict=True))
    assert named == approx(dict.fromkeys(PARAMETERS, 0.0), abs=1e-6)


SCREW = """
[fit]
modes_above = "20 Hz"
[cases.stiff]
variant = "{variant}"
frequencies = ["50 Hz", "60 Hz", "70 Hz", "90 Hz", "110 Hz"]
compliances = [{{ point = "tcp", motion = "x", force = "x", value = "65 um/kN" }}]
[parameters.nut]
keys = ["joints.drive.stiffness.axial"]
bounds = ["10 N/um", "800 N/um"]
[parameters.place]
shifts = ["components.slider.at[0]", "joints.drive.at[0]", "joints.guide_*.at[0]"]
bounds = ["-50 mm", "50 mm"]
scale = "linear"
"""


def test_a_nut_in_series_with_its_screw_is_differentiated_as_a_whole(tmp_path: Path) -> None:
    """The joint's stiffness is no longer the number in the scene: it follows the screw's free
    length too.
    """
    problem = _prepare_text(tmp_path, SCREW.format(variant="screw"))
    place, exact = slopes(problem)
    expected = differences(problem, place)
    assert exact == approx(expected, abs=1e-6 * np.abs(expected).max())
    _, bare = slopes(_prepare_text(tmp_path, SCREW.format(variant="stiff")))
    assert np.abs(exact - bare)[:, 0].max() > 1e-3 * np.abs(bare[:, 0]).max()


DAMPED = """
[cases.bent]
pose = "out"
modes = [
  { frequency = "60 Hz", damping = "2 %" },
  { frequency = "75 Hz", damping = "1 %" },
  { frequency = "120 Hz", damping = "1 %" },
]
[[cases.bent.responses]]
point = "tcp"
motion = "z"
force = "x"
force_at = "column.head"
lines = [["40 Hz", "1 um/kN", "2 um/kN"], ["70 Hz", "-1 um/kN", "9 um/kN"]]
[[cases.bent.responses]]
point = "tcp"
motion = "z"
force = "z"
lines = [["66 Hz", "1 um/kN", "20 um/kN"], ["110 Hz", "-1 um/kN", "9 um/kN"]]
"""
DAMPINGS = {
    "viscous": ('keys = ["joints.feet.damping.x"]', 'bounds = ["1 N s/mm", "100 N s/mm"]'),
    "structural": ('keys = ["joints.guide_*.loss_factor"]', "bounds = [0.001, 0.5]"),
    "material": ('keys = ["materials.steel.loss_factor"]', "bounds = [0.0001, 0.1]"),
    "rayleigh": ('keys = ["components.column.rayleigh.beta"]', 'bounds = ["1e-7 s", "1e-3 s"]'),
    "bending": ('keys = ["components.column.segments.bending"]', "bounds = [0.3, 3.0]"),
    "torsion": ('keys = ["components.column.segments.torsion"]', "bounds = [0.3, 3.0]"),
}
WITHOUT = ("tied", "height", "poisson", "angle")


def test_damping_and_responses_are_differentiated_exactly(tmp_path: Path) -> None:
    known = {name: lines for name, lines in PARAMETERS.items() if name not in WITHOUT} | DAMPINGS
    text = "".join("\n".join([f"[parameters.{name}]", *lines, ""]) for name, lines in known.items())
    changes = {
        "segments = { count = 4 }": "segments = { count = 4, bending = 1.0, torsion = 1.0 }\nrayleigh = { beta = '2e-5 s' }",
        "nu = 0.3": "nu = 0.3\nloss_factor = 0.004",
        'stiffness = { lateral = "40 N/um", normal = "50 N/um" }': 'stiffness = { lateral = "40 N/um", normal = "50 N/um" }\nloss_factor = 0.03',
        "[joints.feet]": '[joints.feet]\ndamping = { x = "20 N s/mm", z = "40 N s/mm" }',
    }
    scene = "effects = ['damping']\n" + SCENE
    for old, new in changes.items():
        assert old in scene
        scene = scene.replace(old, new)
    problem = _prepare_text(tmp_path, DAMPED + text, scene)
    place, exact = slopes(problem)
    kinds = [item.kind for item in evaluate(problem, place).fitted]
    assert kinds == ["frequency", "damping"] * 3 + ["response"] * 2
    expected = differences(problem, place)
    scale = np.abs(expected).max(axis=0)
    assert (scale > 1e-3).all()
    worst = np.abs(exact - expected).max(axis=0) / scale
    named = dict(zip(known, worst, strict=True))
    assert named == approx(dict.fromkeys(known, 0.0), abs=1e-6)
