"""Straight moves of the tool of a mechanism, lumped and of components, with drives, errors, the cut and
the forces of speeds: against the equations of contours in the coordinates of the springs, and
against static solutions.
"""

import dataclasses
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest

import scene_runs
from cases import cases
from common import approx
from headstock.geometry.frames import DIRECTIONS, DOF_NAMES, FloatArray
from headstock.geometry.machine.drives import Drive, ripple_force
from headstock.geometry.mechanisms.exechon import LENGTHS, solve_tool_pose
from headstock.pipeline.answers.path import PathResult
from headstock.pipeline.motion import stepped_path
from headstock.pipeline.motion.lumped_contour import _close_legs
from headstock.pipeline.motion.path import run_path_stage
from headstock.pipeline.motion.posed_machine import model_builder
from headstock.pipeline.motion.trajectory import follow_curve
from headstock.pipeline.planning.plan import Stage
from headstock.pipeline.stages.control import drive_machine
from headstock.pipeline.stages.run_state import RunState
from headstock.reduction.coupling.guide_errors import GUIDE_ERRORS
from headstock.scene.analyses.path import PathRequest
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.findings import SceneError
from headstock.scene.scene import keep_analyses
from headstock.solvers.control.drive_loops import close_loops
from headstock.solvers.control.drive_trains import FORCE
from headstock.solvers.mechanisms.modes import PoseDamping
from headstock.solvers.milling import contouring
from headstock.solvers.milling.contouring import linear_motion
from headstock.solvers.milling.forces import cutting_forces
from headstock.solvers.milling.path_drives import PathDrive, follow_path
from headstock.solvers.milling.tool_path import StraightLine
from headstock.solvers.motion.alpha import LinearMotion, integrate_linear, interpolate_nodes
from headstock.solvers.motion.set_points import average_accelerations, sample_move
from headstock.solvers.state_spaces.time_response import solve_stepped_response
from headstock.validation.mechanisms.tripteor_machine import SCENE as TRIPTEOR
from headstock.validation.mechanisms.tripteor_machine import Tripteor, load_tripteor

START, END = np.array([-0.004, 0.048, 0.208]), np.array([0.004, 0.052, 0.212])
ALONG = (END - START) / np.linalg.norm(END - START)
PATH = (
    'analyses.path={from={X="-4 mm",Y="48 mm",Z="208 mm"},to={X="4 mm",Y="52 mm",Z="212 mm"},feeds=["3 m/min"],'
    'time_constant="50 ms",ramp="s_curve",jerk_time="20 ms",residual_time="50 ms",sampling="2 kHz"}'
)
CUT = (
    'analyses.path.cut={mill={diameter="20 mm",teeth=4,helix="30 deg"},spindle="3000 rpm",axial_depth="5 mm",'
    'radial_depth="2 mm",material="al7075-t6"}'
)
FROZEN = 'analyses.path.pose_model="frozen"'
PARTS = 4  # steps per sample of the reference


@pytest.fixture(scope="module", autouse=True)
def _steps() -> Iterator[None]:
    """As many steps in time as the reference has."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stepped_path, "STEPS_PER_PERIOD", 12)
        yield


@pytest.fixture(scope="module")
def tripteor() -> Tripteor:
    return load_tripteor()


def build_state(folder: Path, variant: str, *settings: str) -> RunState:
    scene = load_scene(TRIPTEOR, variant=variant, overrides=[PATH, *settings])
    return scene_runs.start(keep_analyses(scene, ["path"]), folder)


def solve(folder: Path, variant: str, *settings: str) -> PathResult:
    return follow(build_state(folder, variant, *settings))


def follow(state: RunState) -> PathResult:
    (found,) = run_path_stage(state, Stage("path", None, "")).answers
    assert isinstance(found, PathResult)
    return found


def total(found: PathResult) -> FloatArray:
    return found.runs[0].curves.deviation.total[:, :3]


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> PathResult:
    """The lumped mechanism with motors that follow their set points."""
    return solve(tmp_path_factory.mktemp("plain"), "lumped")


@dataclasses.dataclass
class Reference:
    """The move by the equations of contours, in the coordinates of the springs."""

    tripteor: Tripteor
    times: FloatArray
    drive: PathDrive
    motion: LinearMotion
    velocity_terms: bool = True

    def tool(self, moved: FloatArray) -> FloatArray:
        """Deviation of the tool at the samples, from that at rest."""
        turned = moved @ self.tripteor.scene.mounted.mounting.rotation.T
        return np.asarray((turned - turned[0])[2::PARTS])

    def march(self, load: FloatArray | float = 0.0) -> FloatArray:
        history = integrate_linear(self.motion, self.motion.load + load)
        return self.tool(self.motion.tool_motion(history.compliant - self.rest))

    @property
    def rest(self) -> FloatArray:
        return interpolate_nodes(self.times, self.motion.nodes, self.motion.gravity_deflection)


def refer(
    tripteor: Tripteor,
    found: PathResult,
    monkeypatch: pytest.MonkeyPatch,
    *,
    drives: Sequence[Drive] = (),
    velocity_terms: bool = True,
) -> Reference:
    # their matrices and loads are linear between nodes
    monkeypatch.setattr(contouring, "NODE_SPACING", 5e-3)
    monkeypatch.setattr(contouring, "LOAD_SPACING", 2e-4)
    request = load_scene(TRIPTEOR, variant="lumped", overrides=[PATH]).analyses[PathRequest]
    samples, scene = found.runs[0].curves.deviation.times, tripteor.scene
    step = float(samples[1] - samples[0]) / PARTS
    times = step * np.arange(-2, PARTS * (len(samples) - 1) + 1, dtype=np.float64)
    nodes: FloatArray = np.asarray(np.linspace(times[0], times[-1], 300), dtype=float)
    motion = average_accelerations(request.moves[0], nodes, step)
    points = follow_curve(StraightLine(START, ALONG), motion)
    drive = follow_path(scene.mounted, nodes, points, scene.tool)
    model = dataclasses.replace(tripteor.model, velocity_terms=velocity_terms)
    names = tuple(each.axis for each in drives)
    linear = linear_motion(model, drive, times, PoseDamping((0.02,)), names)
    if drives:
        linear = _close_legs(model, drive, linear, drives, "true").motion
    return Reference(tripteor, times, drive, linear, velocity_terms)


def test_a_tool_leaves_its_line_as_the_equations_of_contours_say(
    plain: PathResult, tripteor: Tripteor, monkeypatch: pytest.MonkeyPatch
) -> None:
    expected = refer(tripteor, plain, monkeypatch).march()
    size = np.abs(expected).max()
    assert size > 5e-6
    assert np.abs(total(plain) - expected).max() < 1e-3 * size
    curves = plain.runs[0].curves
    assert np.abs(curves.frozen[:, :3] - expected).max() > 5e-3 * size
    parts = curves.deviation
    assert np.abs(parts.quasi_static + parts.dynamic - parts.total).max() < 1e-12


def test_speeds_accelerate_a_line_as_the_equations_of_contours_say(
    plain: PathResult, tripteor: Tripteor, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    without = solve(tmp_path, "lumped", "effects.coriolis=false")
    mine = total(plain) - total(without)
    acting, left_out = (
        refer(tripteor, plain, monkeypatch, velocity_terms=terms).march() for terms in (True, False)
    )
    expected = acting - left_out
    size = np.abs(expected).max()
    assert size > 1e-8
    assert np.abs(mine - expected).max() < 1e-2 * size


def test_rigid_legs_of_components_leave_it_as_lumped_ones_with_gravity_stiffening(
    plain: PathResult, tmp_path: Path
) -> None:
    stiffening = "effects.gravity_stiffening=true"
    lumped, legs = (
        total(solve(tmp_path, variant, stiffening, FROZEN)) for variant in ("lumped", "components")
    )
    change = np.abs(plain.runs[0].curves.frozen[:, :3] - lumped).max()
    assert change > 1e-6 * np.abs(legs).max()
    assert np.abs(legs - lumped).max() < 1e-2 * change


def test_legs_under_control_with_friction_leave_a_line_as_lumped_contours_do(
    plain: PathResult, tripteor: Tripteor, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    state = build_state(tmp_path, "lumped+controlled", "effects.friction=true")
    found = follow(state)
    given = refer(tripteor, plain, monkeypatch, drives=tuple(state.scene.drives.values()))
    expected = given.march()
    size = np.abs(expected).max()
    assert size > 1e-5
    assert np.abs(total(found) - expected).max() < 5e-3 * size


def test_legs_of_components_under_control_leave_it_as_lumped_ones(tmp_path: Path) -> None:
    first, second = (
        solve(tmp_path, f"{variant}+controlled", FROZEN) for variant in ("lumped", "components")
    )
    lumped, legs = total(first), total(second)
    assert np.abs(lumped).max() > 1e-5
    assert np.abs(legs - lumped).max() < 1e-9 * np.abs(lumped).max()
    own, other = (found.runs[0].curves for found in (first, second))
    assert own.drives == ("leg_1", "leg_2", "leg_3")
    np.testing.assert_allclose(
        own.torques, other.torques, atol=1e-7 * np.abs(own.torques).max(), rtol=0.0
    )
    size = np.abs(own.position_errors).max()
    np.testing.assert_allclose(
        own.position_errors, other.position_errors, atol=1e-7 * size, rtol=0.0
    )


def test_motors_hold_the_weight_before_a_move(tmp_path: Path) -> None:
    settings = (FROZEN, "effects.gravity=true")
    (own,) = solve(tmp_path, "lumped+controlled", *settings).runs
    state = build_state(tmp_path, "lumped+controlled", *settings)
    path = state.scene.analyses[PathRequest]
    # the weight that motors carry is that of where they are
    driven = drive_machine(model_builder(state)(path.path.start), lambda text: None)
    motors = np.array([driven.system.inputs[train.name, FORCE] for train in driven.trains])
    size, count = motors.shape[1], len(motors)
    held = np.zeros((size + count, size + count))
    held[:size, :size], held[size:, :size], held[:size, size:] = (
        driven.system.stiffness,
        motors,
        -motors.T,
    )
    pulled = np.concatenate([driven.released.loads["gravity"], np.zeros(count)])
    forces = np.linalg.solve(held, pulled)[size:]
    lead = state.scene.drives["leg_1"].lead / (2.0 * np.pi)
    assert np.abs(forces).max() > 100.0
    np.testing.assert_allclose(own.curves.torques[0], lead * forces, rtol=1e-6)
    # what a leg carries beside the weight goes through its spring along it
    assert set(own.joints) == {"leg_1", "leg_2", "leg_3"}
    assert set(own.joints["leg_1"]) == {"across", "along"}


def test_springs_of_legs_carry_what_motors_give_them(tmp_path: Path) -> None:
    """Locked motors: springs of the lumped legs beside the joints of the same legs of components."""
    lumped, legs = (solve(tmp_path, variant, FROZEN) for variant in ("lumped", "components"))
    along = [abs(lumped.runs[0].joints[f"leg_{leg}"]["along"].value) for leg in (1, 2, 3)]
    screws = [
        max(abs(force.value) for name, force in joint.items() if not name.startswith("r"))
        for name, joint in sorted(legs.runs[0].joints.items())
    ]
    assert max(min(abs(force / screw - 1.0) for screw in screws) for force in along) < 1e-6


@pytest.mark.parametrize(
    ("variant", "control"),
    [
        ("lumped", ""),
        pytest.param("lumped", "+controlled", marks=pytest.mark.trials),
        pytest.param("components", "", marks=pytest.mark.trials),
        ("components", "+controlled"),
    ],
)
def test_interfaces_leave_a_line_as_the_rigid_body_does_that_they_are_on(
    variant: str, control: str, tmp_path: Path
) -> None:
    """The platform carries the tool: its joint moves by the tool's motion and turning."""
    channels = [f'["tcp","{dof}"]' for dof in DOF_NAMES]
    channels += [f'["platform.joint_3","{dof}"]' for dof in DIRECTIONS]
    outputs = f"analyses.path.outputs=[{','.join(channels)}]"
    state = build_state(tmp_path, variant + control, outputs)
    found = follow(state)
    curves, request = found.runs[0].curves, state.scene.analyses[PathRequest]
    line, model_at = np.linspace(0.0, request.path.length, 5), model_builder(state)
    arms = []
    for position in line:
        placed = model_at(request.path.pose_at(position)).placements
        tip, joint = (
            placed[name].origin
            + placed[name].rotation @ state.parts.superelements[name].interface_position(interface)
            for name, interface in (("spindle", "tip"), ("platform", "joint_3"))
        )
        arms.append(joint - tip)
    arm = np.stack([np.interp(curves.positions, line, own) for own in np.array(arms).T], axis=1)
    tool, turned, moved = np.split(curves.deviation.total, 3, axis=1)
    size = np.abs(moved).max()
    assert np.abs(moved - tool).max() > 0.1 * size
    assert np.abs(moved - tool - np.cross(turned, arm)).max() < 1e-5 * size


def test_errors_of_legs_lead_a_tool_off_as_their_springs_at_rest_elsewhere_do(
    plain: PathResult, tripteor: Tripteor, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    errors = (
        'mechanism.errors={leg_1={waves=[{period="2 mm",amplitude="3 um"}]},'
        'leg_3={polynomial=["0 um","20 um"],over="100 mm"}}'
    )
    found = solve(tmp_path, "lumped", "effects.guide_errors=true", errors)
    assert found.runs[0].cruises
    given = refer(tripteor, plain, monkeypatch)
    law, known = given.drive.at(given.times).position, tripteor.model.mechanism
    q1, q3 = (law[:, known.driven.index(LENGTHS[leg])] for leg in (0, 2))
    offsets = np.zeros_like(given.motion.load)
    offsets[:, 1], offsets[:, 5] = 3e-6 * np.sin(2.0 * np.pi * q1 / 2e-3), 2e-4 * q3
    expected = given.march(given.motion.apply(given.motion.stiffness, offsets))
    size = np.abs(expected).max()
    assert np.abs(expected - total(plain)).max() > 1e-6
    assert np.abs(total(found) - expected).max() < 2e-3 * size


def test_errors_of_screws_of_components_lead_a_tool_off_as_statics_say_in_every_pose(
    plain: PathResult, tmp_path: Path
) -> None:
    state = build_state(
        tmp_path,
        "components",
        "effects.guide_errors=true",
        'joints.screw_1.errors={axial={polynomial=["0 um","20 um"],over="100 mm"}}',
    )
    found = follow(state)
    mine, path = total(found) - total(plain), state.scene.analyses[PathRequest]
    some = slice(200, 400, 50)
    expected = []
    for position in (0.0, *found.runs[0].curves.positions[some]):
        point = model_builder(state)(path.path.pose_at(float(position))).solve_point("tcp").answer
        assert point.displacements is not None
        expected.append(point.displacements[GUIDE_ERRORS][:3])
    moved = np.array(expected[1:]) - expected[0]
    assert np.abs(moved).max() > 1e-6
    assert np.abs(mine[some] - moved).max() < 1e-2 * np.abs(moved).max()


@pytest.mark.parametrize(
    ("variant", "errors"),
    [
        ("lumped", 'mechanism.errors={leg_1={polynomial=["0 um","20 um"],over="100 mm"}}'),
        ("components", 'joints.screw_1.errors={axial={polynomial=["0 um","20 um"],over="100 mm"}}'),
    ],
)
def test_a_leg_that_is_too_long_pushes_no_more_than_before(
    variant: str, errors: str, tmp_path: Path
) -> None:
    """Its spring is at rest elsewhere, and nothing resists what it moves: 200 um would else be 20 kN."""
    before, after = (
        solve(tmp_path, variant, FROZEN, *settings).runs[0].joints
        for settings in ((), ("effects.guide_errors=true", errors))
    )
    forces = {
        (joint, direction): (found.value, after[joint][direction].value)
        for joint, directions in before.items()
        for direction, found in directions.items()
        if not direction.startswith("r")
    }
    largest = max(abs(own) for own, _ in forces.values())
    assert largest > 100.0
    assert all(abs(other - own) < 1e-2 * largest for own, other in forces.values())


def test_a_cut_pushes_a_tool_off_its_line_as_far_as_statics_say(
    plain: PathResult, tmp_path: Path
) -> None:
    state = build_state(tmp_path, "lumped", CUT, FROZEN)
    found = follow(state)
    request = state.scene.analyses[PathRequest]
    assert request.cut is not None
    turn = 2.0 * np.pi / request.cut.cut.spindle
    count = round(turn * request.sampling_hz)
    assert count == 40
    late = slice(300, 300 + 2 * count)
    times = found.runs[0].curves.deviation.times
    feed = request.moves[0].feed
    assert sample_move(request.moves[0], times[late]).speeds == approx(feed)
    flat = ALONG * np.array([1.0, 1.0, 0.0])
    size = float(np.linalg.norm(flat))
    up = np.array([0.0, 0.0, 1.0])
    frame = np.array([flat / size, np.cross(up, flat / size), up])
    fine: FloatArray = np.asarray(np.linspace(0.0, turn, 960, endpoint=False), dtype=float)
    force = cutting_forces(request.cut.cut, fine, np.full(len(fine), size * feed)).mean(axis=0)
    middle = model_builder(state)(request.path.pose_at(0.5 * request.path.length))
    expected = middle.solve_point("tcp").answer.compliance[:3, :3] @ (force @ frame)
    mine = (total(found) - plain.runs[0].curves.frozen[:, :3])[late].mean(axis=0)
    assert np.abs(mine - expected).max() < 2e-2 * np.abs(expected).max()


@cases
def test_a_line_looks_as_high_as_ramps_teeth_and_waves_excite_it(
    effect: str, settings: tuple[str, ...], band: float
) -> None:
    settings = (PATH, f"effects.{effect}=true", *settings)
    scene = load_scene(TRIPTEOR, variant="lumped+controlled", overrides=settings)
    request = scene.analyses[PathRequest]
    assert request.band_hz == approx(band)


def test_torque_ripple_shakes_a_tool_as_the_closed_loop_at_its_frequency_does(
    tmp_path: Path,
) -> None:
    settings = ("effects.torque_ripple=true", FROZEN)
    ripple = 'drives.leg_1.torque_ripple=[{torque="0.5 N m",per_turn=8}]'
    state = build_state(tmp_path, "lumped+controlled", *settings, ripple)
    quiet = solve(tmp_path, "lumped+controlled", FROZEN)
    found = follow(state)
    request, drive = state.scene.analyses[PathRequest], state.scene.drives["leg_1"]
    assert drive.ripple
    middle = model_builder(state)(request.path.pose_at(0.5 * request.path.length))
    driven = drive_machine(middle, state.warn)
    tool = [("tcp", dof) for dof in "xyz"]
    loop = close_loops(
        driven.system, driven.trains, inputs=[(drive.name, FORCE)], outputs=tool
    ).space
    # the force in time along the leg, as the closed loop in absolute coordinates answers it
    times = found.runs[0].curves.deviation.times
    scene = state.scene.mechanism
    assert scene is not None
    lengths = [
        solve_tool_pose(scene.mounted, START + place * ALONG, scene.tool)[
            scene.mounted.mechanism.index("q1")
        ]
        for place in found.runs[0].curves.positions[::5]
    ]
    force = ripple_force(drive, np.interp(times, times[::5], lengths))
    place = loop.inputs.index((drive.name, FORCE))
    alone = dataclasses.replace(
        loop, b=loop.b[:, [place]], d=loop.d[:, [place]], inputs=loop.inputs[place : place + 1]
    )
    steps = np.stack([force[:-1], force[1:]], axis=1)[..., None] - force[0]
    expected = solve_stepped_response(alone, times, steps).outputs[:, :3]
    mine = total(found) - total(quiet)
    size = np.abs(expected).max()
    assert size > 1e-8
    assert np.abs(mine - expected).max() < 2e-2 * size


@cases
def test_what_a_tool_path_cannot_have_is_refused(variant: str, setting: str, message: str) -> None:
    with pytest.raises(SceneError, match=message):
        load_scene(TRIPTEOR, variant=variant, overrides=[PATH, setting])
