"""Bodies become rigid or segmented where the accuracy asked for allows it, whatever the scene says."""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import scene_runs
from fixture_machines import stored_scene, write_scene
from headstock.geometry.parts.components import Component
from headstock.pipeline.accuracy import models as models_of_bodies
from headstock.pipeline.accuracy.models import _add_change
from headstock.pipeline.answers.accuracy import AccuracyAnswer
from headstock.pipeline.answers.answer import find_answers
from headstock.pipeline.numbers.estimates import MODEL
from headstock.pipeline.results.results import Results
from headstock.pipeline.results.summary import summarise
from headstock.reduction.components.segmented import reduce_segmented
from headstock.reduction.superelement import Superelement
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.findings import SceneError
from scene_runs import compute

pytestmark = [pytest.mark.fem, pytest.mark.process]

# a slender mast on a heavy block on soft springs; written as a rigid one on an elastic block
SCENE = stored_scene("models")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("models")


def run(folder: Path, asked: str, *overrides: str) -> Results:
    return compute(folder, SCENE.replace("ASKED", asked), *overrides, name="mast")


@pytest.fixture(scope="module")
def truth(folder: Path) -> Results:
    path = write_scene(folder, SCENE.replace("ASKED", "5 %"), name="mast")
    scene = load_scene(path, overrides=["components.mast.fidelity=elastic"])
    parts = {
        name: dataclasses.replace(part, mesh=dataclasses.replace(part.mesh, size=size, cells="hex"))
        for (name, part), size in zip(scene.machine.components.items(), (0.05, 0.02), strict=True)
    }
    machine = dataclasses.replace(scene.machine, components=parts)
    fine = dataclasses.replace(scene, machine=machine, accuracy=None)
    return scene_runs.run(fine, folder, "fine")


def answer(results: Results) -> AccuracyAnswer:
    (found,) = find_answers(results.answers, AccuracyAnswer)
    return found


def test_a_rough_accuracy_takes_lumped_bodies_and_is_true(folder: Path) -> None:
    results = run(folder, "5 %")
    models = answer(results).models
    assert answer(results).met
    assert models["block"].model == "rigid" and models["mast"].model.endswith("segments")
    assert "finite" not in models["block"].following and "CPU s" in models["block"].following
    assert {name: facts.fidelity for name, facts in results.components.items()} == {
        "block": "rigid",
        "mast": "segmented",
    }
    assert all(MODEL in error.shares for error in results.modal[0].list_errors())
    entry = summarise(results)["accuracy"]["models"]["mast"]
    assert entry["model"] == models["mast"].model and entry["why"]


def test_a_short_column_stays_finite_elements(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    counts: list[int] = []

    def record(component: Component, *given: Any) -> Superelement:
        counts.append(component.segments.count)
        return reduce_segmented(component, *given)

    monkeypatch.setattr(models_of_bodies, "reduce_segmented", record)
    stubby = (
        'components.mast.solid.box=["200 mm", "160 mm", "300 mm"]',
        'components.mast.at=["0 mm", "0 mm", "250 mm"]',
    )
    stiff = {"x": "20 kN/um", "y": "20 kN/um", "z": "30 kN/um"}
    stiff |= dict.fromkeys(("rx", "ry", "rz"), "900 N m/urad")
    feet = [f"joints.feet.stiffness.{axis}={value}" for axis, value in stiff.items()]
    results = run(folder, "1 %", *stubby, *feet, "components.mast.interfaces.foot.coupling=rigid")
    models = answer(results).models
    assert answer(results).met
    assert results.components["mast"].fidelity == "elastic"
    assert "segments it changes" in models["mast"].why
    # fewer are not made where the most do not do
    assert counts.count(16) == 2 and counts.count(4) <= 1


def test_softer_models_lie_between_finite_elements_and_the_truth_stiffer_ones_do_not() -> None:
    rng = np.random.default_rng(3)
    for error, two_sided in rng.uniform(0.0, 0.02, (40, 2)):
        for change in rng.uniform(-0.04, 0.04, 20):
            # the truth is softer than finite elements by their error at most, curved faces aside
            truths = np.linspace(-two_sided, error + two_sided, 50)
            furthest = np.abs(change - truths).max()
            assert furthest <= _add_change(error + two_sided, two_sided, change) + 1e-12
    assert _add_change(0.02, 0.0, 0.015) == 0.02 and _add_change(0.02, 0.0, -0.015) == 0.035


CLAMPED = stored_scene("models_clamped")


def test_a_clamped_body_that_could_not_move_as_a_rigid_one_stays_elastic(tmp_path: Path) -> None:
    path = write_scene(tmp_path, CLAMPED, name="clamped")
    results = scene_runs.run(load_scene(path), tmp_path)
    assert answer(results).met and results.components["block"].fidelity == "elastic"
    assert answer(results).models["block"].why


@pytest.mark.parametrize("asked", ["5 %", "0.1 %"])
def test_the_true_error_is_within_what_was_asked(folder: Path, truth: Results, asked: str) -> None:
    results = run(folder, asked)
    share = float(asked.split()[0]) / 100.0
    found, exact = results.modal[0].frequencies_hz, truth.modal[0].frequencies_hz
    assert np.abs(found / exact - 1.0).max() <= share
    ours, right = (each.static["reference"]["tip"].compliance for each in (results, truth))
    assert np.abs(np.diag(ours)[:3] / np.diag(right)[:3] - 1.0).max() <= share


def test_without_models_bodies_stay_as_they_are_written(folder: Path) -> None:
    results = run(folder, "5 %", "accuracy.models=none")
    assert results.components["mast"].fidelity == "rigid"
    assert not answer(results).models


def test_a_wrong_value_is_refused(folder: Path) -> None:
    with pytest.raises(SceneError, match="models"):
        run(folder, "5 %", "accuracy.models=true")
