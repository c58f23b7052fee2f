"""Displacement and stress at probes under loads over time: a bar against its modal sum, the frequency
response of the same scene, statics, and what files hold.
"""

import json
from pathlib import Path

import h5py
import numpy as np
import pytest

import scene_runs
from common import approx, present
from fixture_machines import machine, stored_scene, write_scene
from headstock.app.report.report import render_report
from headstock.app.views.registry import list_tables
from headstock.app.views.transient import _tabulate_transient
from headstock.geometry.frames import FloatArray
from headstock.pipeline.answers.answer import find_answers
from headstock.pipeline.answers.motion_forces import ProbeMotion
from headstock.pipeline.answers.path import PathResult
from headstock.pipeline.answers.probes import ProbeAnswer
from headstock.pipeline.answers.transient import TransientAnswer
from headstock.pipeline.results.files import open_results
from headstock.pipeline.results.results import Results
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.findings import SceneError
from scene_runs import compute

pytestmark = [pytest.mark.fem, pytest.mark.process]

LENGTH, WIDTH, MODULUS, DENSITY = 0.2, 0.02, 210e9, 7850.0
BAR = machine("""
machine = "probed_bar"
components.bar.reduction = { modes = 60 }
probes.foot = { component = "bar", at = ["-80 mm", "0 mm", "10 mm"] }
""")
PULSE = (
    'analyses={ transient={ duration="1.2 ms", up_to="60 kHz", sampling="500 kHz", outputs=[["tip", "x"], "inside", "foot"],'
    ' loads={ pull={ LOAD, shape="half_sine", time="0.9 ms" } } } }'
)
AT_TIP = 'at=["tip", "x"], size="400 N"'  # 1 MPa on 400 mm^2
OVER_FACE = 'load="pull"'


def answer_of(results: Results) -> TransientAnswer:
    (answer,) = find_answers(results.answers, TransientAnswer)
    return answer


def modal_sum(place: float, times: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Displacement and stress of a clamped bar under half a sine of 1 MPa in 0.9 ms at its end, without
    damping; the static response of all modes in closed form, so that the sum converges fast.

    Source: Meirovitch (2001), Fundamentals of Vibrations, section 8.10.
    """
    driven, last = np.pi / 9e-4, 9e-4
    speed = np.sqrt(MODULUS / DENSITY)
    moved: FloatArray = np.zeros(len(times))
    strain: FloatArray = np.zeros(len(times))
    for number in range(1, 200):
        wave = (2 * number - 1) * np.pi / (2.0 * LENGTH)
        omega = wave * speed
        push = 2e6 / (DENSITY * LENGTH) * np.sin(wave * LENGTH)

        def swing(now: FloatArray, omega: float = omega) -> FloatArray:
            ring = np.sin(driven * now) - driven / omega * np.sin(omega * now)
            return np.asarray(ring / (omega**2 - driven**2), dtype=float)

        # after the pulse a second half sine goes on from its end, and takes the first one off
        after = np.where(times > last, swing(times - last), 0.0)
        # beyond the static share 1 / omega^2, which the closed form has
        force = np.where(times <= last, np.sin(driven * times), 0.0)
        own = push * (swing(times) + after - force / omega**2)
        moved += own * np.sin(wave * place)
        strain += own * wave * np.cos(wave * place)
    static = np.where(times <= last, 1e6 * np.sin(driven * times), 0.0)
    return np.asarray(moved + static * place / MODULUS), np.asarray(MODULUS * strain + static)


@pytest.mark.parametrize("load", [AT_TIP, OVER_FACE])
def test_stress_in_a_bar_follows_its_modal_sum_within_its_error(load: str, tmp_path: Path) -> None:
    answer = answer_of(compute(tmp_path, BAR, PULSE.replace("LOAD", load)))
    assert answer.probes.keys() == {"inside", "foot"}
    for name, place in (("inside", 0.063), ("foot", 0.02)):
        found = answer.probes[name]
        moved, stress = modal_sum(place, answer.curves.times)
        size = np.abs(stress).max()
        # the kinks of the pulse also set off what is beyond the modes of the bar
        np.testing.assert_allclose(found.trace.stress[:, 0], stress, atol=5e-3 * size)
        np.testing.assert_allclose(
            found.trace.displacement[:, 0], moved, atol=5e-3 * np.abs(moved).max()
        )
        exact = np.abs(stress).max()
        error = present(found.von_mises_error.total)
        assert abs(found.von_mises.value - exact) < error < 5e-3 * exact
        assert found.von_mises.time == approx(
            answer.curves.times[np.argmax(np.abs(stress))], abs=4e-6
        )


def of_files(folder: Path) -> tuple[ProbeMotion, dict[str, object]]:
    answer = answer_of(compute(folder, BAR, PULSE.replace("LOAD", AT_TIP)))
    return answer.probes["foot"], json.loads((folder / "out" / "summary.json").read_text())


def test_probes_are_tabled_written_and_drawn(tmp_path: Path) -> None:
    found, _ = of_files(tmp_path)
    results = open_results(tmp_path / "out")
    curves = answer_of(results).curves
    assert {probe.name for probe in curves.probes} == {"inside", "foot"}
    with h5py.File(tmp_path / "out" / "results.h5") as file:
        stress = file["transient/reference/probes/foot/stress"][:]
    assert np.array_equal(stress, found.trace.stress)
    tables = {table.name: table for table in list_tables(results)}
    assert tables["probes_over_time_reference"].rows[0][0] in ("inside", "foot")
    headings = _tabulate_transient(curves).headings
    assert "von Mises foot [MPa]" in headings and "stress xy inside [MPa]" in headings
    page = render_report(results)
    assert "Equivalent stress at probes [MPa]" in page


def test_a_probe_has_no_direction(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match='write "foot" alone'):
        compute(tmp_path, BAR, PULSE.replace("LOAD", AT_TIP).replace('"foot"]', '["foot", "x"]]'))


SLIDE = stored_scene("probe_motions_slide")


@pytest.mark.parametrize(
    ("control", "modes"),
    [
        ("", 12),
        pytest.param("", 0, marks=pytest.mark.trials),
        pytest.param("drive_control = true\n", 0, marks=pytest.mark.trials),
        pytest.param("drive_control = true\n", 12, marks=pytest.mark.trials),
        ("drive_control = true\nfriction = true\n", 0),
        pytest.param("drive_control = true\nfriction = true\n", 12, marks=pytest.mark.trials),
    ],
)
def test_a_bar_that_is_pushed_along_a_path_carries_its_inertia(
    control: str, modes: int, tmp_path: Path
) -> None:
    """Stress ``-rho a (L - x)`` where the acceleration has lasted; with modes and without, which then
    follow the acceleration.
    """
    path = tmp_path / "scene.toml"
    text = SLIDE.replace('"MODES"', str(modes)) + control
    if "friction" in control:
        text = text.replace("feed_forward", 'friction = { coulomb = "5 N" }\nfeed_forward')
    path.write_text(text)
    results = scene_runs.run(load_scene(path), tmp_path)
    (found,) = find_answers(results.answers, PathResult)
    (own,) = found.runs
    trace, times = own.probes["inside"].trace, own.curves.deviation.times
    late = int(np.searchsorted(times, 0.28))  # of a ramp of 300 ms
    acceleration, place = 0.1 / 0.3, 0.063
    stress = -DENSITY * acceleration * (LENGTH - place)
    assert own.curves.accelerations[late] == approx(acceleration)
    assert trace.stress[late, 0] == approx(stress, rel=5e-3)
    # beside what the screw and the controller leave, the bar shortens between foot and probe
    foot = own.curves.deviation.total[late, 0]
    shorter = DENSITY * acceleration / MODULUS * (0.5 * LENGTH**2 - LENGTH * place + 0.5 * place**2)
    assert trace.displacement[late, 0] - foot == approx(shorter, abs=2e-3 * abs(foot))
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    peak = summary["path"]["feeds"][0]["probes"]["inside"]
    assert peak["peak_von_mises_mpa"] == approx(1e-6 * np.abs(trace.stress[:, 0]).max(), rel=1e-2)
    # hexahedra have this stress exactly
    assert 0.0 < peak["peak_von_mises_error_mpa"] < 1e-2 * peak["peak_von_mises_mpa"]


@pytest.mark.parametrize(
    "control", [pytest.param("", marks=pytest.mark.trials), "drive_control = true\n"]
)
def test_the_error_at_a_probe_along_a_path_covers_what_a_fine_mesh_changes(
    control: str, tmp_path: Path
) -> None:
    """A bar that is pushed across bends near its foot; tetrahedra as thick as the bar, and cells of a
    fifth of that.
    """
    text = SLIDE.replace('"MODES"', "4") + control
    for old, new in (
        ('"-37 mm", "3 mm", "5 mm"', '"-70 mm", "4 mm", "8 mm"'),
        ('foot = { face = "x-", coupling = "average" }', 'foot = { face = "x-" }'),
        ('x = "0 N/um", y = "rigid"', 'x = "rigid", y = "0 N/um"'),
        ('axis = "x"\n', 'axis = "y"\n'),
        ("[axes.X]\n", '[axes.X]\ndirection = "y"\n'),
        ('"300 ms"', '"30 ms"'),
    ):
        assert old in text
        text = text.replace(old, new)
    judged = []
    for mesh in ('size = "20 mm", cells = "tet"', 'size = "4 mm", cells = "hex"'):
        path = write_scene(tmp_path, text.replace('size = "10 mm", cells = "hex"', mesh))
        results = scene_runs.run(load_scene(path), tmp_path)
        (found,) = find_answers(results.answers, PathResult)
        judged.append({number.key.kind: number for number in found.list_numbers()})
    coarse, fine = judged
    assert coarse.keys() == fine.keys()
    for kind in ("peak_stress", "peak_displacement"):
        missed = abs(coarse[kind].value - fine[kind].value)
        error = present(present(coarse[kind].error).total)
        assert missed > 1e-3 * fine[kind].value
        assert missed < error < 4.0 * missed


def test_a_probe_in_a_bed_sees_on_a_slow_path_what_an_uneven_rail_does(tmp_path: Path) -> None:
    """Beside statics of the pose at its end: one carriage of four climbs by 5 um."""
    path = Path(__file__).parents[3] / "machines" / "guideway.toml"
    scene = load_scene(
        path,
        overrides=[
            "components.bed.reduction.modes_to='2 kHz'",
            "joints.carriage_1.errors={ ball_passing = { period = '10 mm', normal = '5 um' } }",
            "effects={ guide_errors = true, damping = { modal = 0.05 } }",
            "probes.spot={ component = 'bed', at = ['60 mm', '60 mm', '80 mm'] }",
            "poses.end={ X = '2.5 mm' }",
            "analyses={ static = { at = 'tcp', poses = ['end'] }, path = { from = { X = '0 mm' }, to = { X = '2.5 mm' }, "
            "estimate = false, pose_model = 'frozen', feeds = ['60 mm/min'], time_constant = '500 ms', sampling = '50 Hz', "
            "outputs = [['tcp', 'z']] } }",
        ],
    )
    results = scene_runs.run(scene, tmp_path)
    (rest,) = find_answers(results.answers, ProbeAnswer)
    (answer,) = find_answers(results.answers, PathResult)
    seen, still = answer.runs[0].probes["spot"].trace, rest.probes["spot"]
    size = np.linalg.norm(still.displacement)
    assert size > 1e-7
    assert seen.displacement[-1] == approx(still.displacement, abs=float(0.03 * size))
    largest = np.abs(still.stress).max()
    assert largest > 1e3
    assert seen.stress[-1] == approx(still.stress, abs=float(0.03 * largest))
