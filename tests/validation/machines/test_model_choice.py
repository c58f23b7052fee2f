"""A stated accuracy is kept on a drawn machine whose models are all chosen."""

from pathlib import Path

import numpy as np
import pytest

from common import approx
from headstock.validation.coverage import cases as coverage_cases
from headstock.validation.machines import model_choice_cases
from headstock.validation.machines.model_choice_cases import (
    ChosenScene,
    _evaluate,
    load_drawn,
    measure_choice,
    measure_reference,
)
from headstock.validation.machines.model_estimate_cases import HOLD_OUT


@pytest.mark.trials
@pytest.mark.fem
@pytest.mark.process
def test_a_machine_of_three_bodies_keeps_five_percent(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(model_choice_cases, "TRUE_SHARE", 0.5)
    monkeypatch.setattr(model_choice_cases, "MODES_TO", 1000.0)
    monkeypatch.setattr(model_choice_cases, "HAND_MESHES", {})
    scene = load_drawn(42, tmp_path)
    reference = measure_reference(scene, 0.05)
    found = measure_choice(42, 0.05, scene, reference)
    assert found.asked == 0.05
    assert found.met and 0.005 < found.errors.max() < 0.05
    # what is simpler by hand is much further off
    assert {name: error > 0.1 for name, (error, _) in found.by_hand.items()} == {
        "rigid": True,
        "8 segments": True,
    }


def test_rows_hold_numbers_beyond_what_was_asked_and_costs_beside_the_cheapest() -> None:
    kept = np.full(19, 0.01)
    near = ChosenScene(50, 0.05, True, 0.01, kept, 3.0, {"a": (0.02, 2.0), "b": (0.2, 0.1)})
    far = ChosenScene(51, 0.05, True, 0.01, np.array([0.2]), 9.0, {"a": (0.02, 2.0)})
    refused = ChosenScene(49, 0.05, False, 0.01, np.array([0.5]), 1.0, {})
    doubtful = ChosenScene(48, 0.05, True, 0.03, np.array([0.5]), 1.0, {})
    beyond, dear = _evaluate("machine", [near, far, refused, doubtful])
    assert (
        beyond.value == approx(1.0 / 20.0) and "1 more were refused, 1 have no truth" in beyond.note
    )
    assert dear.value == 0.5 and not dear.passed and "machine 51" in dear.note


def test_the_machines_and_parts_are_none_that_margins_were_chosen_on() -> None:
    assert not set(model_choice_cases.MACHINES) & set(HOLD_OUT)
    assert len(model_choice_cases.MACHINES) >= 20
    assert len(model_choice_cases.PARTS) == 10
    assert min(model_choice_cases.PARTS) >= coverage_cases.FRESH
