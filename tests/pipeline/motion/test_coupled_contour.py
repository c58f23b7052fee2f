"""Contours on machines of components, against the path analysis, statics, semi-discretisation and
the lumped mechanism.
"""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import scene_runs
from cases import cases
from common import approx
from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.machine import Pose
from headstock.pipeline.motion.contour_cut import travel_frames
from headstock.pipeline.motion.contouring import cut_multiplier, evaluate_contour, face_stability
from headstock.pipeline.motion.coupled_contour import (
    CoupledRun,
    coupled_face_dynamics,
    drive_torque,
    run_coupled_contour,
)
from headstock.pipeline.motion.milled_faces import mill_faces
from headstock.pipeline.stages.run_state import RunState
from headstock.reduction.coupling.coupling import couple
from headstock.scene.analyses.contouring import ContouringRequest
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.findings import SceneError
from headstock.scene.scene import keep_analyses
from headstock.solvers.linear.damping import add_modal_damping
from headstock.solvers.linear.modal_analysis import solve_modal
from headstock.solvers.milling.forces import repeated_forces
from headstock.solvers.milling.tool_path import plan_contour
from headstock.validation.mechanisms.tripteor_machine import SCENE as TRIPTEOR

pytestmark = pytest.mark.slow

MILL = Path(__file__).parents[2] / "data" / "mill.toml"


def build_state(
    folder: Path, scene: Path, *, variant: str = "", settings: tuple[str, ...] = ()
) -> RunState:
    loaded = load_scene(scene, variant=variant or None, overrides=settings)
    return scene_runs.start(keep_analyses(loaded, ["contouring"]), folder)


def request_of(state: RunState) -> ContouringRequest:
    return state.scene.analyses[ContouringRequest]


def run(state: RunState, until: float, **changes: Any) -> CoupledRun:
    return run_coupled_contour(
        state, dataclasses.replace(request_of(state), **changes), until=until
    )


@pytest.mark.parametrize(
    "pose_model", ["pose_dependent", pytest.param("frozen", marks=pytest.mark.trials)]
)
def test_a_machine_that_differs_little_deviates_beside_another_as_alone(
    tmp_path: Path, pose_model: str
) -> None:
    settings = (f"analyses.contouring.pose_model={pose_model!r}",)
    state = build_state(tmp_path, MILL, settings=settings)
    softer = (
        "joints.x_screw.stiffness.axial='145 N/um'",
        "joints.y_guide.stiffness.pitch='1.9e7 N m/rad'",
    )
    other = build_state(tmp_path, MILL, settings=(*settings, *softer))
    base, alone = run(state, 0.6), run(other, 0.6)
    beside = run_coupled_contour(other, request_of(other), until=0.6, like=base.course)
    change = alone.gap - base.gap
    assert np.abs(change).max() > 0.01 * np.abs(base.gap).max()
    assert np.abs(beside.gap - alone.gap).max() < 0.01 * np.abs(change).max()
    some = np.arange(0, len(base.times), 50)
    forces = [each.drives.forces(some) for each in (base, alone, beside)]
    assert np.abs(forces[2] - forces[1]).max() < 0.02 * np.abs(forces[1] - forces[0]).max()


def drive(axis: str, more: str) -> str:
    return (
        f"drives.{axis}={{axis='{axis}',inertia='1e-3 kg m^2',lead='10 mm',kv='40 1/s',velocity_gain='5e4 N s/m',"
        f"integral_time='20 ms',friction={{coulomb='60 N'}}{more}}}"
    )


def test_a_slow_cut_bends_the_machine_as_its_compliance_says(tmp_path: Path) -> None:
    state = build_state(tmp_path, MILL)
    found = run(state, 0.8)
    on = (found.times > 0.45) & (found.times < 0.7)
    middle = found.plan.cuts[0].middle
    now = found.sampled.at(np.array([middle]))
    compliance = now.rows[0, :3] @ np.linalg.solve(now.stiffness[0], now.rows[0, :3].T)
    compliance = compliance + now.direct[0, :3, :3]
    expected = compliance @ found.force[on].mean(axis=0)
    assert np.abs(found.gap[on].mean(axis=0) - expected).max() < 5e-3 * np.abs(expected).max()
    # the screws hold the tool against the cut: the ram's pushes along y, both along x
    drives = found.drives.forces(np.flatnonzero(on)).mean(axis=0)
    assert drives == approx(-found.force[on].mean(axis=0)[:2], rel=5e-3)
    # the face is where the tool is as its teeth pass, and a third of a cusp further out
    request = request_of(state)
    (face,), _ = mill_faces(request, found)
    low, high = (
        found.plan.cuts[0].begins + place / found.plan.cuts[0].feed for place in face.evaluated
    )
    twist = 2.0 * face.height * np.tan(request.cut.mill.helix) / request.cut.mill.diameter
    passes = (
        np.arange(4000) * request.cut.tooth_period + (0.5 * np.pi + twist) / request.cut.spindle
    )
    passes = passes[(passes > low) & (passes < high)]
    outward = found.gap @ found.plan.cuts[0].outward
    located = np.interp(passes, found.times, outward).mean() + face.cusp / 3.0
    # A tool that moves outward bends the parabola of height f^2 / (8 R): at a rate g' it reaches
    # g'^2 / (2 R omega^2) further, with g'' its curvature is 1 / R - g'' / (R omega)^2; the next term
    # of the cusp is (f / (2 R))^2 / 4 of it. Between steps of length h motion is linear, which leaves
    # h^2 g'' / 8, and the cusps cut off at both ends are one of all.
    spindle, radius = request.cut.spindle, 0.5 * request.cut.mill.diameter
    evaluated = (found.times > low) & (found.times < high)
    step = found.times[1] - found.times[0]
    rate = np.abs(np.gradient(outward, step))[evaluated].max()
    bend = np.abs(np.gradient(np.gradient(outward, step), step))[evaluated].max()
    per_tooth = found.plan.cuts[0].feed * request.cut.tooth_period
    within = (
        (bend / (radius * spindle**2) + (per_tooth / radius) ** 2 / 16.0) * face.cusp
        + rate**2 / (2.0 * radius * spindle**2)
        + step**2 * bend / 8.0
        + face.cusp / len(passes)
    )
    assert face.parameters.location == approx(located, abs=within)
    assert face.parameters.location > 1e-6
    middle = face.by_height[2][1]
    assert middle == approx(face.parameters.location, abs=face.cusp / len(passes))


def test_modes_left_out_follow_at_once(tmp_path: Path) -> None:
    state = build_state(tmp_path, MILL)
    whole, part = (run(state, 0.5, modes_to_hz=hz) for hz in (5000.0, 400.0))
    assert part.sampled.modes < whole.sampled.modes == 12
    assert np.abs(whole.gap - part.gap).max() < 0.03 * np.abs(whole.gap).max()
    on = whole.times > 0.4
    assert part.gap[on].mean(axis=0) == approx(whole.gap[on].mean(axis=0), rel=1e-3, abs=1e-10)
    frozen = run(state, 0.5, follows_pose=False)
    change = np.abs(whole.gap - frozen.gap).max()
    assert 1e-6 * np.abs(whole.gap).max() < change < 0.1 * np.abs(whole.gap).max()


@pytest.mark.trials
@pytest.mark.parametrize("machine", ["axes", "legs that bend"])
def test_waves_decay_below_the_limit_of_semi_discretisation_and_grow_above(
    machine: str, tmp_path: Path
) -> None:
    if machine == "axes":
        state = build_state(tmp_path, MILL, settings=('analyses.contouring.side="80 mm"',))
    else:
        state = build_state(tmp_path, TRIPTEOR, variant="elastic_legs+segmented")
    request = dataclasses.replace(request_of(state), regeneration=True, follows_pose=False)
    shallow = run_coupled_contour(state, request, until=0.05)
    limit = face_stability(coupled_face_dynamics(shallow, request, 0), request, 0).limit_depth
    assert 0.5e-3 < limit < 0.199
    growth = {}
    for share in (0.95, 1.05):
        cut = dataclasses.replace(request.cut, axial_depth=share * limit)
        deeper = dataclasses.replace(request, cut=cut)
        found = run_coupled_contour(state, deeper, until=1.1)
        delay = request.steps_per_turn // cut.mill.teeth
        # what differs from one tooth to the next is no forced motion
        waves = np.abs(found.gap[delay:] - found.gap[:-delay]).max(axis=1)
        early, late = (
            waves[(found.times[delay:] > start) & (found.times[delay:] < start + 0.05)].max()
            for start in (0.7, 1.05)
        )
        periods = 0.35 / cut.tooth_period
        multiplier = cut_multiplier(
            coupled_face_dynamics(found, deeper, 0), deeper, cut.axial_depth
        )
        growth[share] = float(late / early) ** (1.0 / periods)
        assert growth[share] == approx(multiplier, abs=2e-3)
    assert growth[0.95] < 1.0 < growth[1.05]


def test_ripple_of_the_teeth_needs_modes_up_to_their_frequency(tmp_path: Path) -> None:
    state = build_state(tmp_path, TRIPTEOR, variant="elastic_legs+segmented")
    request = request_of(state)
    cut, steps = request.cut, request.steps_per_turn
    force = repeated_forces(cut, steps, np.full(2 * steps, 5.0 / 60.0))[: steps // cut.mill.teeth]
    harmonics = np.fft.rfft(force, axis=0)
    omega = 2.0 * np.pi * np.arange(len(harmonics)) / cut.tooth_period
    ripple = {}
    for hz in (600.0, 1000.0, 2600.0):
        kept = dataclasses.replace(request, follows_pose=False, modes_to_hz=hz)
        found = run_coupled_contour(state, kept, until=0.005)
        face = found.plan.cuts[0]
        now, frame = (
            found.sampled.at(np.array([face.middle])),
            travel_frames(face.travel[None], face.part)[0],
        )
        tip, rest = frame @ now.rows[0, :3], frame @ now.direct[0, :3, :3] @ frame.T
        unit = np.eye(tip.shape[1])
        dynamic = (now.stiffness[0] + 1j * omega[:, None, None] * now.damping[0]) - omega[
            :, None, None
        ] ** 2 * unit
        moved = (tip @ np.linalg.solve(dynamic, tip.T[None]) + rest) @ harmonics[..., None]
        outward = np.fft.irfft(moved[:, 1, 0], n=len(force))
        ripple[hz] = float(np.ptp(outward))
        # the mean is static: no mode is missing from it
        assert outward.mean() == approx(6.4923e-6, rel=2e-4)
    assert ripple[1000.0] == approx(ripple[2600.0], rel=3e-3)
    assert ripple[600.0] > 1.1 * ripple[2600.0]


def test_teeth_shake_the_moving_machine_as_all_modes_of_a_pose_do(tmp_path: Path) -> None:
    state = build_state(tmp_path, TRIPTEOR, variant="elastic_legs+segmented")
    request = dataclasses.replace(request_of(state), steps_per_turn=240)
    found = run_coupled_contour(state, request, until=0.4)
    cut, face = request.cut, found.plan.cuts[0]
    # over the last turn: what repeats from tooth to tooth, beside a parabola that drifts
    last = slice(-request.steps_per_turn, None)
    times, omega = found.times[last], 2.0 * np.pi / cut.tooth_period
    tones = np.exp(1j * omega * times)
    drift = (times - times[0])[:, None] ** np.arange(3)
    columns = np.concatenate([drift, np.stack([tones.real, -tones.imag], axis=1)], axis=1)

    def tone(values: FloatArray) -> FloatArray:
        real, imaginary = np.linalg.lstsq(columns, values, rcond=None)[0][3:]
        return np.asarray(real + 1j * imaginary)

    x, y, z = found.plan.path.at(times.mean()[None]).position[0].tolist()
    coupled = couple(
        state.parts.superelements, state.scene.machine, Pose("", {"X": x, "Y": y, "Z": z})
    )
    system = add_modal_damping(coupled.system, (0.02,), solve_modal(coupled.system))
    rows = np.array([system.outputs["tcp", direction] for direction in "xyz"])
    assert system.damping is not None
    dynamic = system.stiffness + 1j * omega * system.damping - omega**2 * system.mass
    expected = face.outward @ rows @ np.linalg.solve(dynamic, rows.T @ tone(found.force[last]))
    assert abs(expected) > 1e-7
    # of 4 % steps take 2 % near a mode of 2 % damping: with four times as many 0.5 % are left
    assert abs(tone((found.gap @ face.outward)[last]) - expected) < 0.04 * abs(expected)


def write_rows(path: Path, heading: str, rows: FloatArray) -> None:
    lines = (",".join(repr(float(value)) for value in row) for row in rows)
    path.write_text("\n".join([heading, *lines]) + "\n")


BLOCK = 'side = "40 mm"\nat = ["20 mm", "0 mm", "0 mm"]\n'
CORNERS = ((-10, -40, 0), (-10, 30, 0), (50, 30, 0), (50, -30, 0), (-20, -30, 0))


def test_corners_and_measured_axes_from_files_mill_the_block_as_its_table_does(
    tmp_path: Path,
) -> None:
    text = MILL.read_text()
    assert BLOCK in text
    block = build_state(tmp_path, MILL, settings=('analyses.contouring.lead="20 mm"',))
    expected = run(block, 0.5)
    line = 'polyline_file = "corners.csv"\ncorner_radius = "10 mm"\ntraces = "axes.csv"\ntraces_knots = "4 ms"\n'
    scene = tmp_path / "line.toml"
    scene.write_text(text.replace(BLOCK, line))
    write_rows(tmp_path / "corners.csv", "x [m],y [m],z [m]", 1e-3 * np.array(CORNERS, dtype=float))
    times: FloatArray = np.asarray(np.arange(-1e-3, expected.plan.path.span[1] + 2e-3, 5e-4))
    places = expected.plan.path.at(times).position[:, :2]
    write_rows(tmp_path / "axes.csv", "time [s],Y,X", np.column_stack([times, places[:, ::-1]]))
    state = build_state(tmp_path, scene)
    found = run(state, 0.5)
    assert found.fit is not None
    assert found.fit.residual < 1e-8 and found.fit.off_path < 1e-8
    # the spline rounds the start from rest, and what it stirs up decays
    on = found.times > 0.35
    assert np.abs(found.gap - expected.gap)[on].max() < 1e-3 * np.abs(expected.gap[on]).max()
    answer = evaluate_contour(request_of(state), found).summarise()
    assert answer["face_3_over_face_1"] == {} and answer["traces"]["off_path_um"] < 0.01
    planned = dataclasses.replace(request_of(state), traces=None)
    assert plan_contour(planned.contour).path.at(times).position == approx(
        expected.plan.path.at(times).position, abs=1e-11
    )
    for name, wrong, message in (
        ("axes.csv", "time,X\n0,0\n9,0\n", "no column y"),
        ("axes.csv", "time,X,Y\n0,0,0\n1,0,0\n", "path takes 0 to"),
        ("corners.csv", "x,y,z\n0,0,0\n0,0.1,0.001\n", "at one height"),
        ("corners.csv", "x,y,z,feed\n0,0,0,0\n0,0.1,0,0\n", "feed rate"),
        ("corners.csv", "x,y,z\n0,0,0\n0,0.041,0\n", "no straight cut"),
    ):
        (tmp_path / name).write_text(wrong)
        with pytest.raises(SceneError, match=message):
            load_scene(scene)
        if name == "axes.csv":
            write_rows(tmp_path / name, "time,Y,X", np.column_stack([times, places[:, ::-1]]))


def test_a_motor_turns_itself_and_its_screw() -> None:
    drive = load_scene(Path(TRIPTEOR).parent / "three_axis.toml", variant="controlled+R").drives[
        "X"
    ]
    speed, acceleration = np.array([0.05, 0.05]), np.array([0.0, 2.0])
    torque = drive_torque(drive, speed, acceleration)
    turn = 2.0 * np.pi / 0.01
    assert torque[1] - torque[0] == approx((drive.motor_inertia + drive.screw_inertia) * turn * 2.0)


@cases
def test_what_cannot_be_followed_is_refused_with_its_remedy(settings: str, expected: str) -> None:
    with pytest.raises(SceneError, match=expected):
        load_scene(MILL, overrides=[settings])


@pytest.mark.parametrize(
    ("scene", "variant", "path"),
    [
        (MILL, None, 'from={X="-10 mm"},to={X="10 mm"},outputs=[["tcp","x"]]'),
        (TRIPTEOR, "lumped", 'from={X="-4 mm",Y="48 mm",Z="208 mm"},to={X="4 mm"}'),
    ],
    ids=["axes", "mechanism"],
)
def test_waves_on_a_path_name_the_contour_that_has_them(
    scene: Path, variant: str | None, path: str
) -> None:
    only = f'analyses={{path={{{path},feeds=["3 m/min"],time_constant="50 ms"}}}}'
    with pytest.raises(SceneError, match=r"as polyline in \[analyses.contouring\]"):
        load_scene(scene, variant=variant, overrides=[only, "effects.regeneration=true"])
