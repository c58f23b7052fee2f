"""Errors of guides along a path: slow travel against static poses, fast waves against the frequency
response.
"""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

import scene_runs
from common import approx, present
from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.machine import Pose
from headstock.pipeline.answers.answer import find_answers
from headstock.pipeline.answers.path import PathResult
from headstock.pipeline.motion.path import _lay_path, _solve_moves
from headstock.pipeline.results.results import Results
from headstock.pipeline.runner import run_scene
from headstock.reduction.coupling.drives import place_drives, release_motors
from headstock.reduction.coupling.guide_errors import find_places, sample_offsets
from headstock.reduction.coupling.joint_springs import place_joints
from headstock.reduction.motions.body_motions import solve_machine_static
from headstock.reduction.motions.tool_deviation import GEOMETRY, solve_deviation
from headstock.scene.analyses.path import PathRequest
from headstock.scene.building.loader import load_scene
from headstock.scene.scene import Scene, keep_analyses
from headstock.solvers.control.drive_loops import close_loops
from headstock.solvers.control.drive_trains import FORCE
from headstock.solvers.control.linear_blocks import block_response
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.damping import add_modal_damping
from headstock.solvers.linear.modal_analysis import solve_modal
from scene_runs import couple_parts

SCENE = Path(__file__).parents[2] / "data" / "three_rigid_axes.toml"
SLOW = (
    "effects.damping={ modal = 0.05 }",
    "analyses.path={ from = { X = '-150 mm', Y = '50 mm' }, to = { X = '150 mm', Y = '-50 mm' }, "
    "feeds = ['6 m/min'], time_constant = '200 ms', sampling = '400 Hz', outputs = [['tcp', 'x'], ['tcp', 'y'], ['tcp', 'z']] }",
)
PASSING = (
    "axes.X.errors={ EZ = { polynomial = ['0 um'] } }",
    "axes.Y.errors={ EZ = { polynomial = ['0 um'] } }",
    "axes.Z.errors={ EZ = { polynomial = ['0 um'] } }",
    "joints.x_guide.errors={ ball_passing = { period = '2 mm', normal = '1 um', lateral = '0.5 um' } }",
    "joints.x_guide.each={ 2 = { 'errors.ball_passing.phase' = '90 deg' } }",
    "joints.x_guide.damping={ normal = '200 kN s/m', lateral = '100 kN s/m' }",
    *(f"joints.{axis}_drive.damping={{ axial = '60 kN s/m' }}" for axis in "xyz"),
    *(
        f"joints.{axis}_guide.damping={{ normal = '200 kN s/m', lateral = '100 kN s/m' }}"
        for axis in "yz"
    ),
    "effects.damping=true",
    "analyses.path={ from = { X = '-100 mm' }, to = { X = '100 mm' }, feeds = ['3600 mm/min'], "
    "time_constant = '50 ms', sampling = '2 kHz', residual_time = '1 s', pose_model = 'frozen', outputs = [['tcp', 'x'], ['tcp', 'y'], ['tcp', 'z']] }",
)


def run(scene: Scene, folder: Path) -> PathResult:
    results: Results = run_scene(keep_analyses(scene, ("path",)), folder, comm=MPI.COMM_SELF)
    assert not results.failures
    return next(iter(find_answers(results.answers, PathResult)))


def at_rest(scene: Scene, position: float) -> FloatArray:
    """What errors of guides move the tool by at a place of the path."""
    pose = scene.analyses[PathRequest].path.pose_at(position)
    coupled = couple_parts(scene.machine, pose)
    return solve_deviation(coupled, scene.machine, "tcp").sources[GEOMETRY]


def test_slow_travel_takes_the_static_deviation_of_each_pose(tmp_path: Path) -> None:
    scene = load_scene(SCENE, overrides=SLOW)
    with_errors = run(scene, tmp_path / "with")
    ideal = run(
        load_scene(SCENE, overrides=[*SLOW, "effects.guide_errors=false"]), tmp_path / "without"
    )
    own, other = (answer.runs[0].curves for answer in (with_errors, ideal))
    moved = own.deviation.total - other.deviation.total
    first = at_rest(scene, 0.0)
    quiet = (own.deviation.times > 1.0) & (own.deviation.times < own.zones[1][0])
    numbers = np.flatnonzero(quiet)[:: len(np.flatnonzero(quiet)) // 12]
    assert len(numbers) > 10
    size = np.abs(moved).max()
    for number in numbers:
        expected = at_rest(scene, float(own.positions[number])) - first
        # 100 mm/s over waves of 250 mm and more: 0.4 Hz against some 30 Hz of the machine
        assert np.abs(moved[number] - expected[:3]).max() < 1e-3 * size


def test_moves_repeated_at_mid_path_keep_the_errors_of_all_poses(tmp_path: Path) -> None:
    """± compares such moves: what a finer mesh changes of errors along the path must be in them."""
    state = scene_runs.start(keep_analyses(load_scene(SCENE, overrides=SLOW), ["path"]), tmp_path)
    request = state.scene.analyses[PathRequest]
    frozen = dataclasses.replace(request, follows_pose=False)
    repeated = _solve_moves(_lay_path(state, frozen, pose_errors=True))
    followed = _solve_moves(_lay_path(state, request))
    (move,), (kept,), (right,) = repeated.moves, repeated.kept, followed.moves
    quiet = np.abs(right.times - 0.5 * right.times.max()) < 0.5  # at constant feed
    size = np.ptp(right.total[quiet])
    assert np.abs(move.total - right.total)[quiet].max() < 1e-3 * size
    assert np.abs(kept.total - right.total)[quiet].max() > 1e-2 * size


RAILS = (
    "effects.damping={ modal = 0.05 }",
    "analyses.path={ from = { X = '-60 mm' }, to = { X = '60 mm' }, feeds = ['600 mm/min'], "
    "time_constant = '1 s', sampling = '50 Hz', pose_model = 'frozen', outputs = [['tcp', 'z']] }",
)


@pytest.mark.parametrize("driven", [False, True], ids=["ideal motors", "controlled"])
def test_joints_take_on_a_slow_path_what_statics_say(driven: bool, tmp_path: Path) -> None:
    """Springs of carriages rest where the rails are uneven: K (stretch - offset), beside the
    beginning.
    """
    given = [*RAILS, *(DRIVEN if driven else [])]
    scene = load_scene(SCENE, variant="profiles", overrides=given)
    ideal = load_scene(SCENE, variant="profiles", overrides=[*given, "effects.guide_errors=false"])
    found, plain = (
        run(each, tmp_path / name).runs[0].joints
        for name, each in (("with", scene), ("without", ideal))
    )
    request, machine = scene.analyses[PathRequest], scene.machine
    middle = couple_parts(machine, request.path.pose_at(0.5 * request.path.length))
    springs = {spring.name: spring for spring in middle.joint_springs}

    def offsets(position: float) -> dict[str, FloatArray]:
        positions = request.path.pose_at(position).positions
        pose = Pose("", positions)
        coupled = couple_parts(machine, pose)
        placed = find_places(
            machine, positions, coupled.layout, place_joints(machine, coupled.layout)
        )
        totals: dict[str, FloatArray] = {}
        for by_joint in sample_offsets(machine, placed).values():
            for joint, offset in by_joint.items():
                totals[joint] = totals.get(joint, np.zeros(6)) + offset[0]
        return totals

    first, forces = offsets(0.0), []
    names = [name for name in first if name.startswith("x_guide")]
    for position in np.linspace(0.0, request.path.length, 61):
        change = {name: own - first[name] for name, own in offsets(float(position)).items()}
        load = sum(
            springs[name].rows[:6].T @ springs[name].stiffness[:6, :6] @ own
            for name, own in change.items()
        )
        moved = solve_machine_static(middle, np.asarray(load)).displacements
        forces.append(
            [
                (springs[name].stiffness[:6, :6] @ (springs[name].rows[:6] @ moved - own))[2]
                for name, own in ((name, change[name]) for name in names)
            ]
        )
    assert len(names) == 4
    largest = np.array(forces)[np.abs(forces).argmax(axis=0), range(4)]
    size = np.abs(largest).max()
    assert size > 100.0
    for name, value in zip(names, largest, strict=True):
        assert abs(plain[name]["z"].value) < 0.02 * size  # of the acceleration
        assert found[name]["z"].value == approx(value, abs=0.02 * size)


def test_passing_balls_shake_the_tool_as_the_frequency_response_says(tmp_path: Path) -> None:
    scene = load_scene(SCENE, overrides=PASSING)
    found = run(scene, tmp_path)
    cruise = found.runs[0].cruises
    machine = scene.machine
    coupled = couple_parts(machine, Pose("middle"))
    omega = 2.0 * np.pi * 0.06 / 0.002
    system = coupled.system
    assert system.damping is not None
    dynamic = system.stiffness - omega**2 * system.mass + 1j * omega * system.damping
    force = np.zeros(len(system.mass), dtype=complex)
    for spring in coupled.joint_springs:
        if spring.name.startswith("x_guide"):
            joint = machine.joints[spring.name]
            assert joint.errors is not None and joint.point is not None
            wave = joint.errors.passing[2].waves[0]
            place = joint.point[0] - machine.components["bed"].placement.origin[0]
            turn = np.exp(1j * (2.0 * np.pi * place / wave.period + wave.phase))
            offset = -np.array([0.0, 0.5e-6, 1e-6, 0.0, 0.0, 0.0]) * turn
            force += spring.rows.T @ ((spring.stiffness + 1j * omega * spring.damping) @ offset)
    moved = np.linalg.solve(dynamic, force)
    expected = [float(abs(system.outputs["tcp", dof] @ moved)) for dof in "xyz"]
    assert max(expected) > 1e-7
    for channel, value in enumerate(expected):
        figures = cruise[channel]
        assert figures is not None
        if value > 0.05 * max(expected):
            assert figures.distance == approx(0.002, rel=2e-3)
            assert figures.amplitude == approx(value, rel=5e-3)


WAVY = (
    "axes.X.errors.EB={ waves = [{ period = '60 mm', amplitude = '20 urad', phase = '80 deg' }] }",
    "axes.Y.errors.EZ={ waves = [{ period = '30 mm', amplitude = '2 um', phase = '80 deg' }] }",
)
BRISK = (
    "analyses.path={ from = { X = '-150 mm', Y = '50 mm' }, to = { X = '0 mm', Y = '0 mm' }, feeds = ['30 m/min'], "
    "time_constant = '50 ms', sampling = '1 kHz', pose_model = 'MODEL', "
    "outputs = [['tcp', 'x'], ['tcp', 'y'], ['tcp', 'z'], ['tcp', 'rx']] }"
)
DRIVEN = [
    "effects.drive_control=true",
    *(
        f"drives.{axis}={{ axis = '{axis}', inertia = '2e-3 kg m^2', lead = '10 mm', kv = '40 1/s',"
        " velocity_gain = '1e5 N s/m', integral_time = '15 ms' }"
        for axis in "XYZ"
    ),
]
SCALED = ["drives.X.encoder='scale'", "drives.X.scale='table_top'"]
DAMPERS = [f"joints.{axis}_drive.damping={{ axial = '60 kN s/m' }}" for axis in "xyz"]
MODAL = ["effects.damping={ modal = 0.05 }"]


def guides(stiffness: float | None) -> list[str]:
    """All guides so many times as stiff as in the scene; None for rigid ones."""

    def write(size: float) -> str:
        return "rigid" if stiffness is None else f"{size * stiffness:g} N/um"

    return [
        f"joints.{axis}_guide.stiffness={{ lateral = '{write(400)}', normal = '{write(500)}' }}"
        for axis in "xyz"
    ]


def moved_by_errors(folder: Path, *overrides: str) -> FloatArray:
    """What errors add to the deviation along a brisk path ``(n, 4)``."""
    moved = []
    for effect in ("true", "false"):
        scene = load_scene(SCENE, overrides=[*WAVY, *overrides, f"effects.guide_errors={effect}"])
        moved.append(run(scene, folder / effect).runs[0].curves.deviation.total)
    return np.asarray(moved[0] - moved[1])


@pytest.mark.parametrize(
    ("settings", "near", "model"),
    [
        (MODAL, 2e-5, "frozen"),
        (MODAL, 2e-5, "pose_dependent"),
        (["effects.damping=true", *DAMPERS], 5e-5, "frozen"),
        # beside it modes that stiff guides have and a loop leaves out
        ([*MODAL, *DRIVEN], 3e-4, "frozen"),
        ([*MODAL, *DRIVEN, *SCALED], 3e-4, "pose_dependent"),
    ],
    ids=["modal damping", "along poses", "dampers", "controlled", "scale along poses"],
)
def test_errors_of_rigid_guides_are_those_of_very_stiff_ones(
    settings: list[str], near: float, model: str, tmp_path: Path
) -> None:
    given = [*settings, BRISK.replace("MODEL", model)]
    if DRIVEN[0] in given:
        given = [text.replace(", ['tcp', 'rx']", "") for text in given]
    rigid = moved_by_errors(tmp_path / "rigid", *guides(None), *given)
    stiff = moved_by_errors(tmp_path / "stiff", *guides(1e4), *given)
    sizes = np.abs(rigid).max(axis=0)
    assert (sizes > 1e-5).all()
    assert (np.abs(stiff - rigid).max(axis=0) < near * sizes).all()


def test_rigid_axes_go_where_their_errors_lead(tmp_path: Path) -> None:
    """All but a screw is rigid: the deviation is the motion of rigid bodies in each pose."""
    screw = "joints.z_drive.stiffness={ axial = '150 N/um' }"
    scene = load_scene(SCENE, variant="rigid_guides", overrides=[*SLOW, screw])
    own = run(scene, tmp_path).runs[0].curves
    first = at_rest(scene, 0.0)
    size = np.abs(own.deviation.total).max()
    assert size > 2e-5
    for number in range(0, len(own.positions), len(own.positions) // 12):
        expected = at_rest(scene, float(own.positions[number])) - first
        moved = own.deviation.total[number]
        assert np.abs(moved[:2] - expected[:2]).max() < 1e-6 * size
        # the screw gives way to the inertia of slow waves
        assert abs(moved[2] - expected[2]) < 1e-4 * size


def test_errors_of_rigid_guides_that_nothing_follows_are_refused(tmp_path: Path) -> None:
    passing = [
        "axes.X.errors={ EZ = { polynomial = ['0 um'] } }",
        "joints.x_guide.errors={ ball_passing = { period = '2 mm', normal = '1 um' } }",
        "joints.x_guide.each={ 2 = { 'errors.ball_passing.phase' = '90 deg' } }",
    ]
    scene = load_scene(SCENE, overrides=[*SLOW, *guides(None), *passing])
    with pytest.raises(ModelError, match="contradict each other"):
        run_scene(keep_analyses(scene, ("path",)), tmp_path, comm=MPI.COMM_SELF)


RIPPLE = (
    "effects={ damping = { modal = 0.05 }, drive_control = true, torque_ripple = true }",
    "joints.x_drive.at=['0 mm', '0 mm', '-40 mm']",
    "analyses.path={ from = { X = '-100 mm' }, to = { X = '100 mm' }, feeds = ['3 m/min'], "
    "time_constant = '50 ms', sampling = '2 kHz', residual_time = '1 s', "
    "outputs = [['tcp', 'x'], ['tcp', 'z']] }",
)


def test_torque_ripple_shakes_the_tool_as_the_closed_loop_says(tmp_path: Path) -> None:
    scene = load_scene(SCENE, overrides=RIPPLE)
    found = run(scene, tmp_path)
    coupled = couple_parts(scene.machine, Pose("middle"))
    drive = scene.drives["X"]
    trains = place_drives(coupled, scene.machine, [drive])
    released = release_motors(coupled, trains)
    system = add_modal_damping(released.system, (0.05,), solve_modal(released.system))
    loop = close_loops(
        system, trains, inputs=[("X", FORCE)], outputs=[("tcp", "x"), ("tcp", "z")]
    ).space
    omega = 2.0 * np.pi * 6 * 0.05 / drive.lead
    place = loop.inputs.index(("X", FORCE))
    states = np.linalg.solve(1j * omega * np.eye(len(loop.a)) - loop.a, loop.b[:, place])
    force = 0.2 * 2.0 * np.pi / drive.lead
    expected = force * np.abs(loop.c[:2] @ states + loop.d[:2, place])
    figures = [present(cruise) for cruise in found.runs[0].cruises[:2]]
    assert expected.min() > 1e-9
    assert [each.distance for each in figures] == approx([drive.lead / 6] * 2, rel=2e-3)
    assert [each.amplitude for each in figures] == approx(expected.tolist(), rel=1e-2)


def test_a_motor_answers_its_torque_ripple_as_its_controller_says(tmp_path: Path) -> None:
    """Torque and position error of the same wave are apart by a controller of proportional position
    and PI speed: ``kp (1 + 1 / (s T)) (kv + s)``, late by its dead time.
    """
    scene = load_scene(SCENE, overrides=RIPPLE)
    (own,) = run(scene, tmp_path).runs
    drive, curves = scene.drives["X"], own.curves
    still = run(load_scene(SCENE, overrides=[*RIPPLE, "effects.torque_ripple=false"]), tmp_path)
    rest = still.runs[0].curves
    times, omega = curves.deviation.times, 2.0 * np.pi * 6 * 0.05 / drive.lead
    # whole periods at constant feed, long after the ramp
    some = (times >= 2.0) & (times < 2.0 + 40 * 2.0 * np.pi / omega)
    wave = np.exp(-1j * omega * times[some])
    torque, error = (
        2.0 * abs(np.mean(wave * (shaken - calm)[some, 0]))
        for shaken, calm in (
            (curves.torques, rest.torques),
            (curves.position_errors, rest.position_errors),
        )
    )
    s = 1j * omega
    control = drive.control
    gain = block_response(control.law, np.array([omega]))[0, 0, 0] * (
        present(control.position_gain) + s
    )
    assert torque > 1e-3
    assert torque == approx(drive.lead / (2.0 * np.pi) * abs(gain) * error, rel=1e-2)
    assert abs(own.drives["X"].torque.value) == approx(np.abs(curves.torques).max())
