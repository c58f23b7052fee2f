"""What rigid joints between elastic bodies leave out, compared with the body in one piece."""

import itertools
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import headstock as hs
from common import approx
from fixture_machines import stored_scene, write_scene
from headstock.geometry.frames import FloatArray
from headstock.pipeline.accuracy import interface_choice
from headstock.pipeline.answers.accuracy import InterfaceErrorsAnswer
from headstock.pipeline.answers.answer import find_answers
from headstock.pipeline.answers.frf import PoseResponse, ResponseCurves
from headstock.pipeline.answers.modal import PoseModes
from headstock.pipeline.answers.static import StaticAnswer
from headstock.pipeline.numbers.estimates import INTERFACE
from headstock.pipeline.planning.planner import plan_scene
from headstock.pipeline.results.results import Results
from headstock.pipeline.results.summary import summarise
from headstock.scene.building.loader import load_scene
from headstock.solvers.second_order import ComplexArray
from scene_runs import compute

pytestmark = [pytest.mark.fem, pytest.mark.process]
HEAD = stored_scene("interface_errors_head")
WHOLE = """
[components.lower]
solid = { box = ["120 mm", "100 mm", "200 mm"] }
material = "steel"
mesh = { size = "20 mm", cells = "hex" }
interfaces = { foot = { face = "z-" }, tip = { face = "z+", rect = { center = ["20 mm", "30 mm"], size = ["80 mm", "40 mm"] } } }
"""
HALVES = stored_scene("interface_errors_halves")


def run(folder: Path, text: str, name: str) -> Results:
    return compute(folder, text, name=name, into=name)


def solve_halves(folder: Path, coupling: str, name: str) -> Results:
    text = (HEAD.replace("TIP", "upper.tip") + HALVES).replace("COUPLING", f"coupling = {coupling}")
    return run(folder, text, name)


def _read_at(curves: ResponseCurves, lines: FloatArray) -> ComplexArray:
    """The receptance at the nearest line of other lines."""
    nearest = np.abs(curves.frequencies_hz[:, None] - lines).argmin(axis=0)
    return np.asarray(curves.receptance[nearest])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("interfaces")


@pytest.fixture(scope="module")
def whole(folder: Path) -> Results:
    return run(folder, HEAD.replace("TIP", "lower.tip") + WHOLE, "whole")


def numbers(results: Results) -> list[tuple[float, float, float]]:
    """Value, the interface's part of its ±, and all of it."""
    (modes,) = find_answers(results.answers, PoseModes)
    (static,) = find_answers(results.answers, StaticAnswer)
    return [
        (number.value, error.shares.get(INTERFACE) or 0.0, error.total or 0.0)
        for answer in (modes, static)
        for number in answer.list_numbers()
        if (error := number.error) is not None
    ]


@pytest.mark.parametrize(
    ("coupling", "least", "most"),
    [
        pytest.param('"rigid"', 0.02, 0.1, marks=pytest.mark.trials),
        pytest.param('"average"', 0.01, 0.1, marks=pytest.mark.trials),
        ("{ flexible = 12 }", 1e-3, 0.08),
        ('{ flexible = 12, form = "weak" }', 1e-3, 0.05),
    ],
)
def test_one_piece_lies_within_what_a_joint_leaves_out(
    folder: Path, whole: Results, coupling: str, least: float, most: float
) -> None:
    found = solve_halves(folder, coupling, f"halves{abs(hash(coupling))}")
    pairs = list(zip(numbers(found), numbers(whole), strict=True))
    for (own, interface, total), (right, none, meshes) in pairs:
        assert none == 0.0
        # one mesh of equal elements is off by as much as the two
        assert abs(own - right) <= interface + 0.2 * (total - interface + meshes), (own, right)
        assert interface <= 4.0 * abs(own - right) + 0.02 * own
    shares = [interface / own for (own, interface, _), _ in pairs]
    assert least < max(shares) < most
    (answer,) = find_answers(found.answers, InterfaceErrorsAnswer)
    assert answer.joints["glue"].between == "lower.cut and upper.cut"
    warned = [text for text in found.warnings if text.startswith("joint glue:")]
    assert len(warned) == (max(shares) > 0.01)
    entry = summarise(found)["interface_errors"]["joints"]["glue"]
    assert entry["largest"] == approx(max(shares))


RESPONSE = """
[effects]
damping = { modal = 0.02 }
[analyses.frf]
inputs = ["tip"]
up_to = "2500 Hz"
points = 60
"""


def solve_response(folder: Path, coupling: str, name: str, *, judged: bool) -> PoseResponse:
    head = HEAD.replace("TIP", "upper.tip")
    head = head if judged else head.replace("interface_errors = true", "")
    body = HALVES.replace("COUPLING", f"coupling = {coupling}")
    (found,) = find_answers(run(folder, head + body + RESPONSE, name).answers, PoseResponse)
    return found


def test_lines_of_a_response_get_the_difference_to_joints_with_shapes(folder: Path) -> None:
    found = solve_response(folder, '"rigid"', "response", judged=True)
    lines = found.curves.frequencies_hz
    errors = found.curves.error_share[INTERFACE]
    outright = [
        solve_response(folder, f'{{ flexible = 40, form = "{form}" }}', form, judged=False)
        for form in ("strong", "weak")
    ]
    changes = np.max(
        [np.abs(_read_at(other.curves, lines) - found.curves.receptance) for other in outright],
        axis=0,
    )
    # lines of this grid that the others have too; beside their peaks theirs are elsewhere
    strong, weak = (other.curves.frequencies_hz for other in outright)
    shared = np.isin(lines, np.intersect1d(strong, weak))
    assert shared.sum() > 40
    passed = errors[shared] > changes[shared] * (1.0 + 1e-6) + 1e-15
    assert passed.any(axis=(1, 2)).mean() < 0.1  # a peak lies between its two places
    np.testing.assert_allclose(errors[shared][~passed], changes[shared][~passed], rtol=1e-6)
    assert (errors[shared] >= changes[shared] * (1.0 - 1e-6)).all()
    assert lines[0] == 0.0 and (errors[0] > 0.0).any()
    text = HEAD.replace("TIP", "lower.tip").replace("interface_errors = true", "") + WHOLE
    (one,) = find_answers(run(folder, text + RESPONSE, "one").answers, PoseResponse)
    shared = np.isin(lines, one.curves.frequencies_hz)
    off = np.abs(_read_at(one.curves, lines) - found.curves.receptance)[shared]
    assert found.curves.error is not None
    meshes = (found.curves.error - errors)[shared]
    # one mesh of equal elements is off by as much as the two; that of cross receptances far below
    # the largest entry of their line is known roughly (docs/errors.md)
    rough = 0.02 * meshes.max(axis=(1, 2), keepdims=True)
    covered = off <= errors[shared] + 0.2 * np.maximum(meshes, rough)
    assert covered.all()
    assert (errors[shared] / off).min() > 0.9 and (errors[shared] / off).max() < 1.2
    for own, *others in zip(found.figures, *(other.figures for other in outright), strict=True):
        depth = own.most_negative_real
        assert depth is not None
        moved = max(abs(other.most_negative_real - depth) for other in others)
        assert found.errors[found.figure_key(own.channel)].shares[INTERFACE] == approx(
            moved, rel=1e-3
        )


@pytest.mark.parametrize(
    ("coupling", "expected"), [('"rigid"', 1), ('"average"', 1), ("{ flexible = 24 }", 0)]
)
def test_without_the_comparison_a_large_rigid_joint_is_named_and_a_flexible_one_is_not(
    folder: Path, coupling: str, expected: int
) -> None:
    text = HEAD.replace("TIP", "upper.tip").replace("interface_errors = true", "") + HALVES
    found = run(folder, text.replace("COUPLING", f"coupling = {coupling}"), "plain")
    assert len([text for text in found.warnings if "lower.cut and upper.cut" in text]) == expected


def test_a_scene_without_such_a_joint_says_that_nothing_is_compared(folder: Path) -> None:
    path = write_scene(folder, HEAD.replace("TIP", "lower.tip") + WHOLE, name="alone")
    plan = plan_scene(load_scene(path))
    assert not [stage for stage in plan.stages if stage.kind == "joints"]
    assert any("interface_errors has nothing to compare" in text for text in plan.warnings)


def test_interfaces_of_different_size_are_named_and_the_run_goes_on(folder: Path) -> None:
    text = HEAD.replace("TIP", "upper.tip") + HALVES.replace("COUPLING", 'coupling = "rigid"')
    text = text.replace(
        'cut = { face = "z+",', 'cut = { face = "z+", rect = { size = ["80 mm", "60 mm"] },'
    )
    found = run(folder, text, "unequal")
    (warning,) = [text for text in found.warnings if "what joint glue leaves out" in text]
    assert "not the same area" in warning
    assert summarise(found)["interface_errors"]["joints"] == {}


def choose(folder: Path, coupling: str, accuracy: str, name: str) -> Results:
    head = HEAD.replace("TIP", "upper.tip").replace("interface_errors = true", accuracy)
    return run(folder, head + HALVES.replace(", COUPLING", coupling), name)


@pytest.mark.trials
def test_where_six_motions_are_not_enough_an_open_joint_gets_shapes(
    folder: Path, whole: Results
) -> None:
    goal = 'accuracy = { to = "4 %", models = "none" }'
    found = choose(folder, "", goal, "open")
    words = summarise(found)["accuracy"]["settings"]["glue"]
    # the joint covers the section of both halves: the weak form is the better one
    assert words.startswith("24 deformation shapes at lower.cut and upper.cut: ")
    assert "; weak form, the other one " in words
    (modes,), (right,) = (find_answers(each.answers, PoseModes) for each in (found, whole))
    assert modes.frequencies_hz == approx(right.frequencies_hz, rel=0.02)
    assert found.failures == ()
    again = choose(folder, "", goal, "open")
    assert summarise(again)["accuracy"]["settings"]["glue"] == words
    (same,) = find_answers(again.answers, PoseModes)
    np.testing.assert_allclose(same.frequencies_hz, modes.frequencies_hz, rtol=1e-9)


def test_where_six_motions_are_enough_an_open_joint_keeps_them(folder: Path) -> None:
    body = HALVES.replace(", COUPLING", "").replace(
        '["120 mm", "100 mm", "100 mm"]', '["40 mm", "30 mm", "100 mm"]'
    )
    body = body.replace(', rect = { center = ["20 mm", "30 mm"], size = ["80 mm", "40 mm"] }', "")
    goal = 'accuracy = { to = "20 %", models = "none" }'
    head = HEAD.replace("TIP", "upper.tip").replace("interface_errors = true", goal)
    found = run(folder, head + body, "slender")
    words = summarise(found)["accuracy"]["settings"]["glue"]
    assert words.startswith("six motions of each are enough at lower.cut and upper.cut: ")
    assert found.failures == ()


@pytest.mark.parametrize(
    ("coupling", "more", "chosen"),
    [
        (', coupling = "rigid"', "", False),
        ("", ', interfaces = "none"', False),
        pytest.param(
            ', coupling = "average"', ', interfaces = "all"', True, marks=pytest.mark.trials
        ),
    ],
)
def test_what_is_written_stays_unless_all_may_be_chosen(
    folder: Path, coupling: str, more: str, chosen: bool
) -> None:
    goal = f'accuracy = {{ to = "4 %", models = "none"{more} }}'
    settings = summarise(choose(folder, coupling, goal, f"written{more[-5:-1]}"))["accuracy"][
        "settings"
    ]
    assert ("glue" in settings) == chosen
    assert not chosen or " deformation shapes at lower.cut" in settings["glue"]


def test_without_an_accuracy_auto_is_twenty_four(folder: Path) -> None:
    path = folder / "auto.toml"
    body = HALVES.replace("COUPLING", 'coupling = { flexible = "auto" }')
    path.write_text(HEAD.replace("TIP", "upper.tip") + body)
    cut = load_scene(path).machine.components["lower"].interfaces["cut"]
    assert cut.auto and cut.flexible == 24 and cut.open_kind
    # what the number leaves out is a part of ±
    assert "joints" in [stage.kind for stage in plan_scene(load_scene(path)).stages]


SCENE = stored_scene("interface_errors")


def test_trials_of_shapes_end_within_a_budget_and_say_what_they_reached(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(interface_choice, "TRIAL_SECONDS", 0.1)
    path = write_scene(tmp_path, SCENE, name="three")
    results = hs.run(path)
    (failure,) = results.failures
    text = str(failure)
    assert "1 % is not reached" in text and "12 shapes" in text and "flexible = 90" in text
    assert len(results.modal[0].frequencies_hz) == 8


def test_more_shapes_are_tried_while_the_budget_lasts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A trial of 24 shapes costs about as much as one of 12, which is compared with nearly as many."""
    clock = itertools.count(0, 15)
    watch = SimpleNamespace(process_time=lambda: float(next(clock)))
    monkeypatch.setattr(interface_choice, "time", watch)
    path = write_scene(tmp_path, SCENE, name="three")
    said = " ".join(map(str, hs.run(path).failures))
    assert "with 12 shapes" not in said
