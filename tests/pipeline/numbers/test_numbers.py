"""Numbers by key, their tables, and ± from what moves, on numbers by hand."""

import io
import math

import h5py
import numpy as np
import pytest

from headstock.geometry.errors import NumberNameError
from headstock.pipeline.answers.answer import Answer
from headstock.pipeline.numbers.estimates import DISCRETISATION, Estimate
from headstock.pipeline.numbers.kinds import KINDS
from headstock.pipeline.numbers.numbers import Key, Number, Numbers, make_key, parse_key

FIRST, SECOND = (make_key("frequency", pose="left", mode=mode) for mode in (1, 2))
PEAK = make_key(
    "path_deviation", feed="3000 mm/min", zone="accelerating", output="tcp x", figure="peak"
)
ERROR = Estimate(
    {DISCRETISATION: 0.5, "reduction": None},
    ("the mesh of bed",),
    {DISCRETISATION: {"column": 0.5}},
)


def hz(*values: float) -> list[Number]:
    return [Number(key, value, "Hz") for key, value in zip((FIRST, SECOND), values, strict=False)]


@pytest.mark.parametrize(
    "key",
    [FIRST, PEAK, make_key("compliance", pose='a "b", (c)=d', point="tcp", direction="xy")],
    ids=str,
)
def test_a_key_reads_as_it_is_written(key: Key) -> None:
    assert parse_key(str(key)) == key


@pytest.mark.parametrize(
    "text",
    ["", "frequency", "frequency()x", "speed(pose=a)", "frequency(part=a)", 'mass(component="a)'],
)
def test_what_is_no_key_is_refused(text: str) -> None:
    with pytest.raises(NumberNameError, match="no name of a number"):
        parse_key(text)


def test_a_table_in_a_file_holds_what_was_collected() -> None:
    numbers = Numbers.collect([Number(FIRST, 50.0, "Hz", ERROR), Number(PEAK, math.nan, "m")])
    with h5py.File(io.BytesIO(), "w") as file:
        numbers.write(file.create_group("numbers"))
        again = Numbers.read(file["numbers"])
    assert list(again) == [FIRST, PEAK]
    assert again[FIRST].error == ERROR and again[PEAK].error is None
    assert again[str(FIRST)].value == 50.0 and math.isnan(again[PEAK].value)


@pytest.mark.parametrize(
    ("column", "values"),
    [("name", [99, 0]), ("share_begin", [1, 2]), ("value", [1.0]), ("share_size", [0.5])],
)
def test_a_table_that_a_hand_has_altered_is_refused(column: str, values: list[float]) -> None:
    numbers = Numbers.collect([Number(FIRST, 50.0, "Hz", ERROR), Number(PEAK, 1e-6, "m")])
    with h5py.File(io.BytesIO(), "w") as file:
        group = file.create_group("numbers")
        numbers.write(group)
        kind = group[column].dtype
        del group[column]
        group[column] = np.array(values, kind)
        with pytest.raises(ValueError, match=r"numbers/|columns of numbers"):
            Numbers.read(group)


def test_errors_are_added_or_replaced() -> None:
    answer = Answer(errors={FIRST: Estimate({"reduction": 1.0}), SECOND: ERROR})
    new = {FIRST: Estimate({"reduction": 0.5, "model": 2.0})}
    assert answer.with_errors(new, "add").errors[FIRST].shares == {"reduction": 1.5, "model": 2.0}
    replaced = answer.with_errors(new, "replace").errors
    assert replaced == {**new, SECOND: ERROR}


def test_factors_have_evidence() -> None:
    covered = {kind.evidence for kind in KINDS.values() if kind.cover}
    assert covered == {"validate axes-estimates", "validate contour-estimates"}
