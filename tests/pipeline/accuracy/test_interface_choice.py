"""Trials of deformation shapes end within their budget, and say what they reached."""

import itertools
from pathlib import Path
from types import SimpleNamespace

import pytest

import headstock as hs
from headstock.pipeline.accuracy import interface_choice

SCENE = """
free = true
accuracy = "1 %"
materials.m = { E = "210 GPa", nu = 0.3, rho = "7850 kg/m^3" }
analyses.modal = { count = 8 }
[components.plate]
solid = { box = ["120 mm", "60 mm", "20 mm"] }
material = "m"
interfaces.a = { face = "z+", rect = { size = ["20 mm", "40 mm"], center = ["-40 mm", "0 mm"] }, coupling = { flexible = "auto" } }
interfaces.b = { face = "z+", rect = { size = ["20 mm", "40 mm"], center = ["40 mm", "0 mm"] }, coupling = { flexible = "auto" } }
[components.one]
at = ["-40 mm", "0 mm", "20 mm"]
solid = { box = ["20 mm", "40 mm", "50 mm"] }
material = "m"
interfaces.foot = { face = "z-", coupling = { flexible = "auto" } }
[components.two]
at = ["40 mm", "0 mm", "20 mm"]
solid = { box = ["20 mm", "40 mm", "40 mm"] }
material = "m"
interfaces.foot = { face = "z-", coupling = { flexible = "auto" } }
[joints]
j1 = { between = ["one.foot", "plate.a"], kind = "rigid" }
j2 = { between = ["two.foot", "plate.b"], kind = "rigid" }
"""


def test_trials_of_shapes_end_within_a_budget_and_say_what_they_reached(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(interface_choice, "TRIAL_SECONDS", 0.1)
    path = tmp_path / "three.toml"
    path.write_text(SCENE)
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
    path = tmp_path / "three.toml"
    path.write_text(SCENE)
    said = " ".join(map(str, hs.run(path).failures))
    assert "with 12 shapes" not in said
