"""The settings of a search are found once: the next run of the same scene computes its last round."""

from pathlib import Path

import numpy as np
import pytest

import scene_runs
from fixture_machines import stored_scene
from headstock.pipeline.accuracy import search
from headstock.pipeline.numbers.estimates import MODEL
from headstock.pipeline.results.results import Results
from headstock.pipeline.results.summary import summarise
from headstock.scene.building.loader import load_scene
from scene_runs import compute

pytestmark = [pytest.mark.fem, pytest.mark.process]

# a tube that is held at its lower end by springs
SCENE = stored_scene("remembered")


def run(folder: Path, asked: str, *overrides: str) -> Results:
    return compute(folder, SCENE.replace("ASKED", asked), *overrides, name="pole")


def stages(results: Results) -> list[str]:
    return [record.stage.kind for record in results.stages]


def test_a_slender_tube_becomes_segments_without_a_mesh_and_is_right(tmp_path: Path) -> None:
    results = run(tmp_path, "1 %")
    assert results.components["pole"].fidelity == "segmented"
    assert "mesh" not in stages(results) and "expand" in stages(results)
    plain = SCENE.replace('accuracy = "ASKED"', "") + '[components.pole.mesh]\nsize = "15 mm"\n'
    (tmp_path / "fine.toml").write_text(plain)
    scene = load_scene(tmp_path / "fine.toml")
    fine = scene_runs.run(scene, tmp_path, "f")
    shares = results.modal[0].frequencies_hz / fine.modal[0].frequencies_hz - 1.0
    assert np.abs(shares).max() < 0.01
    for error, hz, share in zip(
        results.modal[0].list_errors(), results.modal[0].frequencies_hz, shares, strict=True
    ):
        assert error.total is not None and abs(share) * hz <= error.total + 0.002 * hz


def test_the_second_run_computes_the_last_round_alone_and_says_so(tmp_path: Path) -> None:
    first, second = run(tmp_path, "1 %"), run(tmp_path, "1 %")
    assert stages(first).count("modal") == 2 and stages(second).count("modal") == 1
    assert "expand" not in stages(second)
    told = [record for record in second.stages if record.stage.kind == "refine"]
    assert len(told) == 1 and "earlier run" in told[0].stage.reason
    for name in ("modal", "static", "accuracy", "model_errors"):
        assert summarise(first)[name] == summarise(second)[name]


def test_the_second_run_repeats_what_a_comparison_found_without_comparing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = run(tmp_path, "1 %")

    def refuse(*args: object) -> None:
        raise AssertionError("compared again")

    monkeypatch.setattr(search, "compare_models", refuse)
    second = run(tmp_path, "1 %")
    for found, again in zip(first.modal, second.modal, strict=True):
        assert np.array_equal(found.frequencies_hz, again.frequencies_hz)
        assert found.errors == again.errors
        assert all(MODEL in error.shares for error in again.list_errors())
    assert [warning for warning in first.warnings if warning not in second.warnings] == []
    (told,) = [record for record in second.stages if record.stage.kind == "models"]
    assert "elastic bodies in place of pole" in told.detail


def test_another_scene_is_searched_again(tmp_path: Path) -> None:
    run(tmp_path, "1 %")
    other = run(tmp_path, "1 %", 'components.pole.solid.tube.inner="50 mm"')
    assert stages(other).count("modal") == 2
    finer = run(tmp_path, "0.3 %")
    assert finer.components["pole"].fidelity == "polynomial"
