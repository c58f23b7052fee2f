"""Drives of a scene: fixed motors leave everything as it was, free ones give clean travel, poles and
failures with names.
"""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

import scene_runs
from common import approx, present
from fixture_machines import stored_scene, write_scene
from headstock.app.report.report import render_report
from headstock.pipeline.answers.answer import find_answers
from headstock.pipeline.answers.control import ControlAnswer
from headstock.pipeline.answers.path import PathResult
from headstock.pipeline.planning.planner import plan_scene
from headstock.pipeline.results.summary import RunSummary, summarise
from headstock.reduction.coupling.coupling import CoupledMachine
from headstock.reduction.coupling.drives import place_drives, release_motors
from headstock.scene.analyses.path import PathRequest
from headstock.scene.building.loader import load_scene
from headstock.scene.scene import Scene, keep_analyses
from headstock.solvers.control.drive_loops import close_loops
from headstock.solvers.control.stability import find_loop_poles
from headstock.solvers.linear.damping import add_modal_damping
from headstock.solvers.linear.modal_analysis import solve_modal
from headstock.solvers.linear.response_forms import _find_poles
from headstock.solvers.milling.forces import cutting_forces
from headstock.solvers.second_order import SecondOrderSystem
from scene_runs import couple_parts, run

SCENE = stored_scene("control")
LATE = ('integral_time = "20 ms"', 'integral_time = "20 ms"\nsampling = "250 us"')
FAST = ("50 1/s", "5000 1/s")
PITCH = 0.01 / (2.0 * math.pi)


def write(folder: Path, *changes: tuple[str, str]) -> Path:
    return write_scene(folder, SCENE, *changes)


def couple_scene(path: Path) -> tuple[Scene, CoupledMachine]:
    scene = load_scene(path)
    return scene, couple_parts(scene.machine, next(iter(scene.poses.values())))


def release(path: Path) -> SecondOrderSystem:
    """The machine with its motors free."""
    scene, coupled = couple_scene(path)
    trains = place_drives(coupled, scene.machine, scene.drives.values())
    return release_motors(coupled, trains).system


def summary_of(path: Path, tmp_path: Path) -> RunSummary:
    return summarise(run(load_scene(path), tmp_path))


def test_the_travel_of_a_free_axis_has_exactly_no_frequency(tmp_path: Path) -> None:
    system = release(write(tmp_path, ('coupling = "5e3 N m/rad"\n', "")))
    modes = solve_modal(system)
    assert modes.rigid_count == 1
    assert modes.frequencies_hz[0] < 1e-6 * modes.frequencies_hz[1]
    shape = modes.shapes[:, 0]
    travel = system.outputs["tcp", "x"] @ shape
    assert system.outputs["X", "motor"] @ shape == approx(travel, rel=1e-9)
    mass = 0.2 * 0.2 * 0.1 * 7850.0 + 2e-4 / PITCH**2
    assert travel**2 == approx(1.0 / mass, rel=1e-9)


def test_a_positive_set_point_moves_the_axis_in_its_positive_direction_however_the_joint_is_written(
    tmp_path: Path,
) -> None:
    for between in (
        '["slider.foot", "bed.top"]\nkind = "ball',
        '["bed.top", "slider.foot"]\nkind = "ball',
    ):
        for axis in ("x", "-x"):
            text = (
                (
                    '["slider.foot", "bed.top"]\nkind = "ball_screw"\naxis = "x"',
                    f'{between}_screw"\naxis = "{axis}"',
                ),
            )
            path = write(tmp_path, *text, ('limits = ["-100', 'direction = "x"\nlimits = ["-100'))
            system = release(path)
            travel = solve_modal(system).shapes[:, 0]
            moved = [
                system.outputs[channel] @ travel
                for channel in (("tcp", "x"), ("X", "motor"), ("X", "scale"))
            ]
            np.testing.assert_allclose(moved, moved[0], rtol=1e-9)


def test_the_turning_motor_pulls_on_its_housing(tmp_path: Path) -> None:
    fixed = 'stiffness = { x = "rigid", y = "rigid", z = "rigid", rx = "1e5 N m/rad", ry = "rigid", rz = "rigid" }'
    system = release(write(tmp_path, ('kind = "rigid"', f'kind = "spring"\n{fixed}')))
    mass, motor = system.mass, system.outputs["X", "motor"]
    tilt = system.outputs["bed.bottom", "rx"]
    turn = tilt / (tilt @ tilt)
    # the bed is the second end of the joint: rotor inertia over the lead couples travel and tilt
    assert abs(motor @ mass @ turn) == approx(2e-4 / PITCH, rel=1e-9)


def test_screw_inertia_counts_only_with_its_effect(tmp_path: Path) -> None:
    plain = load_scene(write(tmp_path)).drives["X"]
    screw = ("drive_control = true", "drive_control = true\nscrew_inertia = true")
    heavy = load_scene(write(tmp_path, screw)).drives["X"]
    assert (plain.screw_inertia, heavy.screw_inertia) == (0.0, 1e-4)


def test_without_the_effect_nothing_of_drives_is_planned_or_run(tmp_path: Path) -> None:
    scene = load_scene(
        write(tmp_path, ("drive_control = true\n", ""), ("[analyses.control]", "[analyses.modal]"))
    )
    assert scene.drives == {}
    assert "control" not in [stage.kind for stage in plan_scene(scene).stages]


def test_a_torque_gain_is_a_force_gain_over_the_square_of_the_lead(tmp_path: Path) -> None:
    turned = f"{2e4 * PITCH**2!r} N m s/rad"
    scene = load_scene(write(tmp_path, ("2e4 N s/m", turned)))
    assert scene.drives["X"].control.velocity_gain == approx(2e4, rel=1e-12)


def test_a_run_lists_poles_margins_and_lag(tmp_path: Path) -> None:
    summary = summary_of(write(tmp_path), tmp_path)
    assert summary["status"] == "done"
    control = summary["control"]["reference"]
    assert control["stable"]
    assert all(pole["real"] < 0.0 for pole in control["poles"])
    drive = control["drives"]["X"]
    assert drive["velocity_lag_um"] == approx(0.05 / 50.0 * 1e6, rel=1e-9)
    assert present(present(drive["margins"])["bandwidth_hz"]) > 1.0


def test_poles_are_those_of_the_unsymmetric_second_order_system_by_another_solver(
    tmp_path: Path,
) -> None:
    changes = (
        ('integral_time = "20 ms"', 'encoder = "scale"\nscale = "tcp"'),
        ("drive_control = true", "drive_control = true\nscrew_inertia = true"),
    )
    scene, coupled = couple_scene(write(tmp_path, *changes))
    trains = place_drives(coupled, scene.machine, scene.drives.values())
    free = add_modal_damping(release_motors(coupled, trains).system, [0.01])
    motor, scale = free.outputs["X", "motor"], free.outputs["X", "scale"]
    control = trains[0].control
    kv, kp = present(control.position_gain), present(control.velocity_gain)
    # a P-P cascade is a damper at the motor, and a force on it that follows the scale
    whole = dataclasses.replace(
        free,
        damping=present(free.damping) + kp * np.outer(motor, motor),
        stiffness=free.stiffness + kp * kv * np.outer(motor, scale),
    )
    theirs = _find_poles(whole)
    ours = find_loop_poles(close_loops(free, trains)).poles
    assert len(ours) >= 5
    for pole in ours:
        assert np.abs(theirs - pole).min() < 1e-7 * abs(pole)


def test_the_report_draws_every_pole_and_offers_them_as_a_table(tmp_path: Path) -> None:
    results = run(load_scene(write(tmp_path)), tmp_path)
    page = render_report(results)
    (control,) = results.find(ControlAnswer)
    assert page.count("<circle") >= len(control.poles) > 0
    assert 'download="poles_reference.csv"' in page
    assert "Phase margin" in page


def test_unstable_control_fails_by_name_and_the_rest_is_still_computed(tmp_path: Path) -> None:
    path = write(
        tmp_path,
        ("[analyses.control]", "[analyses.control]\n[analyses.modal]\ncount = 3"),
        LATE,
        FAST,
    )
    summary = summary_of(path, tmp_path)
    assert summary["status"] == "failed"
    assert len(summary["modal"]) == 1
    (failure,) = summary["failures"]
    assert all(word in failure for word in ("pose reference", "axis X", "unstable"))
    assert "largest stable kv" in failure
    assert summary["control"]["reference"]["drives"]["X"]["margins"] is None


def test_a_gain_just_below_the_largest_that_was_named_is_stable(tmp_path: Path) -> None:
    path = write(tmp_path, LATE, FAST)
    words = summary_of(path, tmp_path)["failures"][0].split("largest stable kv found is ")[1]
    largest = float(words.split(" 1/s")[0])
    for share, status in ((0.999, "done"), (1.002, "failed")):
        gain = ("50 1/s", f"{share * largest!r} 1/s")
        assert summary_of(write(tmp_path, LATE, gain), tmp_path)["status"] == status


PATH = """
[analyses.path]
from = { X = "-10 mm" }
to = { X = "10 mm" }
feeds = ["600 mm/min", "3000 mm/min"]
time_constant = "50 ms"
residual_time = "100 ms"
"""


def test_a_path_under_control_lags_and_says_whose_drives_it_used(tmp_path: Path) -> None:
    path = write(tmp_path, ("[analyses.control]", PATH))
    results = scene_runs.run(load_scene(path), tmp_path)
    (found,) = find_answers(results.answers, PathResult)
    assert found.drives == ("X",)
    curves = [run.curves for run in found.runs]
    along = [channel for channel in curves[0].outputs if channel[1] == "x"]
    column = curves[0].outputs.index(along[0])
    low_frequency, fast = (
        float(np.abs(curve.deviation.total[:, column]).max()) for curve in curves
    )
    assert low_frequency == approx(0.01 / 50.0, rel=1e-2)
    assert fast == approx(5.0 * low_frequency, rel=1e-2)


@pytest.mark.parametrize("pose_model", ["frozen", "pose_dependent"])
def test_a_path_with_friction_balances_its_energy(pose_model: str, tmp_path: Path) -> None:
    along = PATH.replace('"600 mm/min", ', "") + f'pose_model = "{pose_model}"\n'
    path = write(
        tmp_path,
        ("[analyses.control]", along),
        ("drive_control = true", "drive_control = true\nfriction = true"),
        (
            'integral_time = "20 ms"',
            'integral_time = "20 ms"\nfriction = { coulomb = "20 N", breakaway = "30 N" }',
        ),
    )
    summary = summary_of(path, tmp_path)
    assert summary["path"]["energy_error"]["3000 mm/min"] < 1e-6


@pytest.mark.slow
def test_friction_of_three_axes_balances_its_energy_as_the_pose_changes(tmp_path: Path) -> None:
    """With an eighth of the places along the path it would miss 4e-8, with a sixteenth 5e-7."""
    settings = (
        "effects.friction=true",
        'analyses.path.pose_model="pose_dependent"',
        'analyses.path.feeds=["6 m/min"]',
        'analyses.path.to={X="-10 mm"}',
        'analyses.path.residual_time="50 ms"',
        "analyses.path.on_request=false",
    )
    scene = Path(__file__).parents[3] / "machines" / "three_axis.toml"
    loaded = load_scene(scene, variant="calibrated+BE+controlled", overrides=settings)
    results = scene_runs.run(keep_analyses(loaded, ["path"]), tmp_path)
    (found,) = find_answers(results.answers, PathResult)
    assert found.energy_error["6000 mm/min"] < 5e-9


def test_an_unstable_drive_stops_a_path_before_it_is_run(tmp_path: Path) -> None:
    summary = summary_of(write(tmp_path, ("[analyses.control]", PATH), LATE, FAST), tmp_path)
    assert all(word in summary["failures"][0] for word in ("path", "axis X", "unstable"))
    assert "path" not in summary


CUT = """
[analyses.path.cut]
mill = { diameter = "10 mm", teeth = 2, helix = "30 deg" }
spindle = "6000 rpm"
axial_depth = "1 mm"
radial_depth = "2 mm"
material = "al7075-t6-dry"
"""


def test_milling_on_the_way_pushes_the_tool_away_by_its_mean_force_times_the_compliance_with_fixed_motors(
    tmp_path: Path,
) -> None:
    text = PATH.replace('"600 mm/min", ', "") + CUT + '[analyses.static]\nat = "tcp"\n'
    on = ("drive_control = true", "drive_control = true\ncutting_force = true")
    path = write(tmp_path, ("[analyses.control]", text), on)
    scene = load_scene(path)
    found = scene_runs.run(scene, tmp_path)
    curves = find_answers(found.answers, PathResult)[0].runs[0].curves
    # whole turns of the spindle at constant feed: 10 ms each
    times = curves.deviation.times
    steady = (times >= 0.25) & (times < 0.35)
    mean = curves.deviation.total[steady].mean(axis=0)
    fine = 0.25 + 1e-6 * np.arange(100_000)
    force = cutting_forces(
        present(scene.analyses[PathRequest].cut).cut, fine, np.full(len(fine), 0.05)
    ).mean(axis=0)
    # along x, away from the part (to the left, y), up
    expected = found.static["reference"]["tcp"].compliance[:3, :3] @ force
    assert mean[1] == approx(expected[1], rel=1e-2)
    assert mean[2] == approx(expected[2], rel=1e-2)
    assert mean[0] == approx(-0.05 / 50.0, rel=1e-3)


def test_a_cut_does_nothing_until_its_effect_is_named(tmp_path: Path) -> None:
    scene = load_scene(write(tmp_path, ("[analyses.control]", PATH + CUT)))
    assert scene.analyses[PathRequest].cut is None
