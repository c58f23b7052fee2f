"""Errors of legs, screws and axes along a contour: a tool that travels slowly beside them stands where
statics say.
"""

from pathlib import Path

import numpy as np
import pytest
import scipy

import scene_runs
from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.machine import Pose
from headstock.pipeline.motion.coupled_contour import _plan_trajectory, run_coupled_contour
from headstock.pipeline.motion.lumped_contour import run_lumped_contour
from headstock.pipeline.motion.posed_machine import model_builder
from headstock.pipeline.stages.run_state import RunState
from headstock.reduction.coupling.guide_errors import GUIDE_ERRORS
from headstock.scene.analyses.contouring import ContouringRequest
from headstock.scene.building.loader import load_scene
from headstock.scene.scene import keep_analyses
from headstock.solvers.milling.tool_path import plan_contour
from headstock.validation.mechanisms.tripteor_machine import SCENE as TRIPTEOR
from headstock.validation.mechanisms.tripteor_machine import load_tripteor

pytestmark = pytest.mark.slow

MILL = Path(__file__).parents[2] / "data" / "mill.toml"
UNTIL = 0.2
AIR = "effects.cutting_force=false"
FINELY = 'analyses.contouring.spindle="3000 rpm"'  # steps in time


def build_state(folder: Path, scene: Path, variant: str | None, *settings: str) -> RunState:
    loaded = load_scene(scene, variant=variant, overrides=[AIR, FINELY, *settings])
    return scene_runs.start(keep_analyses(loaded, ["contouring"]), folder)


def request_of(state: RunState) -> ContouringRequest:
    return state.scene.analyses[ContouringRequest]


def stand(state: RunState, poses: list[Pose]) -> FloatArray:
    """Where errors alone move the tool in poses."""
    found = []
    for pose in poses:
        point = model_builder(state)(pose).solve_point("tcp").answer
        assert point.displacements is not None
        found.append(point.displacements[GUIDE_ERRORS][:3])
    return np.array(found)


@pytest.mark.parametrize(
    ("scene", "variant", "errors"),
    [
        (
            TRIPTEOR,
            "components",
            'joints.screw_1.errors={axial={polynomial=["0 um","20 um"],over="100 mm"}}',
        ),
        (
            MILL,
            None,
            'axes.Y.errors={EZ={polynomial=["0 um","50 um","50 um"],over="50 mm"},EC={polynomial=["0 urad","20 urad"],over="50 mm"}}',
        ),
    ],
    ids=["screw of a leg", "error motions of an axis"],
)
def test_a_contour_leads_the_tool_where_statics_of_its_poses_say(
    scene: Path, variant: str | None, errors: str, tmp_path: Path
) -> None:
    gaps, forces = [], []
    for settings in ((), ("effects.guide_errors=true", errors)):
        state = build_state(tmp_path, scene, variant, *settings)
        run = run_coupled_contour(state, request_of(state), until=UNTIL)
        gaps.append(run.gap)
        forces.append(run.drives.forces(np.arange(len(run.times) // 2, len(run.times))))
    # a spring at rest elsewhere pushes no more: nothing resists what it moves
    assert np.abs(forces[1] - forces[0]).max() < 2e-2 * np.ptp(forces[0])
    request = request_of(state)
    some = np.arange(len(run.times) // 2, len(run.times), len(run.times) // 8)
    trajectory = _plan_trajectory(state, request, plan_contour(request.contour).path)
    expected = stand(state, [trajectory.pose(float(time)) for time in run.times[some]])
    moved = (gaps[1] - gaps[0])[some]
    assert np.abs(expected).max() > 5e-7
    assert np.abs(moved - expected).max() < 5e-3 * np.abs(expected).max()
    change = np.ptp(expected, axis=0).max()
    assert change > 3e-7
    assert np.abs((moved - moved[0]) - (expected - expected[0])).max() < 2e-2 * change


RIGID = "{ lateral = 'rigid', normal = 'rigid', roll = 'rigid', pitch = 'rigid', yaw = 'rigid' }"


def drive_of(axis: str, scale: str) -> str:
    return (
        f"drives.{axis}={{axis='{axis}',inertia='1e-3 kg m^2',lead='10 mm',kv='40 1/s',velocity_gain='5e4 N s/m',"
        f"integral_time='20 ms',feed_forward={{velocity='100 %'}}{scale}}}"
    )


SCALES = ["", ",encoder='scale'", ",encoder='scale',scale='tcp'"]


@pytest.mark.parametrize("scale", SCALES, ids=["motor", "scale", "scale at the tool"])
def test_errors_of_rigid_guides_enter_closed_loops_as_their_inertia_does_by_hand(
    scale: str, tmp_path: Path
) -> None:
    """Saddle, ram, two motors and their controllers by hand: Y pushes the ram across X and turns it
    about a place beside it.
    """
    settings = [
        'axes.Y.errors={at=["60 mm","50 mm","0 mm"],EC={waves=[{period="20 mm",amplitude="40 urad"}]},'
        'EX={waves=[{period="10 mm",amplitude="2 um"}]}}',
        *(f"joints.{name}.stiffness={RIGID}" for name in ("x_guide", "y_guide")),
        *(f"joints.{name}.damping={{axial='1e5 N s/m'}}" for name in ("x_screw", "y_screw")),
        *(drive_of(axis, scale) for axis in "XY"),
    ]
    gaps, until = [], 0.6
    for effect in ("false", "true"):
        effects = f"effects={{damping=true,guide_errors={effect},drive_control=true}}"
        state = build_state(tmp_path, MILL, None, effects, *settings)
        run = run_coupled_contour(state, request_of(state), until=until)
        gaps.append(run.gap[:, :2])
    path = plan_contour(request_of(state).contour).path
    grid: FloatArray = np.asarray(np.linspace(0.0, until, 60001), dtype=float)
    points = path.at(grid)
    laws = [
        scipy.interpolate.make_interp_spline(grid, values[:, :2])
        for values in (points.position, points.velocity, points.acceleration)
    ]
    ram, saddle = (state.parts.superelements[name].mass_kg for name in ("ram", "saddle"))
    motor, stiffness = 1e-3 * (2.0 * np.pi / 0.01) ** 2, np.array([150e6, 120e6])
    across, along, bodies = (
        np.array([1.0, 0.0]),
        np.array([0.0, 1.0]),
        np.array([saddle + ram, ram]),
    )

    def wave(place: float, period: float, size: float) -> FloatArray:
        turn = 2.0 * np.pi / period
        sine, cosine = np.sin(turn * place), np.cos(turn * place)
        return size * np.array([sine, turn * cosine, -(turn**2) * sine])

    def offset(time: float) -> FloatArray:
        """``(3, 2)`` where the ram is across X and along Y, its rate and its acceleration."""
        (_, place), (_, speed), (_, pull) = (law(time) for law in laws)
        straight, turned = wave(place, 10e-3, 2e-6), wave(place, 20e-3, 40e-6)
        own = np.column_stack([straight + 0.05 * turned, -0.06 * turned])
        return np.array([own[0], own[1] * speed, own[2] * speed**2 + own[1] * pull])

    def rate(time: float, state: FloatArray) -> FloatArray:
        """All is linear: what errors alone do."""
        at, speed, motors, turning, held = state.reshape(5, 2)
        moved, sliding, pulled = offset(time)
        # of X the error is inertia beside its spring, of Y the place where that is at rest
        spring = stiffness * (at - motors - along * moved)
        spring += 1e5 * (speed - turning - along * sliding)
        read = motors if not scale else at + ("tcp" in scale) * across * moved
        lag = -40.0 * read - turning
        pushed = (-spring - ram * across * pulled) / bodies
        force = 5e4 * lag + held
        return np.concatenate([speed, pushed, turning, (spring + force) / motor, 5e4 / 0.02 * lag])

    solved = scipy.integrate.solve_ivp(
        rate,
        (0.0, until),
        np.zeros(10),
        "LSODA",
        rtol=1e-8,
        atol=1e-14,
        max_step=1e-3,
        t_eval=run.times,
    )
    beside = np.array([offset(float(time))[0] for time in run.times]) * across
    expected = solved.y[:2].T + beside
    # a contour sets off at its feed: what that shakes has died away in the last third
    later = slice(len(run.times) * 2 // 3, None)
    off, sizes = (gaps[1] - gaps[0] - expected)[later], np.ptp(expected[later], axis=0)
    assert np.ptp(solved.y[0][later]) > 3e-7  # by inertia, or what the controller answers
    assert sizes[1] > 1e-6
    assert (np.abs(off).max(axis=0) < 3e-4 * sizes).all()


@pytest.mark.parametrize("model", ["linear", "nonlinear"])
def test_errors_of_lumped_legs_lead_their_contour_where_statics_of_its_poses_say(
    model: str, tmp_path: Path
) -> None:
    errors = 'mechanism.errors={leg_1={polynomial=["0 um","20 um"],over="100 mm"}}'
    tripteor, gaps = load_tripteor(), []
    for settings in ((), ("effects.guide_errors=true", errors)):
        state = build_state(
            tmp_path, TRIPTEOR, "lumped", f'analyses.contouring.model="{model}"', *settings
        )
        request, mechanism = request_of(state), state.scene.mechanism
        assert mechanism is not None
        until = UNTIL if model == "linear" else 0.25 * UNTIL  # sweeps take their time
        run = run_lumped_contour(mechanism, tripteor.model, request, until=until)
        gaps.append(run.gap)
    some = np.arange(len(run.times) // 2, len(run.times), len(run.times) // 8)
    places = plan_contour(request.contour).path.at(run.times[some]).position
    poses = [Pose("", dict(zip("XYZ", place.tolist(), strict=True))) for place in places]
    expected = stand(state, poses)
    size = np.abs(expected).max()
    assert size > 1e-6
    assert np.abs((gaps[1] - gaps[0])[some] - expected).max() < 5e-3 * size
