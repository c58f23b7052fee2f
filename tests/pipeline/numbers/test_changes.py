"""Numbers of a changed machine: pairs of equal keys, the ± that follows by hand, refusals in words."""

import math

import pytest

from common import approx
from headstock.pipeline.numbers.changes import (
    Change,
    Tried,
    compare_numbers,
    estimate_changes,
    to_errors,
    try_changes,
)
from headstock.pipeline.numbers.estimates import CUTTING, DISCRETISATION, MODEL, REDUCTION, Estimate
from headstock.pipeline.numbers.kinds import KINDS
from headstock.pipeline.numbers.numbers import Number, make_key

FIRST, SECOND = (make_key("frequency", pose="reference", mode=mode) for mode in (1, 2))
PEAK = make_key("path_deviation", feed="6 m/min", zone="all", output="tcp x", figure="peak")


def hz(*values: float) -> list[Number]:
    return [Number(key, value, "Hz") for key, value in zip((FIRST, SECOND), values, strict=False)]


def test_equal_keys_are_a_pair() -> None:
    moved = compare_numbers(hz(50.0, 80.0), [Number(FIRST, 48.0, "Hz"), Number(PEAK, 1.0, "m")])
    assert moved.difference == {FIRST: -2.0}
    assert moved.lost == {SECOND} and set(moved.added) == {PEAK}
    assert compare_numbers(hz(50.0), hz(math.nan)).lost == {FIRST}


def test_a_deviation_is_compared_by_its_size() -> None:
    moved = compare_numbers([Number(PEAK, -3e-6, "m")], [Number(PEAK, 5e-6, "m")])
    assert moved.difference[PEAK] == approx(2e-6)


def test_errors_of_owners_add_up_and_forms_of_one_stand_for_each_other() -> None:
    base = hz(50.0, 80.0)
    moves = {
        ("column", DISCRETISATION): compare_numbers(base, hz(49.0, 79.5)),
        ("bed", DISCRETISATION): compare_numbers(base, hz(50.5)),
    }
    added = to_errors(base, moves, join="sum")
    assert added[FIRST].shares == {DISCRETISATION: 1.5}
    assert added[FIRST].parts == {DISCRETISATION: {"column": 1.0, "bed": 0.5}}
    assert added[SECOND].total is None  # the machine of the bed lost it
    largest = to_errors(base, moves, join="largest", split=lambda key, size: {"joint": size})
    assert largest[FIRST] == Estimate({DISCRETISATION: 1.0}, (), {DISCRETISATION: {"joint": 1.0}})
    assert largest[SECOND].shares == {DISCRETISATION: None}


def test_changes_count_as_often_as_their_kind_says() -> None:
    base = [Number(PEAK, 4e-6, "m", Estimate({"local": 1e-7}))]
    found = estimate_changes(
        base,
        [
            Tried(("", DISCRETISATION), (Number(PEAK, 5e-6, "m"),)),
            Tried(("Ktc", CUTTING), (Number(PEAK, 4.5e-6, "m"),)),
            Tried(("bed", REDUCTION), "no modes"),
            Tried(("Krc", CUTTING), "no border"),
        ],
        left_out=("what is not looked at",),
    )[PEAK]
    cover = KINDS["path_deviation"].cover
    assert found.shares == approx(
        {DISCRETISATION: cover[""] * 1e-6, CUTTING: cover[CUTTING] * 5e-7, "local": 1e-7}
    )
    refused = ("reduction of bed: no modes", "Krc of the cutting coefficients: no border")
    assert found.left_out == ("what is not looked at", *refused)


def test_a_model_replaces_the_errors_of_another() -> None:
    base = [Number(FIRST, 50.0, "Hz", Estimate({REDUCTION: 3.0})), *hz(50.0, 80.0)[1:]]
    better = Number(FIRST, 46.0, "Hz", Estimate({DISCRETISATION: 0.5}, ("the mesh of bed",)))
    moves = {("", MODEL): compare_numbers(base, [better])}
    found = to_errors(base, moves, join="replace", split=lambda key, size: {"column": size})
    assert found[FIRST] == Estimate(
        {MODEL: 4.0, DISCRETISATION: 0.5}, ("the mesh of bed",), {MODEL: {"column": 4.0}}
    )
    assert found[SECOND] == Estimate({MODEL: None}, ("the mesh of bed",))


def test_a_refusal_is_an_outcome_and_a_change_of_nothing_is_none() -> None:
    def fail(machine: float) -> float:
        raise ValueError("it falls apart")

    changes = [
        Change(("same", MODEL), lambda machine: None),
        Change(("broken", MODEL), fail),
        Change(("softer", MODEL), lambda machine: 0.5 * machine),
    ]
    tried = try_changes(100.0, changes, lambda machine: hz(machine), refused=(ValueError,))
    assert [each.owner[0] for each in tried] == ["broken", "softer"]
    assert tried[0].outcome == "it falls apart"
    outcome = tried[1].outcome
    assert isinstance(outcome, tuple)
    assert [number.value for number in outcome] == [50.0]
    with pytest.raises(ValueError, match="falls apart"):
        try_changes(100.0, changes, lambda machine: hz(machine), refused=(KeyError,))
