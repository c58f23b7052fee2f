"""STEP parts whose meshes follow the errors of their cells until an accuracy is met."""

import shutil
from pathlib import Path

import gmsh
import numpy as np
import pytest

import scene_runs
from built_parts import built_part
from common import approx
from fixture_machines import stored_scene
from headstock.geometry.frames import FloatArray
from headstock.pipeline.answers.accuracy import AccuracyAnswer
from headstock.pipeline.answers.answer import find_answers
from headstock.pipeline.results.results import Results
from headstock.pipeline.results.summary import summarise
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.files import TomlTable
from headstock.scene.reading.findings import SceneError

pytestmark = [pytest.mark.fem, pytest.mark.process]

SCENE = stored_scene("adaptive_meshes")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """With the scene, and its part: an angle with a sharp inner edge."""
    folder = tmp_path_factory.mktemp("angle")
    occ = gmsh.model.occ
    with built_part(folder / "angle.step"):
        legs = [occ.addBox(*box) for box in ((0, 0, 0, 120, 60, 30), (0, 0, 30, 30, 60, 90))]
        occ.fuse([(3, legs[0])], [(3, legs[1])])
    (folder / "scene.toml").write_text(SCENE)
    return folder


def run(folder: Path, name: str, *overrides: str, values: TomlTable | None = None) -> Results:
    scene = load_scene(folder / "scene.toml", overrides=overrides, values=values)
    return scene_runs.run(scene, folder, name)


def numbers(results: Results) -> FloatArray:
    soft = np.diag(results.static["reference"]["tip"].compliance)[:3]
    return np.asarray(np.r_[results.modal[0].frequencies_hz, soft])


@pytest.fixture(scope="module")
def searched(folder: Path) -> Results:
    return run(folder, "searched", 'accuracy="1 %"')


@pytest.fixture(scope="module")
def extrapolated(folder: Path) -> FloatArray:
    """From even meshes, whose errors at the held rim and the inner edge fall with a power of 1.09 of
    their size (Williams 1952, J. Appl. Mech. 19, 526-528).
    """
    coarse, fine = (
        numbers(run(folder, f"even_{size}", f'components.part.mesh.size="{size} mm"'))
        for size in (9, 6)
    )
    return np.asarray(fine + (fine - coarse) / (1.5**1.09 - 1.0))


def test_the_accuracy_is_met_with_small_cells_where_the_error_is(
    folder: Path, searched: Results, extrapolated: FloatArray
) -> None:
    (answer,) = find_answers(searched.answers, AccuracyAnswer)
    assert answer.met and len(answer.rounds) > 1
    assert numbers(searched) == approx(extrapolated, rel=0.005)
    chosen = load_scene(folder / "scene.toml").machine.components["part"]
    assert chosen.mesh.sizes is None
    text = (folder / "searched" / "sizes" / "part.pos").read_text()
    sizes = np.array(
        [line.partition("{")[2].rstrip("};").split(",") for line in text.splitlines()[1:-1]]
    )
    assert sizes.astype(float).min() < 0.4 * sizes.astype(float).max()


def test_what_was_chosen_is_replayed_from_the_summary(folder: Path, searched: Results) -> None:
    shutil.copy(folder / "searched" / "sizes" / "part.pos", folder)
    values = summarise(searched)["accuracy"]["values"]
    again = run(folder, "replayed", values=values)
    assert numbers(again) == approx(numbers(searched), rel=1e-9)
    assert not find_answers(again.answers, AccuracyAnswer)


def test_the_second_run_makes_no_mesh(folder: Path, searched: Results) -> None:
    again = run(folder, "again", 'accuracy="1 %"')
    assert np.array_equal(numbers(again), numbers(searched))
    (mesh,) = [record for record in again.stages if record.stage.kind == "mesh"]
    assert mesh.cached


def test_sizes_stand_alone(folder: Path, searched: Results) -> None:
    shutil.copy(folder / "searched" / "sizes" / "part.pos", folder)
    given = 'components.part.mesh={sizes="part.pos",size="5 mm"}'
    with pytest.raises(SceneError, match="remove size, or sizes"):
        load_scene(folder / "scene.toml", overrides=[given])
    with pytest.raises(SceneError, match="not exist"):
        load_scene(folder / "scene.toml", overrides=['components.part.mesh.sizes="no.pos"'])
