"""Displacement and stress at probes, from a scene."""

from pathlib import Path

import pytest

from common import approx
from fixture_machines import machine
from headstock.pipeline.results.files import read_summary
from headstock.pipeline.results.summary import RunSummary
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.findings import SceneError
from scene_runs import compute

pytestmark = [pytest.mark.fem, pytest.mark.process]

LENGTH, SIDE, PRESSURE, YOUNG = 0.4, 0.02, 0.1e6, 210e9
SCENE = machine("""
machine = "bar"
name = "Beam under pressure"
names = { bar = "beam" }
without = ["joints", "components.beam.interfaces"]
components.beam.solid = { box = ["20 mm", "20 mm", "400 mm"] }
components.beam.mesh = { size = "10 mm" }
components.beam.interfaces = { tip = { face = "z+", coupling = "average" } }
supports.clamp = { face = "beam.z-", fix = ["x", "y", "z"] }
loads.side = { face = "beam.x-", pressure = "0.1 MPa" }
probes.middle = { component = "beam", at = ["10 mm", "0 mm", "200 mm"] }
analyses.static = { at = "tcp" }
""")


def _run(tmp_path: Path, text: str) -> RunSummary:
    compute(tmp_path, text, name="beam")
    return read_summary(tmp_path / "out")


def test_bending_stress_and_tip_deflection_follow_beam_theory(tmp_path: Path) -> None:
    summary = _run(tmp_path, SCENE)
    line, inertia = PRESSURE * SIDE, SIDE**4 / 12.0
    bending = line * (LENGTH / 2) ** 2 / 2 * (SIDE / 2) / inertia
    probe = summary["probes"]["reference"]["middle"]
    assert probe["stress_mpa"]["zz"] == approx(-bending * 1e-6, rel=0.01)
    deflection = line * LENGTH**4 / (8 * YOUNG * inertia)
    assert summary["static"]["tcp"]["displacement"][0] == approx(deflection, rel=0.01)


def test_a_turned_component_shows_the_same_stress_in_turned_axes(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    straight = _run(tmp_path / "a", SCENE)["probes"]["reference"]["middle"]
    turned = SCENE.replace(
        "[components.beam]\n", '[components.beam]\nrotate = { axis = "y", angle = "90 deg" }\n'
    )
    lying = _run(tmp_path / "b", turned)["probes"]["reference"]["middle"]
    assert lying["stress_mpa"]["xx"] == approx(straight["stress_mpa"]["zz"], rel=1e-9)
    assert lying["displacement_um"][2] == approx(-straight["displacement_um"][0], rel=1e-9)


def test_a_second_run_recovers_the_same_stress_from_the_store(tmp_path: Path) -> None:
    first = _run(tmp_path, SCENE)
    second = _run(tmp_path, SCENE)
    assert second["probes"] == first["probes"]
    reductions = [stage for stage in second["stages"] if stage["stage"] == "reduce"]
    assert reductions and all(stage["cached"] for stage in reductions)


def test_a_probe_without_loads_is_refused_with_the_remedy(tmp_path: Path) -> None:
    scene = tmp_path / "beam.toml"
    text = SCENE.replace('[loads.side]\nface = "beam.x-"\npressure = "0.1 MPa"\n', "")
    scene.write_text(text)
    with pytest.raises(SceneError, match=r"\[loads\.NAME\].*gravity"):
        load_scene(scene)
