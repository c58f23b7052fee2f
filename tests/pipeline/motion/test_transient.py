"""Loads over time of scenes: a cantilever against the modal sum of Euler and Bernoulli, impulse
response against frequency response, machines against direct integration, and what is refused.
"""

import json
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI
from scipy.optimize import brentq
from summary_shapes import list_strangers

from cases import cases
from common import approx, present
from direct_integration import integrate_pieces
from fixture_machines import machine, stored_scene
from headstock.app.report.report import render_report
from headstock.app.views.transient import _tabulate_transient
from headstock.geometry.frames import FloatArray
from headstock.pipeline.answers.answer import find_answers
from headstock.pipeline.answers.frf import PoseResponse
from headstock.pipeline.answers.transient import TRUNCATION, TransientAnswer
from headstock.pipeline.motion.transient import SMOOTHING, _respond_in_time
from headstock.pipeline.results.files import open_results
from headstock.pipeline.results.results import Results
from headstock.pipeline.results.summary import summarise
from headstock.pipeline.stages.control import drive_machine
from headstock.pipeline.stages.machine import couple_pose, damp_system
from headstock.pipeline.stages.mechanism import build_lumped_model, place_pose
from headstock.pipeline.stages.run_state import PoseModel
from headstock.pipeline.stages.shared_components import make_superelements, start_run
from headstock.pipeline.storage.store import Store
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.findings import SceneError
from headstock.scene.scene import Scene
from headstock.studies.kind_changes import compare_kinds
from scene_runs import run

ROOT = Path(__file__).resolve().parents[3]
COLUMN = ROOT / "tests" / "data" / "segmented_column.toml"
SLIDE = ROOT / "tests" / "data" / "slide.toml"
ROD = machine("""
machine = "bar"
names = { bar = "rod" }
materials.steel.nu = 0.0
components.rod.solid = { box = ["10 mm", "10 mm", "400 mm"] }
components.rod.fidelity = "polynomial"
effects.damping = { modal = "1 %" }
analyses.transient = { outputs = [["tcp", "x"]] }
""")


def write_scene(folder: Path, text: str, transient: str, more: str = "") -> Scene:
    path = folder / "scene.toml"
    path.write_text(f"{text}{transient}\n{more}")
    return load_scene(path)


def column_scene(folder: Path, transient: str, more: str = "") -> Scene:
    return write_scene(folder, COLUMN.read_text(), f"[analyses.transient]\n{transient}", more)


def answer_of(results: Results) -> TransientAnswer:
    (answer,) = find_answers(results.answers, TransientAnswer)
    return answer


def posed_model(scene: Scene, folder: Path, pose: str) -> PoseModel:
    state = start_run(scene, MPI.COMM_SELF, Store(folder / "store"))
    make_superelements(state)
    parts, place = state.parts, state.plan.poses[pose]
    if scene.is_lumped:
        model = build_lumped_model(parts, parts.superelements)
        return place_pose(parts, place, model, parts.superelements)
    return couple_pose(parts, place)


def integrate(model: PoseModel, push: FloatArray, times: FloatArray) -> FloatArray:
    """Motion ``(n, steps)`` of all dofs under a half sine of 2 ms, by an integrator of a library."""
    system = damp_system(model.parts.scene, model.system, model.all_modes)
    masses, vectors = np.linalg.eigh(system.mass)
    heavy = masses > 1e-9 * masses.max()
    # dofs without mass follow statically: q = moving a + still b
    moving, still = vectors[:, heavy], vectors[:, ~heavy]
    soft = np.linalg.inv(still.T @ system.stiffness @ still)
    follow = moving - still @ (soft @ (still.T @ system.stiffness @ moving))
    jump = still @ (soft @ (still.T @ push))
    damping = np.zeros_like(system.mass) if system.damping is None else system.damping
    count, inverse = int(heavy.sum()), 1.0 / masses[heavy][:, None]
    stiffness = inverse * (follow.T @ system.stiffness @ follow)
    damped = inverse * (follow.T @ damping @ follow)
    pushed = inverse[:, 0] * (follow.T @ push)

    def rate(time: float, state: FloatArray) -> FloatArray:
        force = np.sin(np.pi * time / 0.002) if time < 0.002 else 0.0
        q, v = state[:count], state[count:]
        return np.concatenate([v, pushed * force - stiffness @ q - damped @ v])

    breaks = (0.0, 0.002, float(times[-1]))
    solved = integrate_pieces(rate, breaks, np.zeros(2 * count), times, atol=1e-17)
    forces = np.where(times < 0.002, np.sin(np.pi * times / 0.002), 0.0)
    found = follow @ solved[:, :count].T + np.outer(jump, forces)
    return found


def test_a_cantilever_under_a_step_follows_the_modal_sum_of_euler_and_bernoulli(
    tmp_path: Path,
) -> None:
    # a slender rod: shear and rotary inertia are 1e-3 of its low frequencies
    scene = write_scene(
        tmp_path,
        ROD,
        'duration = "40 ms"\nup_to = "2 kHz"\n'
        '[analyses.transient.loads]\nstep = { at = ["tcp", "x"], shape = "step", size = "10 N" }',
    )
    answer = answer_of(run(scene, tmp_path))
    length, side, modulus, density = 0.4, 0.01, 210e9, 7850.0
    bending, line_mass = modulus * side**4 / 12.0, density * side**2
    roots = [
        float(brentq(lambda z: np.cos(z) + 1.0 / np.cosh(z), (n + 0.3) * np.pi, (n + 0.7) * np.pi))
        for n in range(6)
    ]
    times, exact = answer.curves.times, np.zeros(len(answer.curves.times))
    for root in roots:
        # mass-normalised, every shape is 2 / sqrt(m) at the tip (Blevins 1979, table 8-1)
        omega = root**2 * np.sqrt(bending / line_mass) / length**2
        moving = omega * np.sqrt(1.0 - 1e-4)
        swing = np.cos(moving * times) + 1e-2 * omega / moving * np.sin(moving * times)
        static = 10.0 * 4.0 / (line_mass * length) / omega**2
        exact += static * (1.0 - np.exp(-1e-2 * omega * times) * swing)
    (figures,) = answer.figures
    assert figures.final == approx(10.0 * length**3 / (3.0 * bending), rel=3e-3)
    assert figures.peak == approx(float(exact.max()), rel=5e-3)
    moved = answer.curves.displacements[:, 0]
    assert np.abs(moved - exact).max() < 0.03 * exact.max()


DRIVEN = stored_scene("transient_driven")


def driven_scene(folder: Path, transient: str, *, encoder: str = "motor", more: str = "") -> Scene:
    text = SLIDE.read_text() + DRIVEN.replace("ENCODER", encoder)
    request = f'[analyses.transient]\nmotors = "controlled"\nposes = ["left"]\n{transient}'
    return write_scene(folder, text, request, more)


def test_the_fourier_transform_of_an_impulse_response_under_control_is_the_frequency_response(
    tmp_path: Path,
) -> None:
    """Dead times are exact in the frequency response and rational functions in time."""
    scene = driven_scene(
        tmp_path,
        'duration = "1 s"\nup_to = "2 kHz"\nsampling = "20 kHz"\noutputs = [["tcp", "x"]]\n'
        '[analyses.transient.loads]\nhit = { at = ["tcp", "x"], shape = "impulse", size = "1 N s" }',
        more='[analyses.frf]\ninputs = [["tcp", "x"]]\nfrom = "5 Hz"\nup_to = "300 Hz"\npoints = 21\n'
        'adaptive = false\nmotors = "controlled"\nposes = ["left"]\n',
    )
    results = run(scene, tmp_path)
    (response,) = find_answers(results.answers, PoseResponse)
    answer = answer_of(results)
    phases = np.exp(-2j * np.pi * np.outer(response.curves.frequencies_hz, answer.curves.times))
    transformed = phases @ answer.curves.displacements[:, 0] / 20e3
    expected = response.curves.receptance[:, 0, 0]
    assert np.abs(transformed - expected).max() < 2e-3 * np.abs(expected).max()
    assert summarise(results)["transient"]["left"]["motors"] == "controlled"


@pytest.mark.parametrize("encoder", ["motor", "scale"])
def test_an_integrator_holds_what_it_sees_under_a_step(tmp_path: Path, encoder: str) -> None:
    loads = '[analyses.transient.loads]\npush = { at = ["tcp", "x"], shape = "step", size = "1 N" }'
    text = f'duration = "1 s"\nup_to = "500 Hz"\noutputs = [["slide.bottom", "x"]]\n{loads}'
    scene = driven_scene(tmp_path, text, encoder=encoder)
    (figures,) = answer_of(run(scene, tmp_path)).figures
    locked = write_scene(
        tmp_path,
        SLIDE.read_text(),
        f'[analyses.transient]\nposes = ["left"]\n{text}',
        '[effects]\ndamping = { modal = "3 %" }\n',
    )
    (stiff,) = answer_of(run(locked, tmp_path)).figures
    assert figures.final is not None and stiff.final is not None
    # a motor encoder does not see the thread give way; a scale between bed and slide sees most of it
    if encoder == "scale":
        assert abs(figures.final) < 0.5 * stiff.final
    else:
        assert figures.final == approx(stiff.final, rel=1e-6)
    assert figures.peak > stiff.peak


RUBBING = (
    '{ axis="AXIS", inertia="2e-3 kg m^2", kv="40 1/s", velocity_gain="2e5 N s/m",'
    ' integral_time="20 ms", friction={ coulomb="30 N", breakaway="45 N", viscous="200 N s/m" } }'
)


def rubbing_scene(machine: str, *more: str) -> tuple[Scene, str]:
    """A rigid machine whose guides rub, and a pose: stepped, struck and shaken at the tool."""
    loads = (
        'push={ at=["tcp", "x"], shape="step", size="150 N", start="1 ms" },'
        ' hit={ at=["tcp", "x"], shape="impulse", size="0.4 N s", start="7.03 ms" },'
        ' shake={ at=["tcp", "z"], shape="half_sine", size="300 N", time="3 ms" }'
    )
    pose, drives = (
        ("left", ("X",)) if machine == "slide" else ("config_2", ("leg_1", "leg_2", "leg_3"))
    )
    overrides = [
        f'analyses={{ transient={{ motors="controlled", duration="12 ms", up_to="20 kHz", sampling="40 kHz", poses=["{pose}"],'
        f' outputs=[["tcp", "x"], ["tcp", "z"]], loads={{ {loads} }} }} }}',
        "effects={ drive_control=true, friction=true, damping={ modal=0.03 } }",
        *(f"drives.{name}={RUBBING.replace('AXIS', name.replace('leg_', 'q'))}" for name in drives),
        *more,
    ]
    if machine == "slide":
        overrides.append('drives.X.lead="10 mm"')
        overrides.append('components.bed.fidelity="rigid"')
        return load_scene(SLIDE, overrides=overrides), pose
    scene = load_scene(
        ROOT / "machines" / "tripteor.toml", variant="lumped+controlled", overrides=overrides
    )
    return scene, pose


@pytest.mark.parametrize("machine", ["slide", "mechanism"])
def test_guides_of_machines_rub_under_loads_over_time(machine: str, tmp_path: Path) -> None:
    """Beside all equations of motion, with the controllers and the friction written by hand."""
    scene, pose = rubbing_scene(machine)
    model = posed_model(scene, tmp_path, pose)
    driven = drive_machine(model, lambda text: None)
    system, names = driven.system, [train.name for train in driven.trains]
    answer = _respond_in_time(model, with_errors=False).answer
    times = answer.curves.times
    damping = np.zeros_like(system.mass) if system.damping is None else system.damping
    lighter = np.linalg.inv(system.mass)
    motors = np.array([system.inputs[name, "force"] for name in names])
    slides = np.array([system.inputs[name, "slide"] for name in names])
    size, kp = len(system.mass), 2e5

    def rate(time: float, state: FloatArray) -> FloatArray:
        q, v, held = state[:size], state[size : 2 * size], state[2 * size :]
        off = -40.0 * (motors @ q) - motors @ v
        speeds = slides @ v
        # breakaway falls to Coulomb friction over the default of 1 mm/s; signs change over 0.1 mm/s
        level = 30.0 + 15.0 * np.exp(-((speeds / 1e-3) ** 2))
        rubbed = level * np.tanh(speeds / 1e-4) + 200.0 * speeds
        force = motors.T @ (kp * off + held) - slides.T @ rubbed
        force = force + system.inputs["tcp", "x"] * (150.0 if time >= 1e-3 else 0.0)
        if time < 3e-3:
            force = force + system.inputs["tcp", "z"] * 300.0 * np.sin(np.pi * time / 3e-3)
        pulled = lighter @ (force - damping @ v - system.stiffness @ q)
        return np.concatenate([v, pulled, kp / 0.02 * off])

    rows = np.array([system.outputs["tcp", dof] for dof in ("x", "z")])
    state, kick = np.zeros((2, 2 * size + len(names)))
    kick[size : 2 * size] = lighter @ system.inputs["tcp", "x"] * 0.4
    breaks, kicks = (0.0, 1e-3, 3e-3, 7.03e-3, float(times[-1])), {7.03e-3: kick}
    solved = integrate_pieces(rate, breaks, state, times, method="LSODA", atol=1e-13, kicks=kicks)
    found = solved[:, :size] @ rows.T
    scale = np.abs(found).max()
    np.testing.assert_allclose(answer.curves.displacements, found, atol=1e-6 * scale)
    energy = present(answer.energy)
    assert energy.work > energy.final and energy.error < 1e-6
    loose, _ = rubbing_scene(machine, "effects.friction=false")
    free = _respond_in_time(posed_model(loose, tmp_path, pose), with_errors=False).answer
    assert np.abs(free.curves.displacements - found).max() > 0.05 * scale


def test_peaks_with_friction_have_an_error(tmp_path: Path) -> None:
    scene, pose = rubbing_scene("slide")
    own = _respond_in_time(posed_model(scene, tmp_path, pose)).answer
    sharp, _ = rubbing_scene("slide", 'drives.X.friction.smoothing="0.02 mm/min"')
    exact = _respond_in_time(posed_model(sharp, tmp_path, pose), with_errors=False).answer
    share = present(next(iter(own.errors.values())).shares[SMOOTHING])
    off = abs(abs(own.figures[0].peak) - abs(exact.figures[0].peak))
    assert off < share < 1.5 * off


KNOCK = (
    'duration = "8 ms", up_to = "50 kHz", sampling = "100 kHz", loads = { bump = { at = ["tcp", "x"], '
    'shape = "half_sine", size = "1 N", time = "2 ms" } }'
)


@pytest.mark.parametrize(
    "machine",
    [
        "segmented",
        "mechanism",
        pytest.param("elastic", marks=[pytest.mark.fem, pytest.mark.slow]),
    ],
)
def test_a_knocked_machine_moves_as_direct_integration_says(machine: str, tmp_path: Path) -> None:
    knock = f"analyses={{ transient={{ {KNOCK} }} }}"
    damped = "effects={ damping={ modal=0.02 } }"
    if machine == "segmented":
        scene = load_scene(COLUMN, overrides=[knock, damped])
    elif machine == "mechanism":
        low = knock.replace("8 ms", "30 ms").replace('"50 kHz", sampling = "100 kHz"', '"1 kHz"')
        scene = load_scene(ROOT / "machines" / "tripteor.toml", overrides=[low, damped])
    else:
        meshed = (
            'fidelity = "elastic"\nmesh = { size = "50 mm", cells = "hex" }\nreduction.modes = 3'
        )
        path = tmp_path / "scene.toml"
        path.write_text(ROD.replace('fidelity = "polynomial"', meshed))
        scene = load_scene(path, overrides=[knock])
    model = posed_model(scene, tmp_path, next(iter(scene.poses)))
    answer = _respond_in_time(model, with_errors=machine == "mechanism").answer
    times = answer.curves.times[::20]
    expected = model.system.outputs["tcp", "x"] @ integrate(
        model, model.system.inputs["tcp", "x"], times
    )
    found = answer.curves.displacements[::20, answer.curves.outputs.index(("tcp", "x"))]
    assert np.abs(expected).max() > 0.0
    assert np.allclose(found, expected, rtol=0.0, atol=1e-6 * np.abs(expected).max())
    if machine == "mechanism":
        assert all(error.shares[TRUNCATION] is not None for error in answer.errors.values())


def test_a_released_load_starts_at_its_static_displacement_and_swings_back(tmp_path: Path) -> None:
    scene = column_scene(
        tmp_path,
        'duration = "50 ms"\noutputs = [["tcp", "x"]]\n'
        '[analyses.transient.loads]\npull = { load = "push", shape = "release", start = "5 ms" }',
        '[loads.push]\nat = "column.tip"\nforce = ["1 kN", "0 N", "0 N"]\n[analyses.static]\n'
        '[effects]\ndamping = { modal = "5 %" }',
    )
    results = run(scene, tmp_path)
    (figures,) = answer_of(results).figures
    static = results.compliance["tcp"][0, 0] * 1e3
    assert figures.start == approx(static, rel=1e-9)
    moved = answer_of(results).curves
    before = moved.times < 0.005 - 1e-9
    assert before.any()
    assert np.allclose(moved.displacements[before, 0], static, rtol=1e-9, atol=0.0)
    assert figures.final == 0.0
    # of a single mode exp(-pi zeta / sqrt(1 - zeta^2)) = 0.854; higher modes are a few per cent
    assert present(figures.overshoot) == approx(0.854, abs=0.05)


def test_a_moving_body_that_is_caught_keeps_its_momentum(tmp_path: Path) -> None:
    # rigid on springs: x = v / omega sin(omega t)
    rigid = COLUMN.read_text().replace('fidelity = "segmented"', 'fidelity = "rigid"')
    rigid = rigid.replace(
        'kind = "rigid"',
        'kind = "spring"\nstiffness = { x = "10 N/um", y = "rigid", z = "rigid", rx = "rigid", ry = "rigid", rz = "rigid" }',
    )
    scene = write_scene(
        tmp_path,
        rigid,
        '[analyses.transient]\nduration = "20 ms"\noutputs = [["tcp", "x"]]\n'
        'velocity = { column = ["0.1 m/s", "0.2 m/s", "0 m/s"] }',
    )
    answer = answer_of(run(scene, tmp_path))
    mass = 7850.0 * 0.038 * 0.1 * 0.5
    omega = np.sqrt(1e7 / mass)
    exact = 0.1 / omega * np.sin(omega * answer.curves.times)
    assert np.allclose(answer.curves.displacements[:, 0], exact, rtol=0.0, atol=1e-9 * 0.1 / omega)
    assert present(answer.energy).initial == approx(0.5 * mass * 0.1**2, rel=1e-9)


def test_records_are_read_and_averaged_around_samples(tmp_path: Path) -> None:
    times = np.arange(0.0, 0.0301, 1.0 / 7777.0)
    rows = [f"{time:.9f},{np.sin(300.0 * time):.9f}" for time in times]
    (tmp_path / "hit.csv").write_text("time,value\n" + "\n".join(rows))
    transient = (
        'duration = "30 ms"\noutputs = [["tcp", "x"]]\n'
        '[analyses.transient.loads]\nhit = {{ at = ["tcp", "x"], {} }}'
    )
    effects = '[effects]\ndamping = { modal = "5 %" }'
    peaks = []
    for load in (
        'shape = "file", file = "hit.csv", size = "20 N"',
        f'shape = "sine", size = "20 N", frequency = "{300.0 / (2.0 * np.pi):.12f} Hz"',
    ):
        answer = answer_of(run(column_scene(tmp_path, transient.format(load), effects), tmp_path))
        peaks.append(answer.figures[0].peak)
    assert peaks[0] == approx(peaks[1], rel=1e-3)


@cases
def test_bad_loads_are_refused_with_their_line(load: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=said) as caught:
        column_scene(tmp_path, f'duration = "10 ms"\n[analyses.transient.loads]\n{load}')
    assert all(problem.line for problem in caught.value.problems)


def test_motors_under_control_need_the_effect(tmp_path: Path) -> None:
    load = 'loads.push = { at = ["tcp", "x"], shape = "step", size = "1 N" }'
    text = f'[analyses.transient]\nmotors = "controlled"\nduration = "10 ms"\n{load}'
    with pytest.raises(SceneError, match=r"write \[effects\] drive_control = true"):
        write_scene(tmp_path, SLIDE.read_text(), text)


def test_a_release_of_what_nothing_holds_is_a_failure(tmp_path: Path) -> None:
    free = COLUMN.read_text().replace(
        '[joints.clamp]\nbetween = ["ground", "column.foot"]\nkind = "rigid"', "free = true"
    )
    assert "joints" not in free
    scene = write_scene(
        tmp_path,
        "free = true\n" + free.replace("free = true\n", ""),
        '[analyses.transient]\nduration = "10 ms"\n'
        'loads.pull = { at = ["tcp", "x"], shape = "release", size = "1 N" }',
    )
    results = run(scene, tmp_path)
    assert "nothing holds" in results.failures[0]


def test_results_are_written_read_and_shown(tmp_path: Path) -> None:
    scene = column_scene(
        tmp_path,
        'duration = "20 ms"\n[analyses.transient.loads]\n'
        'press = { at = ["tcp", "x"], shape = "step", size = "100 N", start = "1 ms" }',
        '[effects]\ndamping = { modal = "2 %" }',
    )
    results = run(scene, tmp_path)
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert list(list_strangers(summary)) == []
    found = summary["transient"]["reference"]["outputs"]["tcp x"]
    assert found["peak"] == approx(1e6 * answer_of(results).figures[0].peak, rel=1e-12)
    assert summary["transient"]["reference"]["outputs"]["tcp y"]["settling_s"] is None
    opened = open_results(tmp_path / "out")
    curves = answer_of(opened).curves
    assert np.array_equal(curves.displacements, answer_of(results).curves.displacements)
    table = _tabulate_transient(curves)
    assert table.headings[:3] == ("time [s]", "press [N]", "tcp x [um]")
    assert len(table.rows) == 401 and table.rows[-1][1] == 100.0
    page = render_report(opened)
    assert "Motion over time" in page and "Load press [N]" in page
    damped = load_scene(scene.path, overrides=["effects={ damping = { modal = 0.1 } }"])
    other = run(damped, tmp_path)
    found = compare_kinds(results.numbers.values(), other.numbers.values())
    changes = {change.label: change for change in found}
    assert 0.02 < changes["peaks over time"].share < 0.2
