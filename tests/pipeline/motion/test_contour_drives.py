"""Drives under control along contours: stiff loops are locked motors, machines of components follow the
lumped mechanism, and axes deviate as the closed loop in absolute coordinates.
"""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

import scene_runs
from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.drives import Cascade, Drive, TorqueRipple, ripple_force
from headstock.geometry.mechanisms.exechon import solve_tool_pose
from headstock.geometry.parts.components import RayleighDamping
from headstock.pipeline.motion import coupled_contour, lumped_contour
from headstock.pipeline.motion.coupled_contour import CoupledRun, run_coupled_contour
from headstock.pipeline.motion.lumped_contour import run_lumped_contour
from headstock.pipeline.stages.control import drive_machine
from headstock.pipeline.stages.machine import couple_pose
from headstock.pipeline.stages.run_state import RunState
from headstock.scene.analyses.contouring import ContouringRequest
from headstock.scene.building.loader import load_scene
from headstock.scene.scene import Scene, keep_analyses
from headstock.solvers.control.drive_loops import (
    ClosedLoop,
    close_loops,
    make_controller,
    set_channels,
)
from headstock.solvers.control.drive_trains import DriveTrain
from headstock.solvers.control.linear_blocks import stack_blocks
from headstock.solvers.mechanisms.dynamics import CompliantMechanism
from headstock.solvers.mechanisms.modes import PoseDamping, linearise_poses, solve_lumped_modes
from headstock.solvers.mechanisms.partitioning import Drive as Law
from headstock.solvers.mechanisms.partitioning import driven_forces
from headstock.solvers.milling import contouring
from headstock.solvers.milling.path_drives import PathDrive, follow_path
from headstock.solvers.milling.tool_path import plan_contour
from headstock.solvers.motion import plant_motion
from headstock.solvers.motion.driven_motion import solve_motion
from headstock.solvers.motion.friction import friction_force
from headstock.solvers.motion.friction_loop import friction_channels
from headstock.solvers.state_spaces.time_response import solve_stepped_response
from headstock.validation.mechanisms.generalized_alpha import MotionState
from headstock.validation.mechanisms.motion import PartitionedMotion
from headstock.validation.mechanisms.tripteor_machine import SCENE as TRIPTEOR
from headstock.validation.mechanisms.tripteor_machine import Tripteor, load_tripteor

pytestmark = pytest.mark.slow

MILL = Path(__file__).parents[2] / "data" / "mill.toml"
UNTIL = 0.12


@pytest.fixture(scope="module")
def tripteor() -> Tripteor:
    return load_tripteor()


def load_prompt(folder: Path, variant: str, *settings: str) -> Scene:
    """The Tripteor with controllers without dead time: fewer states."""
    path = folder / "prompt.toml"
    path.write_text(Path(TRIPTEOR).read_text().replace('sampling = "250 us"', ""))
    scene = load_scene(path, variant=variant, overrides=settings)
    return keep_analyses(scene, ["contouring"])


def request_of(scene: Scene) -> ContouringRequest:
    return scene.analyses[ContouringRequest]


def run_contour(state: RunState, until: float) -> CoupledRun:
    return run_coupled_contour(state, request_of(state.scene), until=until)


@pytest.fixture
def _fine_nodes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Matrices are linear between nodes, in modes of components and in springs of lumped legs."""
    for module in (contouring, coupled_contour):
        monkeypatch.setattr(module, "NODE_SPACING", 5e-3)
        monkeypatch.setattr(module, "LOAD_SPACING", 2e-4)
    monkeypatch.setattr(plant_motion, "LOAD_SPACING", 2e-4)
    monkeypatch.setattr(lumped_contour, "NODE_SPACING", 1e-3)


@pytest.mark.usefixtures("_fine_nodes")
@pytest.mark.parametrize(
    "variant", ["components", pytest.param("stiff_legs+segmented", marks=pytest.mark.trials)]
)
def test_legs_of_components_are_driven_along_the_contour_as_lumped_ones(
    variant: str, tripteor: Tripteor, tmp_path: Path
) -> None:
    rubbing = "effects.friction=true"
    scene = load_prompt(tmp_path, "lumped+controlled", rubbing)
    drives = tuple(scene.drives.values())
    lumped = run_lumped_contour(
        tripteor.scene, tripteor.model, request_of(scene), until=UNTIL, drives=drives
    )
    found = run_contour(
        scene_runs.start(load_prompt(tmp_path, f"{variant}+controlled", rubbing), tmp_path), UNTIL
    )
    assert np.abs(lumped.gap).max() > 1e-5
    assert np.abs(found.gap - lumped.gap).max() < 1e-3 * np.abs(lumped.gap).max()
    some = np.arange(0, len(lumped.times), 20)
    for what in ("forces", "torques"):
        theirs, ours = (
            run.drives.forces(some)
            if what == "forces" or run.drives.torques is None
            else run.drives.torques(some, np.zeros(0))
            for run in (lumped, found)
        )
        assert np.abs(ours - theirs).max() < 1e-3 * np.abs(theirs).max()
    assert any("loops of the drives are closed" in text for text in found.assumed)


DRIVE = (
    'inertia = "1e-3 kg m^2", lead = "10 mm", kv = "40 1/s", velocity_gain = "5e4 N s/m", integral_time = "20 ms",'
    ' feed_forward = { velocity = "90 %" }'
)


@dataclasses.dataclass
class ClosedAxes:
    """A contour of the mill's axes under control, and its loops in absolute coordinates."""

    run: CoupledRun
    trains: tuple[DriveTrain, ...]
    loop: ClosedLoop
    tool: FloatArray
    given: FloatArray

    @property
    def deviation(self) -> FloatArray:
        return np.asarray(self.run.gap - self.run.gap[0])


def close_axes(folder: Path, drive: str, until: float, *settings: str) -> ClosedAxes:
    overrides = [
        "effects.drive_control=true",
        "effects.cutting_force=false",
        'analyses.contouring.pose_model="frozen"',
        'analyses.contouring.modes_to="50 kHz"',
        *(f"drives.{axis}={{ {drive} }}" for axis in "XY"),
        *settings,
    ]
    scene = keep_analyses(load_scene(MILL, overrides=overrides), ["contouring"])
    state, request = scene_runs.start(scene, folder), request_of(scene)
    run = run_contour(state, until)
    plan = plan_contour(request.contour)
    trajectory = coupled_contour._plan_trajectory(state, request, plan.path)
    driven = drive_machine(
        couple_pose(state.parts, trajectory.pose(plan.cuts[0].middle)), lambda message: None
    )
    tool = [(request.point or "", dof) for dof in "xyz"]
    loop = close_loops(
        driven.system, driven.trains, inputs=friction_channels(driven.trains), outputs=tool
    )
    points, travel = plan.path.at(run.times), {"X": 0, "Y": 1}
    columns = {
        "position": points.position - points.position[0],
        "velocity": points.velocity,
        "acceleration": points.acceleration,
    }
    given = np.stack(
        [columns[kind][:, travel[axis]] for axis, kind in set_channels(driven.trains)], axis=1
    )
    return ClosedAxes(run, driven.trains, loop, columns["position"], given)


@pytest.mark.parametrize("scale", ["", ', encoder = "scale"', ', encoder = "scale", scale = "tcp"'])
def test_axes_leave_the_contour_as_the_closed_loop_in_absolute_coordinates(
    scale: str, tmp_path: Path
) -> None:
    closed = close_axes(tmp_path, f"{DRIVE}{scale}", 0.25)
    steps = np.stack([closed.given[:-1], closed.given[1:]], axis=1)
    found = solve_stepped_response(closed.loop.space, closed.run.times, steps)
    expected = found.outputs[:, :3] - closed.tool
    size = np.abs(expected).max()
    assert size > 1e-5
    assert np.abs(closed.deviation - expected).max() < 2e-3 * size


def test_controllers_of_their_own_form_follow_a_contour_as_the_cascade_of_their_numbers(
    tmp_path: Path,
) -> None:
    gains = 'velocity_gain = "5e4 N s/m", integral_time = "20 ms"'
    step, law = 1e-4, "controller = {{ num = {}, den = {} }}"
    z_num = [5e4 + 2.5e6 * 0.5 * step, -5e4 + 2.5e6 * 0.5 * step]  # by the bilinear transform
    at_step = f"controller = {{ num = {z_num}, den = [1, -1], step = '100 us' }}"
    forms = [
        f"{gains}, dead_time = '50 us'",
        f"{law.format([5e4, 2.5e6], [1, 0])}, dead_time = '50 us'",
        at_step,
    ]
    cascade, own, sampled = (
        close_axes(tmp_path, DRIVE.replace(gains, form), 0.1).deviation for form in forms
    )
    size = np.abs(cascade).max()
    assert size > 1e-5
    assert np.abs(own - cascade).max() < 1e-7 * size
    assert np.abs(sampled - cascade).max() < 1e-7 * size


def test_friction_at_the_speeds_of_motors_acts_on_axes_as_in_absolute_coordinates(
    tmp_path: Path,
) -> None:
    rubbing = (
        f'{DRIVE}, friction = {{ coulomb = "60 N", breakaway = "90 N", viscous = "300 N s/m",'
        ' stribeck_speed = "10 mm/s", smoothing = "1 mm/s" }'
    )
    settings = ("effects.friction=true", 'analyses.contouring.model="nonlinear"')
    closed = close_axes(tmp_path, rubbing, 0.12, *settings)
    times = closed.run.times[::8]

    def given(instants: FloatArray) -> FloatArray:
        rows = [np.interp(instants, closed.run.times, row) for row in closed.given.T]
        return np.column_stack(rows)

    # straight between the steps of the contour
    longest = float(closed.run.times[1] - closed.run.times[0])
    moved = solve_motion(closed.loop, given, times, longest=longest).outputs[:, :3]
    expected = moved - closed.tool[::8]
    size = np.abs(expected).max()
    assert size > 1e-5
    assert np.abs(closed.deviation[::8] - expected).max() < 5e-3 * size
    assert any("speeds of the motors" in text for text in closed.run.assumed)


@pytest.mark.usefixtures("_fine_nodes")
def test_coriolis_forces_act_on_legs_of_components_as_on_lumped_ones(
    tripteor: Tripteor, tmp_path: Path
) -> None:
    gaps: dict[str, list[FloatArray]] = {}
    for switch in ("true", "false"):
        scene = load_prompt(tmp_path, "components", f"effects.coriolis={switch}")
        found = run_contour(scene_runs.start(scene, tmp_path), UNTIL)
        assert found.coriolis is (switch == "true")
        model = dataclasses.replace(tripteor.model, velocity_terms=switch == "true")
        lumped = run_lumped_contour(tripteor.scene, model, request_of(scene), until=UNTIL)
        gaps.setdefault("components", []).append(found.gap)
        gaps.setdefault("lumped", []).append(lumped.gap)
    theirs, ours = (gaps[name][0] - gaps[name][1] for name in ("lumped", "components"))
    size = np.abs(theirs).max()
    assert size > 1e-9
    assert np.abs(ours - theirs).max() < 2e-2 * size


def test_rayleigh_damping_of_springs_and_bodies_is_that_ratio_of_every_mode(
    tripteor: Tripteor,
) -> None:
    state = solve_tool_pose(tripteor.scene.mounted, np.array([0.0, 0.0, 0.2]), tripteor.scene.tool)
    motions = linearise_poses(tripteor.model, state)
    omega = 2.0 * np.pi * solve_lumped_modes(motions).frequencies_hz
    ratios = tuple(float(each) for each in 60.0 / (2.0 * omega) + 0.5 * 2e-4 * omega)
    matrix = PoseDamping(rayleigh=RayleighDamping(60.0, 2e-4)).matrix(motions)
    assert np.allclose(PoseDamping(ratios).matrix(motions), matrix, rtol=1e-8, atol=1e-6)


@dataclasses.dataclass(eq=False)
class AbsoluteLegs:
    """The full equations with legs and controllers in absolute coordinates, for one step after the
    other: compliant coordinates, lengths, states of the controllers.
    """

    model: CompliantMechanism
    drive: PathDrive
    drives: tuple[Drive, ...]
    damping: FloatArray
    guess: FloatArray

    def evaluate(self, state: MotionState) -> FloatArray:
        now, count = self.drive.at(state.time), len(self.drives)
        legs = slice(6, 6 + count)
        moved = [np.array(part) for part in (now.position, now.speed, now.acceleration)]
        for part, own in zip(
            moved, (state.position, state.velocity, state.acceleration), strict=True
        ):
            part[:count] = own[legs]
        motion = PartitionedMotion(
            self.model, lambda _: Law(*moved), lambda _: np.zeros(3), self.guess
        ).at(state.time, state.position[:6], state.velocity[:6])
        self.guess = motion.state
        pulled = driven_forces(self.model, motion, state.acceleration[:6], np.zeros(3))
        block = stack_blocks([make_controller(drive.control) for drive in self.drives])
        own = state.position[6 + count :]
        given = np.stack(
            [part[:count] for part in (now.position, now.speed, now.acceleration)]
            + [state.position[legs], state.velocity[legs]],
            axis=1,
        ).ravel()
        turns = np.array([2.0 * np.pi / drive.lead for drive in self.drives])
        rotors = turns**2 * [drive.motor_inertia + drive.screw_inertia for drive in self.drives]
        rubbed = [
            friction_force(drive.friction, np.asarray(speed))
            for drive, speed in zip(self.drives, state.velocity[legs], strict=True)
            if drive.friction is not None
        ]
        return np.concatenate(
            [
                motion.mass @ state.acceleration[:6]
                + self.damping @ state.velocity[:6]
                + motion.stiffness * state.position[:6]
                - motion.load,
                pulled[:count]
                + rotors * state.acceleration[legs]
                + np.array(rubbed)
                - block.c @ own
                - block.d @ given,
                state.velocity[6 + count :] - block.a @ own - block.b @ given,
            ]
        )


def test_the_full_equations_under_control_hold_in_absolute_coordinates(
    tripteor: Tripteor, tmp_path: Path
) -> None:
    scene = load_prompt(
        tmp_path,
        "lumped+controlled",
        "effects.friction=true",
        "effects.cutting_force=false",
        'analyses.contouring.model="nonlinear"',
    )
    request, drives = request_of(scene), tuple(scene.drives.values())
    run = run_lumped_contour(tripteor.scene, tripteor.model, request, until=0.02, drives=drives)
    path, nodes = run.plan.path, np.linspace(0.0, 0.02, 8, dtype=np.float64)
    drive = follow_path(tripteor.scene.mounted, nodes, path.at(nodes), tripteor.scene.tool)
    now, moved = drive.at(run.times), run.history
    absolute = [np.array(part) for part in (moved.compliant, moved.rate, moved.acceleration)]
    for part, given in zip(absolute, (now.position, now.speed, now.acceleration), strict=True):
        part[:, 6:9] += given[:, :3]
    masses = run.motion.mass[len(run.motion.mass) // 2].diagonal()[6:9]
    fed = tuple(
        dataclasses.replace(
            each,
            control=dataclasses.replace(
                each.control, acceleration_feed_forward=each.acceleration_share * float(mass)
            ),
        )
        for each, mass in zip(drives, masses, strict=True)
    )
    found = AbsoluteLegs(tripteor.model, drive, fed, np.zeros((6, 6)), drive.states[0])
    worst = []
    for step in range(0, len(run.times), 20):
        found.damping = run.motion.between(run.motion.damping, slice(step, step + 1))[0, :6, :6]
        position, velocity, acceleration = (part[step] for part in absolute)
        state = MotionState(run.times[step], position, velocity, acceleration, np.zeros(0))
        off = found.evaluate(state)
        worst.append(np.abs(off[:9]).max())
    # newtons, beside hundreds that drives and springs push with
    assert max(worst) < 1e-5
    still = dataclasses.replace(request, model="linear")
    linear = run_lumped_contour(tripteor.scene, tripteor.model, still, until=0.02, drives=drives)
    assert 1e-9 < np.abs(linear.gap - run.gap).max() < 0.05 * np.abs(run.gap).max()
    assert any("speeds of the motors" in text for text in run.assumed)


def test_torque_ripple_pushes_once_a_turn() -> None:
    drive = Drive(
        "X", "X", "screw", 1e-3, 0.01, Cascade(40.0, 1e4).control, ripple=(TorqueRipple(0.02, 1),)
    )
    places: FloatArray = np.asarray(np.linspace(0.0, 0.01, 5), dtype=float)
    force = 0.02 * 2.0 * np.pi / 0.01
    np.testing.assert_allclose(
        ripple_force(drive, places), force * np.array([0, 1, 0, -1, 0]), atol=1e-12
    )
