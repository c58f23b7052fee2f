"""What the next round refines: enough for every number, for the least processor time."""

import dataclasses

import numpy as np
import pytest

from common import STEEL, approx
from headstock.geometry.parts.components import Component
from headstock.geometry.parts.solids import Box
from headstock.pipeline.accuracy.quantities import Quantity
from headstock.pipeline.accuracy.rounds import AIM, _MeshScale, _wanted_ratios
from headstock.pipeline.numbers.changes import Owner
from headstock.pipeline.numbers.estimates import DISCRETISATION, REDUCTION
from headstock.pipeline.numbers.numbers import make_key

BASE = Component("base", Box((0.5, 0.4, 0.2)), STEEL)
COLUMN = Component("column", Box((0.1, 0.1, 0.4)), STEEL)
PARTS = {"base": BASE, "left": COLUMN, "right": dataclasses.replace(COLUMN, name="right")}
MESH = {name: (name, DISCRETISATION) for name in PARTS}
EQUAL = dict.fromkeys(PARTS, 1.0)


FIRST = make_key("frequency", pose="reference", mode=1)


def number(base: float, left: float, right: float = 0.0, mode: int = 1) -> Quantity:
    parts = {MESH["base"]: base, MESH["left"]: left, MESH["right"]: right}
    key = make_key("frequency", pose="reference", mode=mode)
    return Quantity(key, key.describe(), 100.0, parts)


def left_over(quantity: Quantity, ratios: dict[Owner, float]) -> float:
    return sum(ratios.get(owner, 1.0) * part for owner, part in quantity.parts.items())


def test_numbers_that_just_miss_refine_the_body_at_fault_alone_and_no_further_than_needed() -> None:
    just = number(0.028, 0.004)
    ratios = _wanted_ratios([just, number(0.001, 0.001, mode=2)], 0.03, PARTS, EQUAL)
    assert set(ratios) == {MESH["base"]}
    assert 0.8 * AIM * 0.03 < left_over(just, ratios) <= AIM * 0.03


def test_an_even_mesh_and_a_graded_one_are_compared_by_their_dofs() -> None:
    hexes = _MeshScale(0.094, 0.0097, graded=False)
    tets = _MeshScale(0.0058, 0.0058, graded=True)
    # sizes would say a sixteenth, after which nothing would be left of the error
    assert tets.step_from(hexes) == approx(0.6, abs=0.01)
    assert _MeshScale(0.056, 0.008, graded=False).step_from(hexes) == approx(0.6, abs=0.01)


@pytest.mark.parametrize("seed", range(50))
def test_every_number_is_expected_to_be_right(seed: int) -> None:
    parts = np.random.default_rng(seed).uniform(0.0, 0.02, (5, 3))
    numbers = [
        number(float(base), float(left), float(right), row)
        for row, (base, left, right) in enumerate(parts, 1)
    ]
    ratios = _wanted_ratios(numbers, 0.03, PARTS, EQUAL)
    assert all(left_over(one, ratios) <= AIM * 0.03 for one in numbers if one.error > 0.03)


def test_of_bodies_that_make_as_much_of_the_error_the_cheaper_one_is_refined() -> None:
    even = number(0.0155, 0.0155)
    cheap = _wanted_ratios([even], 0.03, PARTS, {**EQUAL, "base": 20.0})
    assert set(cheap) == {MESH["left"], MESH["right"]}
    assert set(_wanted_ratios([even], 0.03, PARTS, {**EQUAL, "left": 20.0})) == {MESH["base"]}


def test_equal_bodies_are_refined_alike() -> None:
    ratios = _wanted_ratios([number(0.0, 0.05, 0.01)], 0.03, PARTS, EQUAL)
    assert ratios[MESH["left"]] == ratios[MESH["right"]] < 1.0


def test_a_body_that_needs_several_rounds_is_not_helped_by_refining_the_others() -> None:
    ratios = _wanted_ratios([number(0.2, 0.002)], 0.03, PARTS, EQUAL)
    assert set(ratios) == {MESH["base"]}
    assert ratios[MESH["base"]] < 0.2


def test_a_part_without_a_bound_is_refined_whatever_it_costs() -> None:
    unknown = Quantity(FIRST, "f1", 100.0, {("base", REDUCTION): np.inf, MESH["left"]: 0.001})
    assert _wanted_ratios([unknown], 0.03, PARTS, EQUAL) == {("base", REDUCTION): 0.0}


def test_numbers_that_are_right_ask_for_nothing() -> None:
    assert _wanted_ratios([number(0.01, 0.01)], 0.03, PARTS, EQUAL) == {}
    assert number(0.01, 0.01).error == approx(0.02)
