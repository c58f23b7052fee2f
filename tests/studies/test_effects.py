"""What an effect moves and costs is what two runs differ by."""

from pathlib import Path

import pytest

from common import Shell, approx
from headstock.app.actions.effecting import _tell_trial
from headstock.pipeline.numbers.estimates import show_share
from headstock.pipeline.numbers.numbers import Number, make_key
from headstock.pipeline.storage.provenance import SceneChoice
from headstock.pipeline.storage.store import Store
from headstock.studies.effects import EffectTrial, rank_trials, try_effects
from headstock.studies.kind_changes import Change, compare_kinds

SCENE = Path(__file__).resolve().parents[2] / "machines" / "tripteor.toml"


def modes(*frequencies: float) -> list[Number]:
    """Numbers of a free machine: a rigid-body mode first."""
    return [
        Number(make_key("frequency", pose="p", mode=mode), hz, "Hz")
        for mode, hz in enumerate((0.0, *frequencies), 1)
    ]


def compliances(x: float, y: float) -> list[Number]:
    return [
        Number(make_key("compliance", pose="p", point="tcp", direction=direction), value, "m/N")
        for direction, value in (("x", x), ("y", y))
    ]


def gap(share: float, without: float, present: float) -> Change:
    key = make_key("contour_gap", face=1, direction="x", figure="mean")
    return Change(key, share, without, present, "m")


def test_a_frequency_is_compared_with_itself_and_a_vector_with_its_largest_component() -> None:
    (change,) = compare_kinds(modes(50.0, 100.0), modes(51.5, 98.0))
    found = (str(change.key), change.without, change.present)
    assert found == ("frequency(pose=p,mode=2)", 50.0, 51.5)
    assert change.share == approx(1.5 / 51.5)
    assert change.place == "frequency 2 in pose p" and gap(0.1, 1.0, 1.1).place == "face 1, x, mean"
    (vector,) = compare_kinds(compliances(1e-8, 1e-15), compliances(1.1e-8, 2e-15))
    assert vector.share == approx(1.0 / 11.0) and vector.without == 1e-8
    assert vector.summarise() == {
        "answer": "static compliance",
        "share": vector.share,
        "entry": "compliance(pose=p,point=tcp,direction=x)",
        "unit": "µm/kN",
        "without": approx(10.0),
        "present": approx(11.0),
    }


def test_a_number_that_only_one_run_has_is_a_change_of_all_of_it() -> None:
    (change,) = compare_kinds([], modes(50.0))
    assert (change.share, change.without, change.present) == (1.0, None, 50.0)
    assert compare_kinds([], []) == [] == compare_kinds(modes(), modes())


def test_close_modes_that_change_places_and_rounding_are_no_changes() -> None:
    def modes_with(*ratios: float) -> list[Number]:
        damped = [
            Number(make_key("damping_ratio", pose="p", mode=mode), ratio, "1")
            for mode, ratio in enumerate(ratios, 2)
        ]
        return [*modes(50.0, 50.0), *damped]

    (change,) = compare_kinds(modes_with(0.01, 0.03), modes_with(0.03, 0.01))
    assert change.key.kind == "frequency" and change.share == 0.0
    noise, other = (
        [Number(make_key("joint_force", feed="f", joint="a", direction="x"), 1.0, "N"),
         Number(make_key("velocity_lag", pose="p", drive="x"), 1.0, "m"),
         Number(make_key("velocity_lag", pose="p", drive="y"), size, "m")]
        for size in (1e-12, -1e-12)
    )  # fmt: skip
    assert {change.share for change in compare_kinds(noise, other)} == {0.0}


@pytest.mark.parametrize(("named", "share", "advice"), [
    (True, 0.0, "moves nothing that was asked for"), (True, 2e-4, "leave it out"), (True, 5e-3, "keep it for the third digit"),
    (True, 0.3, "keep it"), (False, 2e-4, "rightly left out"), (False, 0.3, "name it"),
])  # fmt: skip
def test_advice_follows_from_what_is_moved(named: bool, share: float, advice: str) -> None:
    moved = gap(share, 1e-5, 1e-5 * (1.0 + share))
    trial = EffectTrial("coriolis", named, (moved,), 10.0, 6.2, 0.05)
    assert trial.advice == advice
    said = f"coriolis: {show_share(share)} of contour gap, 38 % of run time: {advice}"
    assert not share or _tell_trial(trial) == said


def test_an_effect_that_moves_nothing_still_says_what_it_cost() -> None:
    said = "coriolis: moves nothing that was asked for (10 s with, 6.2 s without)"
    assert _tell_trial(EffectTrial("coriolis", True, (), 10.0, 6.2)) == said


def test_time_within_the_noise_is_no_cost() -> None:
    change = gap(0.1, 1e-6, 1.1e-6)
    for without, share in ((9.0, 0.0), (5.0, 0.5)):
        assert EffectTrial("damping", True, (change,), 10.0, without, 0.2).time_share == share


@pytest.mark.parametrize(
    ("share", "shown"),
    [(0.0, "0 %"), (2e-6, "2e-04 %"), (2e-4, "0.02 %"), (0.123, "12 %"), (1.0, "100 %")],
)
def test_shares_are_shown_in_per_cent(share: float, shown: str) -> None:
    assert show_share(share) == shown


@pytest.mark.trials
def test_every_effect_is_tried_and_the_strongest_comes_first(tmp_path: Path) -> None:
    settings = ('analyses.static.poses="config_2"', 'analyses.map.sweep="plane"')
    plan = SceneChoice(SCENE, "lumped", settings, ("static",))
    trials = {trial.effect: trial for trial in try_effects(plan, Store(tmp_path))}
    gravity = trials["gravity"]
    assert gravity.active
    assert gravity.changes[0].label == "displacement under loads"
    assert gravity.changes[0].without is None
    assert trials["coriolis"].largest == 0.0
    assert "write it in [drives.NAME]" in trials["torque_ripple"].obstacle
    ranked = [trial.effect for trial in rank_trials(list(trials.values()))]
    assert ranked[0] == "gravity" and trials[ranked[-1]].obstacle


@pytest.mark.parametrize(
    ("line", "said"),
    [
        (f"effects {SCENE} --analysis frf", "has no [analyses.frf]"),
        ("effects none.toml", "none.toml"),
    ],
)
def test_the_command_refuses_what_it_cannot_do(shell: Shell, line: str, said: str) -> None:
    assert said in shell.refuses(line)


def test_the_command_writes_what_it_prints(shell: Shell) -> None:
    pose = """--set 'analyses.static.poses="config_1"'"""
    printed = shell(f"effects {SCENE} --analysis static {pose} --json effects.json").out
    assert "gravity: 100 % of displacement under loads" in printed
    found = shell.json("effects.json")["effects"]
    assert found[0]["effect"] == "gravity" and found[0]["advice"] == "keep it"
