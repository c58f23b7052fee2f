"""Axes that turn along a path: an arm beside its nonlinear equations of motion, a beam beside the
closed form of its bending, and how bodies move beside hand calculations.
"""

from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

from cases import cases
from common import approx, present
from direct_integration import integrate_pieces
from fixture_machines import stored_scene, write_scene
from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.machine import MachinePath, Pose
from headstock.pipeline.answers.answer import find_answers
from headstock.pipeline.answers.path import PathResult
from headstock.pipeline.motion.body_trajectory import RotaryTrajectory
from headstock.pipeline.runner import run_scene
from headstock.scene.analyses.path import PathRequest
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.findings import SceneError
from headstock.scene.scene import Scene
from headstock.solvers.milling.forces import cutting_forces
from headstock.solvers.motion.set_points import PathMotion, SetPoint, sample_move
from scene_runs import start

ARM = Path(__file__).parents[2] / "data" / "turning_arm.toml"
WEIGHT, RADIUS, ZETA = 5.0, 0.4, 0.05
TABLE = 7800.0 * 0.1 * 0.1 * 0.05 * (0.1**2 + 0.1**2) / 12.0  # about its axis [kg m^2]


def run(scene: Scene, folder: Path) -> PathResult:
    results = run_scene(scene, folder, comm=MPI.COMM_SELF)
    assert not results.failures
    return find_answers(results.answers, PathResult)[0]


def travel(move: SetPoint, time: float) -> tuple[float, float]:
    """Speed and acceleration of the set point."""
    ramp, top = move.ramp.time_constant, move.feed / move.ramp.time_constant
    starts, stops = 0.0 <= time < ramp, move.braking <= time < move.duration
    speed = top * (min(time, ramp) - min(max(time - move.braking, 0.0), ramp))
    return speed, top * (int(starts) - int(stops))


def breaks_of(move: SetPoint, times: FloatArray) -> list[float]:
    return sorted({0.0, *np.ravel(move.zones).tolist(), float(times[-1])})


def turn_arm(move: SetPoint, times: FloatArray, radial: float, torsional: float) -> FloatArray:
    """Deviation ``(n, 2)`` of the weight from its place on the rigid arm, by all its equations of
    motion: its radius and the turn of the table, with Coriolis and centrifugal terms.
    """

    def rate(time: float, state: FloatArray) -> list[float]:
        speed, pull = travel(move, time)
        stretch, turn, out, spin = state
        radius, omega = RADIUS + stretch, speed + spin
        inertia = TABLE + WEIGHT * RADIUS**2
        along = radius * omega**2 - radial * stretch / WEIGHT
        along -= 2.0 * ZETA * np.sqrt(radial / WEIGHT) * out
        moment = -torsional * turn - 2.0 * ZETA * np.sqrt(torsional * inertia) * spin
        moment -= 2.0 * WEIGHT * radius * out * omega
        return [out, spin, along, moment / (TABLE + WEIGHT * radius**2) - pull]

    found = integrate_pieces(rate, breaks_of(move, times), np.zeros(4), times, atol=1e-12)
    stretch, turn = found[:, :2].T
    place = sample_move(move, times).positions
    return np.column_stack(
        [
            (RADIUS + stretch) * wave(place + turn) - RADIUS * wave(place)
            for wave in (np.cos, np.sin)
        ]
    )


@pytest.mark.parametrize(
    ("feed", "end", "torsional"),
    [
        ("3600 deg/min", "30 deg", 1e6),  # Euler: the table gives way
        pytest.param("100 rpm", "180 deg", 1e6, marks=pytest.mark.trials),
        ("36000 deg/min", "180 deg", 1e8),  # centripetal: the arm is stretched
    ],
)
def test_an_arm_that_turns_deviates_as_its_equations_of_motion_say(
    feed: str, end: str, torsional: float, tmp_path: Path
) -> None:
    scene = load_scene(
        ARM,
        overrides=[
            f"analyses.path.feeds=['{feed}']",
            f"analyses.path.to={{ C = '{end}' }}",
            f"joints.bearing.stiffness.rz='{torsional} N m/rad'",
        ],
    )
    curves = run(scene, tmp_path).runs[0].curves
    request = scene.analyses[PathRequest]
    expected = turn_arm(request.moves[0], curves.deviation.times, 5e6, torsional)
    size = np.abs(expected).max()
    assert size > 2e-6
    assert np.abs(curves.deviation.total - expected).max() < 4e-3 * size
    if torsional > 1e7:
        # at constant speed the spring takes m w^2 r, to what it is stretched itself
        held = WEIGHT * request.moves[0].feed ** 2 * RADIUS / 5e6
        late = np.argmin(np.abs(curves.deviation.times - request.moves[0].braking))
        stretch = float(np.linalg.norm(curves.deviation.total[late]))
        assert stretch == approx(held, rel=1e-2)


def test_a_frozen_pose_turns_loads_but_not_the_machine(tmp_path: Path) -> None:
    """In the pose of the middle the arm lies along x; 1 degree of trajectory turns nothing else."""
    small = [
        "analyses.path={ from = { C = '-1 deg' }, to = { C = '1 deg' }, feeds = ['600 deg/min'], time_constant = '50 ms',"
        " sampling = '16 kHz', residual_time = '50 ms', outputs = [['tip', 'y']] }"
    ]
    answer = run(load_scene(ARM, overrides=small), tmp_path)
    curves = answer.runs[0].curves
    size = np.abs(curves.frozen).max()
    assert np.abs(curves.deviation.total - curves.frozen).max() < 1e-3 * size
    # Euler: r M / k with M = (I + m r^2) alpha
    alpha = np.abs(curves.accelerations).max()
    bent = RADIUS * (TABLE + WEIGHT * RADIUS**2) * alpha / 1e6
    assert np.abs(curves.deviation.quasi_static).max() == approx(bent, rel=1e-3)
    assert (answer.unit, curves.name) == ("rad", "600 deg/min")
    assert answer.length == approx(np.radians(2.0))


BEAM = stored_scene("rotary_axes_beam")


def test_a_beam_that_is_turned_bends_at_its_root_as_beam_theory_says(tmp_path: Path) -> None:
    """Clamped at the distance a from the axis: the load rho A alpha (a + x) bends the tip by
    rho A alpha (a L^4 / 8 + 11 L^5 / 120) / (E I), and it vibrates at its first frequency.
    """
    path = write_scene(tmp_path, BEAM, name="beam")
    curves = run(load_scene(path), tmp_path / "out").runs[0].curves
    length, root, section = 0.6, 0.05, 0.02**2
    bending = 210e9 * 0.02**4 / 12.0
    alpha = np.abs(curves.accelerations).max()
    load = 7800.0 * section * alpha
    bent = load * (root * length**4 / 8.0 + 11.0 * length**5 / 120.0) / bending
    # shear gives way by half a percent
    assert np.abs(curves.deviation.quasi_static).max() == approx(bent, rel=1e-2)
    times = curves.deviation.times
    late = (times > curves.zones[0][1]) & (times < curves.zones[1][0])
    wave = curves.deviation.dynamic[late, 0]
    crossings = np.flatnonzero(np.diff(np.sign(wave)) > 0)
    weights = wave[crossings] / (wave[crossings] - wave[crossings + 1])
    places = times[late][crossings] + weights * (times[1] - times[0])
    expected = 1.87510407**2 / (2.0 * np.pi) * np.sqrt(bending / (7800.0 * section * length**4))
    assert len(places) > 3
    assert 1.0 / np.diff(places).mean() == approx(expected, rel=1e-2)


DRIVEN = [
    "joints.arm={ between = ['weight.center', 'table.side'], kind = 'spring', at = ['400 mm', '0 mm', '25 mm'],"
    " stiffness = { y = 'rigid', z = 'rigid' } }",
    "joints.screw={ between = ['weight.center', 'table.side'], kind = 'ball_screw', axis = 'x', at = ['400 mm', '0 mm', '25 mm'],"
    " stiffness = { axial = '5 N/um' } }",
    "axes.R={ joints = ['arm', 'screw'], limits = ['-100 mm', '100 mm'] }",
    "drives.R={ axis = 'R', inertia = '1e-4 kg m^2', lead = '10 mm', kv = '40 1/s', velocity_gain = '1e4 N s/m',"
    " integral_time = '15 ms', feed_forward = { velocity = '100 %', acceleration = '100 %' } }",
    "effects={ damping = { modal = '5 %' }, drive_control = true }",
    "analyses.path.pose_model='frozen'",
]


def test_a_slide_that_hardly_turns_follows_its_uneven_guide_under_control_as_on_a_linear_path(
    tmp_path: Path,
) -> None:
    """Across it the guide is rigid, on a table that gives way; the linear path has other equations."""
    found = []
    for turn in ("0", "1e-5"):
        curves = []
        for effect in ("false", "true"):
            scene = load_scene(
                ARM,
                overrides=[
                    "analyses.path.from={ C = '30 deg', R = '-50 mm' }",
                    f"analyses.path.to={{ C = '{30.0 + float(turn)!r} deg', R = '50 mm' }}",
                    "analyses.path.feeds=['12 m/min']",
                    *DRIVEN,
                    f"effects.guide_errors={effect}",
                    "axes.R.errors={ EY = { waves = [{ period = '20 mm', amplitude = '20 um' }] },"
                    " EX = { waves = [{ period = '30 mm', amplitude = '5 um' }] } }",
                    "joints.bearing.stiffness.rz='1e5 N m/rad'",
                ],
            )
            curves.append(run(scene, tmp_path / turn / effect).runs[0].curves.deviation.total)
        found.append(curves[1] - curves[0])
    straight, turning = found
    size = np.abs(straight).max()
    assert size > 2e-5
    assert np.abs(turning - straight).max() < 2e-4 * size


DAMPED = [
    *DRIVEN[:4],
    "effects={ damping = true, drive_control = true }",
    "joints.bearing.damping={ rz = '200 N m s/rad' }",
    "joints.screw.damping={ axial = '800 N s/m' }",
    "analyses.path.from={ C = '0 deg', R = '-50 mm' }",
    "analyses.path.to={ C = '60 deg', R = '50 mm' }",
    "analyses.path.feeds=['18 m/min']",
]


def test_a_slide_under_control_on_an_arm_that_turns_follows_its_equations_of_motion(
    tmp_path: Path,
) -> None:
    """Weight, motor, table and controller, with Coriolis and centrifugal forces; C is ideal."""
    scene = load_scene(ARM, overrides=DAMPED)
    curves = run(scene, tmp_path).runs[0].curves
    move, times = scene.analyses[PathRequest].moves[0], curves.deviation.times
    share, motor, gain = np.radians(60.0) / 0.1, 1e-4 / (0.01 / (2.0 * np.pi)) ** 2, 1e4

    def rate(time: float, state: FloatArray) -> list[float]:
        speed, pull = travel(move, time)
        place, slide, turn, screw, out, spin, follow, held = state
        radius, omega = RADIUS - 0.05 + slide, share * speed + spin
        spring = 5e6 * (slide - screw) + 800.0 * (out - follow)
        wanted = 40.0 * (place - screw) + speed - follow
        force = gain * wanted + held + (WEIGHT + motor) * pull
        inertia = TABLE + WEIGHT * radius**2
        moment = -1e6 * turn - 200.0 * spin - 2.0 * WEIGHT * radius * out * omega
        return [
            speed,
            out,
            spin,
            follow,
            radius * omega**2 - spring / WEIGHT,
            moment / inertia - share * pull,
            (spring + force) / motor,
            gain / 0.015 * wanted,
        ]

    breaks = breaks_of(move, times)
    found = integrate_pieces(rate, breaks, np.zeros(8), times, method="LSODA", atol=1e-12)
    place, slide, turn = found[:, :3].T
    expected = np.column_stack(
        [
            (RADIUS - 0.05 + slide) * wave(share * place + turn)
            - (RADIUS - 0.05 + place) * wave(share * place)
            for wave in (np.cos, np.sin)
        ]
    )
    size = np.abs(expected).max()
    assert size > 2e-6
    assert np.abs(curves.deviation.total - expected).max() < 1e-2 * size


def test_a_weight_that_slides_along_an_arm_that_turns_feels_coriolis_forces(
    tmp_path: Path,
) -> None:
    scene = load_scene(ARM)
    parts = start(scene, tmp_path).parts
    path = MachinePath(
        Pose("from", {"C": 0.0, "R": 0.0}), Pose("to", {"C": 1.2, "R": 0.1}), frozenset({"C"})
    )
    # the feed is that of the linear axis (NIST RS274/NGC)
    assert path.unit == "m"
    assert path.length == approx(0.1)
    speed, pull, share = 0.3, 2.0, 12.0
    places = np.array([0.0, 0.05, 0.1])
    trajectory = RotaryTrajectory(parts, path)
    motion = PathMotion(places, np.full(3, speed), np.full(3, pull))
    found = trajectory.accelerate(motion)[
        :, [trajectory.bodies.index(("weight", f"acceleration {dof}")) for dof in ("x", "y")]
    ]
    omega, alpha = share * speed, share * pull
    for place, acceleration in zip(places, found, strict=True):
        radius, angle = RADIUS + place, share * place
        outwards = np.array([np.cos(angle), np.sin(angle)])
        across = np.array([-np.sin(angle), np.cos(angle)])
        expected = (pull - radius * omega**2) * outwards
        expected += (radius * alpha + 2.0 * speed * omega) * across
        np.testing.assert_allclose(
            acceleration, expected, rtol=0.0, atol=1e-7 * np.abs(expected).max()
        )


@pytest.mark.parametrize("turns", [True, False], ids=["the tool turns", "the work turns"])
def test_a_cut_around_a_table_pushes_across_and_along_the_radius(
    turns: bool, tmp_path: Path
) -> None:
    """A steady force of the teeth turns with the arm, and stays where the work turns under a tool."""
    means = []
    for effect in ("false", "true"):
        point = "tip={ tool='weight.center', work='ground' }"
        if not turns:
            point = "tip={ tool='ground', work='weight.center' }"
        scene = load_scene(
            ARM,
            overrides=[
                f"points.{point}",
                "analyses.path.feeds=['1200 deg/min']",
                "analyses.path.to={ C = '30 deg' }",
                "analyses.path.sampling='4 kHz'",
                "analyses.path.pose_model='pose_dependent'",
                f"effects={{ damping = {{ modal = '20 %' }}, cutting_force = {effect} }}",
                "analyses.path.cut={ mill = { diameter = '10 mm', teeth = 4, helix = '30 deg' }, spindle = '6000 rpm',"
                " axial_depth = '2 mm', radial_depth = '1 mm', material = 'al7075-t6' }",
            ],
        )
        curves = run(scene, tmp_path / effect).runs[0].curves
        means.append(curves.deviation.total)
    moved, angles = means[1] - means[0], curves.positions
    cut = present(scene.analyses[PathRequest].cut).cut
    later = (curves.deviation.times > 0.5) & (curves.deviation.times < 1.3)
    feed = np.radians(20.0) * RADIUS
    fine: FloatArray = np.asarray(np.arange(0.0, 0.01, 1e-5), dtype=float)
    along, left, _ = cutting_forces(cut, fine, np.full(len(fine), feed)).mean(axis=0)
    # of the tool against the work; to the left of a trajectory that goes round anticlockwise is its centre
    sign = 1.0 if turns else -1.0
    radial, across = -left * sign, along * sign
    pulled = np.column_stack(
        [radial / 5e6 * np.ones(len(angles)), across * RADIUS**2 / 1e6 * np.ones(len(angles))]
    )
    wave, other = np.cos(angles), np.sin(angles)
    expected = np.column_stack(
        [pulled[:, 0] * wave - pulled[:, 1] * other, pulled[:, 0] * other + pulled[:, 1] * wave]
    )
    averaged = [np.convolve(each, np.full(40, 1 / 40), "same") for each in moved.T]
    off = np.column_stack(averaged)[later] - expected[later]
    size = np.abs(expected[later]).max()
    assert size > 1e-5
    assert np.abs(off).max() < 1e-2 * size


def test_a_table_that_spins_while_it_is_tilted_feels_its_gyroscopic_moment(
    tmp_path: Path,
) -> None:
    scene = load_scene(
        ARM,
        overrides=[
            "axes.A={ kind = 'rotary', joint = 'feet', direction = 'x', center = ['0 mm', '0 mm', '0 mm'] }"
        ],
    )
    parts = start(scene, tmp_path).parts
    path = MachinePath(
        Pose("from", {"A": 0.0, "C": 0.0}), Pose("to", {"A": 0.3, "C": 0.9}), frozenset("AC")
    )
    assert path.unit == "rad"
    trajectory = RotaryTrajectory(parts, path)
    first = trajectory.bodies.index(("table", "acceleration rx"))
    motion = PathMotion(np.zeros(1), np.full(1, 2.0), np.zeros(1))
    (spin,) = trajectory.accelerate(motion)[:, first : first + 3]
    tilt, turn = (2.0 * angle / path.length for angle in (0.3, 0.9))
    inertia = parts.superelements["table"].inertia
    # about x and about the axis that x tilts: w = (tilt, 0, turn), w' = tilt x turn about -y
    omega, alpha = np.array([tilt, 0.0, turn]), np.array([0.0, -tilt * turn, 0.0])
    moment = inertia @ alpha + np.cross(omega, inertia @ omega)
    np.testing.assert_allclose(inertia @ spin, moment, rtol=1e-7, atol=1e-9 * np.abs(moment).max())


@cases
def test_what_a_path_that_turns_cannot_have_is_named(overrides: list[str], words: str) -> None:
    with pytest.raises(SceneError, match=words):
        load_scene(ARM, overrides=overrides)
