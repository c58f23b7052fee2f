"""Peaks and static levels of responses are among the numbers that an accuracy steers, and are true."""

import json
from pathlib import Path

import numpy as np
import pytest
from summary_shapes import list_strangers

from common import approx, present
from fixture_machines import stored_scene, write_scene
from headstock.app.command_line import main
from headstock.app.texts.bounded_values import accuracy_words
from headstock.pipeline.answers.accuracy import AccuracyAnswer
from headstock.pipeline.answers.answer import find_answers
from headstock.pipeline.answers.frf import PoseResponse
from headstock.pipeline.numbers.estimates import MODEL, Estimate
from headstock.pipeline.numbers.numbers import Key, Number
from headstock.pipeline.results.results import Results
from headstock.pipeline.results.summary import summarise
from scene_runs import compute

pytestmark = [pytest.mark.fem, pytest.mark.process]

# a slender mast on a heavy block on soft springs
SCENE = stored_scene("peaks")
FINE = (
    'components.mast.mesh={ size = "19 mm", cells = "hex" }',
    'components.block.mesh={ size = "60 mm", cells = "tet", across_patches = 14, growth = 0.45 }',
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("peaks")


def run(folder: Path, *overrides: str) -> Results:
    return compute(folder, SCENE, *overrides, name="mast")


@pytest.fixture(scope="module")
def truth(folder: Path) -> dict[Key, Number]:
    return numbers(run(folder, *FINE))


def numbers(results: Results) -> dict[Key, Number]:
    (found,) = find_answers(results.answers, PoseResponse)
    return {number.key: number for number in found.list_heights()}


def answer(results: Results) -> AccuracyAnswer:
    (found,) = find_answers(results.answers, AccuracyAnswer)
    return found


def compare(found: dict[Key, Number], truth: dict[Key, Number]) -> float:
    """Largest relative error; both have the same numbers."""
    assert found.keys() == truth.keys() and {key.kind for key in found} == {"peak", "level"}
    return max(abs(own.value / truth[key].value - 1.0) for key, own in found.items())


def test_each_plus_minus_covers_the_true_error_and_is_not_far_above_it(
    folder: Path, truth: dict[Key, Number]
) -> None:
    found = numbers(run(folder))
    assert compare(found, truth) > 1e-3
    ratios = []
    for key, own in found.items():
        true = abs(own.value - truth[key].value)
        total = present(present(own.error).total)
        assert total >= true
        ratios += [total / true] if true > 1e-3 * own.value else []
    assert len(ratios) > 5 and np.median(ratios) < 4.0


@pytest.mark.trials
def test_an_accuracy_steers_peaks_and_says_so(folder: Path, truth: dict[Key, Number]) -> None:
    results = run(folder, 'accuracy={ to = "1 %", models = "none" }')
    own = answer(results)
    assert own.met and own.responses is not None and own.responses.met
    assert own.responses.error is not None and own.responses.error <= 0.01
    assert any(each.quantity.startswith("peak of tip") for each in own.rounds)
    assert compare(numbers(results), truth) <= 0.01
    summary = summarise(results)
    assert list(list_strangers(summary)) == []
    assert summary["accuracy"]["responses"]["met"]
    words = accuracy_words(own, results.frf.values())[0]
    assert "peaks and static levels of frequency responses met it: " in words
    peaks = summary["frf"]["reference"]["peaks"]
    assert [peak["kind"] for peak in peaks].count("level") == 3
    for peak in peaks:
        assert 0.0 < present(peak["error_um_per_kN"]) < peak["size_um_per_kN"]
    again = run(folder, 'accuracy={ to = "1 %", models = "none" }')
    assert answer(again).responses == own.responses
    assert numbers(again).keys() == numbers(results).keys()


def test_models_of_bodies_are_chosen_by_peaks_too_and_stand_behind_plus_minus(
    folder: Path, truth: dict[Key, Number]
) -> None:
    results = run(folder, 'accuracy={ to = "6 %" }')
    own = answer(results)
    assert own.met and own.models and own.responses is not None
    found = numbers(results)
    assert compare(found, truth) <= 0.06
    assert all(MODEL in present(number.error).shares for number in found.values())


def test_the_table_and_the_report_show_peaks_with_their_plus_minus(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HEADSTOCK_STORE", str(folder / "store"))
    path = write_scene(folder, SCENE, name="mast")
    output = folder / "shown"
    assert main(["run", str(path), "-o", str(output), "--no-figures"]) == 0
    told = capsys.readouterr().out
    assert "Peaks and static compliances of responses" in told and "peak tip x / tip x" in told
    assert "Peaks within 10 dB" in (output / "report.html").read_text()
    summary = json.loads((output / "summary.json").read_text())
    (response,) = summary["frf"].values()
    first = next(own for own in response["peaks"] if own["output"] == own["input"] == ["tip", "x"])
    (drive,) = [own for own in response["drive_points"] if own["dof"] == ["tip", "x"]]
    tallest = max(
        own["size_um_per_kN"]
        for own in response["peaks"]
        if own["output"] == own["input"] == first["output"]
    )
    # the minimum dynamic stiffness is one over the tallest peak
    assert 1e3 / tallest == approx(drive["minimum_dynamic_stiffness_N_per_um"], rel=1e-5)


def test_bodies_without_finite_elements_have_peaks_without_a_known_error(folder: Path) -> None:
    rigid = run(folder, "components.mast.fidelity=segmented", "components.block.fidelity=rigid")
    found = numbers(rigid)
    errors = [own.error or Estimate() for own in found.values()]
    assert errors and all(error.total is None and not error.shares for error in errors)
