"""Lobes of machines: any machine that has matrices in a pose, checked limits, spindle and tool on it,
and what a bad table is told.
"""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from summary_shapes import list_strangers

from cases import cases
from common import approx, present
from headstock.app.report.report import render_report
from headstock.pipeline.answers.answer import find_answers
from headstock.pipeline.answers.lobes import DirectionLobes, PoseLobes
from headstock.pipeline.results.summary import summarise
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.findings import SceneError
from scene_runs import run

DATA = Path(__file__).parents[2] / "data"
LOBES = """
[effects]
damping = { modal = "3 %" }
[analyses.lobes]
speeds = ["3000 rpm", "12000 rpm", 60]
mill = { diameter = "16 mm", teeth = 4 }
material = "al7075-t6"
radial_depth = "16 mm"
poses = ["left"]
"""
MODES = """tool_modes = [
    { name = "spindle", frequency = "700 Hz", damping = "4 %", stiffness = "40 N/um" },
    { name = "tool", frequency = "1500 Hz", damping = "2 %", stiffness = "12 N/um" },
]
"""


def write_scene(folder: Path, more: str = "", *changes: tuple[str, str]) -> Path:
    text = (DATA / "slide.toml").read_text() + LOBES + more
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / "scene.toml"
    path.write_text(text)
    return path


def lobes_of(path: Path, tmp_path: Path) -> PoseLobes:
    scene = load_scene(path)
    scene = dataclasses.replace(scene, analyses=scene.analyses.keep(["lobes"]))
    results = run(scene, tmp_path)
    assert results.failures == ()
    (found,) = find_answers(results.answers, PoseLobes)
    return found


def along_x(found: PoseLobes) -> DirectionLobes:
    return next(own for own in found.directions if own.direction == (1.0, 0.0, 0.0))


def test_every_lobe_has_a_mode_a_part_and_a_limit_by_multipliers(tmp_path: Path) -> None:
    """In a full slot with four teeth a single frequency is exact."""
    found = lobes_of(write_scene(tmp_path), tmp_path)
    assert len(found.directions) == 2
    for own in found.directions:
        assert own.limited.all()
        np.testing.assert_allclose(own.depths, own.zeroth, rtol=0.02)
        lowest = present(own.lowest)
        assert own.depths[lowest.place] == own.depths.min() < found.deepest
        assert lowest.mode and lowest.part and lowest.mode_hz is not None
        # chatter is a little above the mode it comes from
        chatter = own.chatter[lowest.place] / (2.0 * np.pi)
        assert lowest.mode_hz < chatter < 1.2 * lowest.mode_hz
        assert 0.5 < lowest.mode_share < 1.5
        for place in own.best:
            assert own.depths[place] > 1.2 * own.depths.min()


def test_a_speed_has_no_limit_where_the_deepest_cut_is_stable(tmp_path: Path) -> None:
    plain = along_x(lobes_of(write_scene(tmp_path), tmp_path))
    between = 1e3 * float(np.sqrt(plain.depths.min() * plain.depths.max()))
    found = along_x(lobes_of(write_scene(tmp_path, f'deepest = "{between} mm"\n'), tmp_path))
    deeper = plain.depths > 1.001e-3 * between
    assert 0 < deeper.sum() < 60
    np.testing.assert_array_equal(~found.limited, deeper)
    np.testing.assert_allclose(found.depths[deeper], 1e-3 * between)
    np.testing.assert_allclose(found.depths[~deeper], plain.depths[~deeper], rtol=1e-3)
    assert np.isnan(found.chatter[deeper]).all()


def test_a_share_of_the_speeds_is_looked_at_and_the_others_are_unknown(tmp_path: Path) -> None:
    plain = along_x(lobes_of(write_scene(tmp_path), tmp_path))
    found = along_x(lobes_of(write_scene(tmp_path, "checked = 0.2\n"), tmp_path))
    known = np.isfinite(found.depths)
    assert known.sum() == 12 and known[[0, -1]].all()
    np.testing.assert_allclose(found.depths[known], plain.depths[known], rtol=1e-3)
    assert set(found.best) <= set(np.flatnonzero(known))


def test_report_and_tables_show_the_lobes(tmp_path: Path) -> None:
    scene = load_scene(write_scene(tmp_path))
    scene = dataclasses.replace(scene, analyses=scene.analyses.keep(["lobes"]))
    results = run(scene, tmp_path)
    summary = summarise(results)
    assert list(list_strangers(summary)) == []
    (direction, _) = summary["lobes"]["left"]["directions"]
    assert len(direction["series"]["limit_depth_mm"]) == 60
    page = render_report(results)
    assert "Stability lobes" in page
    assert present(direction["lowest"])["mode"] in page
    assert "mean little without modes of spindle and tool" in page


def test_stiff_modes_of_spindle_and_tool_change_nothing_and_soft_ones_do(tmp_path: Path) -> None:
    few = ('rpm", 60]', 'rpm", 20]')
    plain = along_x(lobes_of(write_scene(tmp_path, "", few), tmp_path))
    stiff = MODES
    for old, new in (("700", "1e5"), ("1500", "1e5"), ("40 N", "4e3 N"), ("12 N", "4e3 N")):
        stiff = stiff.replace(old, new)
    same = along_x(lobes_of(write_scene(tmp_path, stiff, few), tmp_path))
    assert same.depths.min() == approx(plain.depths.min(), rel=5e-3)
    found = along_x(lobes_of(write_scene(tmp_path, MODES, few), tmp_path))
    assert {lobe.part for lobe in found.lobes} & {"spindle", "tool"}


def test_a_measured_receptance_takes_the_place_of_modes(tmp_path: Path) -> None:
    """The free receptances of two masses on a spring give the lobes of the second mass on its
    spring, where the first one weighs next to nothing.
    """
    lines = np.linspace(5.0, 4000.0, 8000)
    omega, stiffness, light = 2.0 * np.pi * lines, 12e6, 1e-6
    mass = stiffness / (2.0 * np.pi * 1500.0) ** 2
    spring = stiffness * (1.0 + 2j * 0.02 * omega / (2.0 * np.pi * 1500.0))
    first, second = spring - omega**2 * light, spring - omega**2 * mass
    both = first * second - spring**2
    values = [first / both, spring / both, second / both]
    rows = np.column_stack(
        [lines, *(part for value in values for part in (value.real, value.imag))]
    )
    head = "frequency,tip_re,tip_im,cross_re,cross_im,base_re,base_im"
    np.savetxt(tmp_path / "tool.csv", rows, delimiter=",", header=head, comments="", fmt="%.17g")
    measured = lobes_of(write_scene(tmp_path, 'tool_receptance = "tool.csv"\n'), tmp_path)
    only = MODES.replace(MODES.splitlines()[1] + "\n", "")
    modes = lobes_of(write_scene(tmp_path, only), tmp_path)
    np.testing.assert_allclose(along_x(measured).zeroth, along_x(modes).zeroth, rtol=2e-3)
    assert not measured.confirmed and "nothing confirms" in measured.method
    assert along_x(measured).best == ()


@cases
def test_a_bad_table_is_refused_with_what_to_write(
    tmp_path: Path, change: tuple[str, str], key: str, words: str
) -> None:
    with pytest.raises(SceneError) as caught:
        load_scene(write_scene(tmp_path, "", change))
    assert any(
        problem.key.startswith(key) and words in problem.message
        for problem in caught.value.problems
    ), str(caught.value)
