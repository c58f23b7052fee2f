"""Two rounds of a search tell how good its estimates are."""

import pytest

from common import approx
from headstock.pipeline.accuracy.quantities import (
    LEAST_FACTOR,
    MESH_SAFETY,
    MOST_FACTOR,
    Quantity,
    count_safely,
    weigh_estimates,
)
from headstock.pipeline.numbers.estimates import DISCRETISATION, REDUCTION
from headstock.pipeline.numbers.numbers import make_key

COLUMN, BASE = ("column", DISCRETISATION), ("base", DISCRETISATION)


def number(value: float, column: float, base: float = 0.0, mode: int = 1) -> Quantity:
    return Quantity(
        make_key("frequency", pose="reference", mode=mode),
        "frequency 1",
        value,
        {COLUMN: column, BASE: base, ("column", REDUCTION): 0.001},
    )


def rounds(effectivity: float, *, rate: float = 2.0, step: float = 0.6) -> tuple[float, float]:
    """Counted and true error of the finer of two rounds whose estimates are so many times the true
    errors.
    """
    true = [0.05, 0.05 * step**rate]
    before, after = (number(100.0 * (1.0 + error), effectivity * error) for error in true)
    factors = weigh_estimates([before], [after], {"column": step}, {})
    return count_safely([after], factors)[0].parts[COLUMN], true[1]


@pytest.mark.parametrize("effectivity", [0.6, 1.0, 2.0, 3.5])
@pytest.mark.parametrize("rate", [1.5, 2.2, 4.0])
def test_what_is_counted_covers_the_true_error_without_waste(
    effectivity: float, rate: float
) -> None:
    counted, true = rounds(effectivity, rate=rate)
    assert counted >= true
    assert counted <= MOST_FACTOR * effectivity * true
    # one and a half times the true error, but for the least that counts
    assert counted <= max(1.6, LEAST_FACTOR * effectivity) * true


def test_estimates_that_are_too_large_count_less_and_never_nothing() -> None:
    counted, true = rounds(2.0, rate=2.2)
    assert counted < MESH_SAFETY * 2.0 * true
    same = number(100.0, 0.04)
    factors = weigh_estimates([same], [same], {"column": 0.6}, {})
    assert factors["column"] == LEAST_FACTOR


def test_numbers_that_decide_tell_the_factor_of_a_component() -> None:
    before = [number(105.0, 0.05), number(50.0, 0.05, mode=2), number(9.9, 0.01, mode=3)]
    # the second stood still by chance; the third hardly depends on the mesh
    after = [number(101.5, 0.02), number(50.0, 0.02, mode=2), number(9.5, 0.004, mode=3)]
    factors = weigh_estimates(before, after, {"column": 0.6}, {})
    assert factors == weigh_estimates(before[:1], after[:1], {"column": 0.6}, {})
    assert 1.0 < factors["column"] < MOST_FACTOR
    counted = count_safely(after, factors)
    assert counted[1].parts[COLUMN] == approx(0.02 * factors["column"], abs=0.0)


def test_a_step_too_small_to_tell_much_does_not_undo_what_was_learnt() -> None:
    before, after = number(101.0, 0.02), number(100.0, 0.015)
    alone = weigh_estimates([before], [after], {"column": 0.8}, {})["column"]
    known = {"column": 0.9}
    assert alone > 0.9
    assert weigh_estimates([before], [after], {"column": 0.8}, known) == known


def test_parts_that_were_not_refined_keep_their_factor() -> None:
    before, after = number(100.0, 0.04, 0.02), number(99.0, 0.02, 0.02)
    known = {"base": 0.9}
    factors = weigh_estimates([before], [after], {"column": 0.7}, known)
    assert factors["base"] == 0.9
    counted = count_safely([after], factors)[0].parts
    assert counted[BASE] == approx(0.9 * 0.02, abs=0.0)
    assert counted["column", REDUCTION] == approx(0.001, abs=0.0)
    # a number that was not there before is counted as everywhere
    fresh = weigh_estimates([], [after], {"column": 0.7}, {})
    assert count_safely([after], fresh)[0].parts[COLUMN] == approx(MESH_SAFETY * 0.02, abs=0.0)
    assert fresh == {}
