"""Torques of motors, position errors and forces of joints while a machine moves, beside closed forms
and equilibrium.
"""

import bisect
import functools
import json
from pathlib import Path

import numpy as np
import pytest

from common import approx
from direct_integration import integrate_pieces
from fixture_machines import stored_scene
from headstock.app.report.report import render_report
from headstock.app.views.registry import list_tables
from headstock.geometry.frames import FloatArray
from headstock.pipeline.answers.answer import find_answers
from headstock.pipeline.answers.path import PathResult
from headstock.pipeline.answers.transient import TransientAnswer
from headstock.pipeline.results.files import open_results
from headstock.pipeline.results.results import Results
from scene_runs import compute

ROOT = Path(__file__).resolve().parents[3]
SLIDE = ROOT / "tests" / "data" / "slide.toml"
MASS, INERTIA, LEAD = 40.0, 2e-3, 0.01
KP, KV = 6e4, 10.0
COULOMB, VISCOUS, PUSH = 30.0, 500.0, 400.0
AXIS = stored_scene("motion_forces_axis")
# 40 mm, with 0.1 s of constant acceleration at both ends
FEED = 0.05
BREAKS, PULLS = (0.0, 0.1, 0.04 / FEED, 0.04 / FEED + 0.1), (FEED / 0.1, 0.0, -FEED / 0.1, 0.0)
PATH = """
[analyses.path]
from = { X = "-20 mm" }
to = { X = "20 mm" }
feeds = ["3000 mm/min"]
time_constant = "100 ms"
sampling = "2 kHz"
residual_time = "50 ms"
outputs = [["tcp", "x"]]
"""


def run(text: str, folder: Path) -> Results:
    folder.mkdir(exist_ok=True)
    return compute(folder, text)


def answer_of(results: Results) -> TransientAnswer:
    (answer,) = find_answers(results.answers, TransientAnswer)
    return answer


def pushed_axis(times: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Position, speed and acceleration of a mass that a P controller holds while a force pushes it
    against friction: two real poles.
    """
    whole = MASS + INERTIA * (2.0 * np.pi / LEAD) ** 2
    slow, fast = np.roots([whole, KP + VISCOUS, KP * KV]).real
    rest = (PUSH - COULOMB) / (KP * KV)
    # rest (1 - (f e^{s t} - s e^{f t}) / (f - s))
    parts = [(fast, slow), (-slow, fast)]
    moved, speed, pull = (
        sum(factor * pole**order * np.exp(pole * times) for factor, pole in parts) / (fast - slow)
        for order in range(3)
    )
    return rest * (1.0 - moved), -rest * speed, -rest * pull


def test_a_motor_turns_what_it_moves_and_overcomes_friction_and_load(tmp_path: Path) -> None:
    request = (
        '[analyses.transient]\nduration = "40 ms"\nup_to = "500 Hz"\nmotors = "controlled"\n'
        f'outputs = [["tcp", "x"]]\nloads.push = {{ at = ["tcp", "x"], shape = "step", size = "{PUSH} N" }}'
    )
    results = run(f"{AXIS}\n{request}", tmp_path)
    answer = answer_of(results)
    curves = answer.curves
    position, speed, pull = pushed_axis(curves.times)
    sliding = curves.times > 0.0
    assert speed[sliding].min() > 1e-5  # 100 times its smoothing
    # kp (kv x + v) = - (J (2 pi / l)^2 + m) a - friction + load, as a torque
    whole = MASS + INERTIA * (2.0 * np.pi / LEAD) ** 2
    force = whole * pull + COULOMB + VISCOUS * speed - PUSH
    torque = LEAD / (2.0 * np.pi) * force
    np.testing.assert_allclose(
        curves.torques[sliding, 0], torque[sliding], atol=1e-4 * np.abs(torque).max()
    )
    np.testing.assert_allclose(curves.position_errors[:, 0], -position, atol=1e-4 * position.max())
    largest = answer.drives["X"]
    assert largest.torque.value == approx(-np.abs(torque[sliding]).max(), rel=1e-4)
    assert largest.position_error.value == approx(-position[-1], rel=1e-4)
    assert largest.position_error.time == approx(0.04)
    # the screw takes what does not accelerate the slide, most before that moves and rubs
    taken = answer.joints["screw"]["x"]
    assert taken.value == approx(MASS * PUSH / whole - PUSH, rel=1e-4)
    assert taken.time == 0.0
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())["transient"]["middle"]
    assert summary["drives"]["X"]["torque_nm"] == largest.torque.value
    assert summary["joints"]["screw"]["x"]["unit"] == "N"


@pytest.mark.parametrize("friction", [True, False])
@pytest.mark.parametrize("pose_model", ["frozen", "pose_dependent"])
def test_a_motor_moves_its_axis_along_a_path(
    tmp_path: Path, pose_model: str, friction: bool
) -> None:
    """Beside an integrator of a library; at constant speed only friction is left."""
    request = f'{PATH}pose_model = "{pose_model}"\n'
    text = AXIS.replace("friction = true", f"friction = {str(friction).lower()}")
    (found,) = find_answers(run(text + request, tmp_path).answers, PathResult)
    (own,) = found.runs
    curves, times = own.curves, own.curves.deviation.times
    whole = MASS + INERTIA * (2.0 * np.pi / LEAD) ** 2
    coulomb, viscous = (COULOMB, VISCOUS) if friction else (0.0, 0.0)

    def rate(time: float, state: FloatArray) -> FloatArray:
        pull = PULLS[bisect.bisect(BREAKS, time) - 1]
        wanted, wished, position, speed = state
        force = KP * (KV * (wanted - position) - speed)
        rubbed = coulomb * np.tanh(speed / 1e-7) + viscous * speed
        return np.array([wished, pull, speed, (force - rubbed) / whole])

    solved = integrate_pieces(
        rate, (*BREAKS, float(times[-1])), np.zeros(4), times, method="LSODA", rtol=1e-9, atol=1e-12
    )
    wanted, _, position, speed = solved.T
    torque = LEAD / (2.0 * np.pi) * KP * (KV * (wanted - position) - speed)
    size = np.abs(torque).max()
    np.testing.assert_allclose(curves.torques[:, 0], torque, atol=1e-4 * size)
    errors = wanted - position
    np.testing.assert_allclose(
        curves.position_errors[:, 0], errors, atol=1e-4 * np.abs(errors).max()
    )
    cruising = int(np.searchsorted(times, BREAKS[2] - 1e-3))
    kept = LEAD / (2.0 * np.pi) * (coulomb + viscous * FEED)
    assert curves.torques[cruising, 0] == approx(kept, abs=2e-3 * size)
    assert own.drives["X"].torque.value == approx(torque[np.argmax(np.abs(torque))], rel=1e-4)
    # the screw moves the slide, in the pose of the middle
    moved = np.gradient(speed, times) * MASS + coulomb * np.sign(speed) + viscous * speed
    assert own.joints["screw"]["x"].value == approx(np.abs(moved[1:-1]).max(), rel=2e-2)


def test_a_motor_answers_to_the_error_of_its_screw(tmp_path: Path) -> None:
    """Beside an integrator of a library: motor and slide with the screw between them, whose lead is
    uneven.
    """
    screw, wave, size = 2e7, 0.004, 1e-4
    text = AXIS.replace("friction = true", "guide_errors = true")
    text = text.replace('stiffness = { axial = "1e6 N/um" }', 'stiffness = { axial = "20 N/um" }')
    text = text.replace(
        "[axes.X]",
        f'[joints.screw.errors]\naxial.waves = [{{ period = "{1e3 * wave} mm", amplitude = "{1e6 * size} um" }}]\n[axes.X]',
    )
    found, plain = (
        next(iter(find_answers(run(each + PATH, tmp_path / name).answers, PathResult)))
        for name, each in (
            ("with", text),
            ("without", text.replace("guide_errors = true", "guide_errors = false")),
        )
    )
    times = found.runs[0].curves.deviation.times
    rotor = INERTIA * (2.0 * np.pi / LEAD) ** 2

    def error(position: float) -> float:
        # from that at the beginning; the slide is as far beyond its motor
        now, first = (np.sin(2.0 * np.pi * each / wave) for each in (position - 0.02, -0.02))
        return float(size * (now - first))

    def rate(time: float, state: FloatArray, share: float) -> FloatArray:
        pull = PULLS[bisect.bisect(BREAKS, time) - 1]
        wanted, wished, motor, turned, slide, speed = state
        force = KP * (KV * (wanted - motor) - turned)
        pushed = screw * (motor + share * error(wanted) - slide)
        return np.array([wished, pull, turned, (force - pushed) / rotor, speed, pushed / MASS])

    torques, forces = [], []
    for share in (1.0, 0.0):
        solved = integrate_pieces(
            functools.partial(rate, share=share),
            (*BREAKS, float(times[-1])),
            np.zeros(6),
            times,
            rtol=1e-9,
            atol=1e-13,
        )
        wanted, _, motor, turned, slide, _ = solved.T
        torques.append(LEAD / (2.0 * np.pi) * KP * (KV * (wanted - motor) - turned))
        along = np.array([share * error(float(each)) for each in wanted])
        forces.append(screw * (motor + along - slide))
    added = found.runs[0].curves.torques[:, 0] - plain.runs[0].curves.torques[:, 0]
    expected = torques[0] - torques[1]
    assert np.abs(expected).max() > 0.02 * np.abs(torques[1]).max()
    np.testing.assert_allclose(added, expected, atol=2e-2 * np.abs(expected).max())
    for answer, torque, force in zip((found, plain), torques, forces, strict=True):
        (own,) = answer.runs
        assert abs(own.drives["X"].torque.value) == approx(np.abs(torque).max(), rel=1e-2)
        assert abs(own.joints["screw"]["x"].value) == approx(np.abs(force).max(), rel=2e-2)


def test_joints_carry_a_load_that_comes_slowly(tmp_path: Path) -> None:
    """Guide and screw of a slide are statically determinate; motors are locked."""
    request = (
        '[analyses.transient]\nduration = "1 s"\nup_to = "500 Hz"\nposes = ["left"]\n'
        'outputs = [["tcp", "x"]]\n'
        'loads.side = { at = ["tcp", "y"], shape = "ramp", size = "50 N", time = "1 s" }\n'
        'loads.down = { at = ["tcp", "z"], shape = "ramp", size = "-200 N", time = "1 s" }\n'
        'loads.along = { at = ["tcp", "x"], shape = "ramp", size = "80 N", time = "1 s" }\n'
        "[effects]\ndamping = { modal = 0.3 }"
    )
    joints = answer_of(run(f"{SLIDE.read_text()}\n{request}", tmp_path)).joints
    # the slide is 60 mm high; the guide's first end is the slide, which it pushes back
    carriage, screw = joints["carriage"], joints["drive"]
    assert carriage["y"].value == approx(-50.0, rel=1e-3)
    assert carriage["z"].value == approx(200.0, rel=1e-3)
    assert carriage["rx"].value == approx(0.06 * 50.0, rel=5e-3)
    assert screw["x"].value == approx(-80.0, rel=1e-3)
    assert {name: found.time for name, found in carriage.items()}["z"] == approx(1.0)


def test_springs_beside_rigid_joints_take_nothing(tmp_path: Path) -> None:
    beside = (
        '[joints.soft]\nbetween = ["bed.foot_1", "ground"]\nkind = "spring"\n'
        'stiffness = { z = "10 N/um" }\n'
    )
    request = (
        '[analyses.transient]\nduration = "5 ms"\nposes = ["left"]\n'
        'loads.hit = { at = ["tcp", "z"], shape = "step", size = "10 N" }\n'
    )
    joints = answer_of(run(f"{SLIDE.read_text()}\n{beside}{request}", tmp_path)).joints
    assert joints["soft"]["z"].value == 0.0
    assert "foot_1" not in joints
    assert abs(joints["foot_2"]["z"].value) > 1.0


def test_a_coupling_does_not_change_what_a_screw_takes(tmp_path: Path) -> None:
    """A screw that turns by itself stands between thread and coupling; at rest it passes the load on."""
    request = (
        '[analyses.transient]\nduration = "4 s"\nup_to = "300 Hz"\nmotors = "controlled"\n'
        f'outputs = [["tcp", "x"]]\nloads.push = {{ at = ["tcp", "x"], shape = "ramp", size = "{PUSH} N", time = "4 s" }}'
    )
    text = AXIS.replace('stiffness = { axial = "1e6 N/um" }', 'stiffness = { axial = "100 N/um" }')
    text = text.replace("friction = true", "screw_inertia = true\ndamping = { modal = 0.05 }")
    text = text.replace(
        "[effects]", 'coupling = "1 kN m/rad"\nscrew_inertia = "1e-4 kg m^2"\n[effects]'
    )
    answer = answer_of(run(f"{text}\n{request}", tmp_path))
    assert answer.joints["screw"]["x"].value == approx(-PUSH, rel=1e-2)
    assert answer.drives["X"].torque.value == approx(-LEAD / (2.0 * np.pi) * PUSH, rel=1e-2)


def test_forces_are_tabled_written_and_drawn(tmp_path: Path) -> None:
    request = (
        '[analyses.transient]\nduration = "10 ms"\nup_to = "500 Hz"\nmotors = "controlled"\n'
        'outputs = [["tcp", "x"]]\nloads.push = { at = ["tcp", "x"], shape = "step", size = "90 N" }'
    )
    answer = answer_of(run(f"{AXIS}\n{request}", tmp_path))
    results = open_results(tmp_path / "out")
    curves = answer_of(results).curves
    assert curves.drives == ("X",)
    assert np.array_equal(curves.torques, answer.curves.torques)
    tables = {table.name: table for table in list_tables(results)}
    assert tables["joint_forces_middle"].rows[0][:2] == ("screw", "x")
    assert tables["motors_middle"].headings[1] == "largest torque [N m]"
    page = render_report(results)
    assert "Torque of motors [N m]" in page and "Position error [µm]" in page
