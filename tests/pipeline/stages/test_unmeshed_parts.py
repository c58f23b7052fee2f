"""A part from a STEP or mesh file that is not meshed is still drawn as what it is."""

import re
import shutil
from pathlib import Path

import numpy as np
import pytest

import scene_runs
from common import approx
from faults.file_fuzz import SIZE, write_meshes
from fixture_machines import stored_scene
from headstock.geometry.parts.skins import Skin
from headstock.geometry.parts.solids import StepFile
from headstock.meshing.components import meshing
from headstock.meshing.components.survey import survey_step
from headstock.meshing.errors import MeshError
from headstock.pipeline.results.results import Results
from headstock.pipeline.stages import components as component_stages
from headstock.scene.building.loader import load_scene

pytestmark = [pytest.mark.fem, pytest.mark.process]

SUPPORT = Path(__file__).resolve().parents[2] / "data" / "support.step"
SCENE = stored_scene("unmeshed_parts")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    shutil.copy(SUPPORT, tmp_path / "support.step")
    write_meshes(tmp_path)
    (tmp_path / "scene.toml").write_text(SCENE)
    return tmp_path


def run(folder: Path) -> Results:
    return scene_runs.run(load_scene(folder / "scene.toml"), folder)


def area(skin: Skin) -> float:
    a, b, c = (skin.points[skin.triangles[:, k]] for k in range(3))
    return float(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


def test_parts_from_files_are_drawn_and_weighed_from_files_read_once(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    results = run(folder)
    support, bar = results.view.skins["support"], results.view.skins["bar"]
    assert (support.source, bar.source) == ("solid", "solid")
    assert area(support) == approx(
        sum(face.area for face in survey_step(StepFile(SUPPORT)).faces), rel=0.01
    )
    assert area(bar) == approx(
        2 * (SIZE[0] * SIZE[1] + SIZE[1] * SIZE[2] + SIZE[2] * SIZE[0]), rel=1e-9
    )
    np.testing.assert_allclose(np.ptp(bar.points, axis=0), SIZE, rtol=1e-9)
    for module, name in ((component_stages, "unmeshed_skin"), (meshing, "describe_component")):
        monkeypatch.setattr(module, name, lambda solid: pytest.fail("read again"))
    again = run(folder)
    assert again.modal[0].frequencies_hz.tobytes() == results.modal[0].frequencies_hz.tobytes()
    np.testing.assert_array_equal(again.view.skins["support"].triangles, support.triangles)
    shifts = again.view.poses["reference"].shifts
    assert all(
        shifts[name].shape == (6, len(skin.points), 3) for name, skin in again.view.skins.items()
    )


def test_a_surface_that_cannot_be_drawn_costs_a_warning_and_no_result(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(solid: object) -> None:
        raise MeshError("no face could be triangulated")

    monkeypatch.setattr(component_stages, "unmeshed_skin", refuse)
    results = run(folder)
    assert results.view.skins["support"].source == "inertia"
    assert any(
        re.search("'support' is drawn as a block of equal inertia: no face", text)
        for text in results.warnings
    )
    assert len(results.modal[0].frequencies_hz) == 6
