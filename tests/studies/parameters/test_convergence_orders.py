import pytest
from hypothesis import given
from hypothesis import strategies as st

from common import approx
from headstock.studies.parameters.tables import extrapolate_values


@given(
    order=st.floats(0.6, 6.0),
    limit=st.floats(1.0, 1e3),
    constant=st.floats(0.1, 10.0),
    ratios=st.tuples(st.floats(1.3, 3.0), st.floats(1.3, 3.0)),
)
def test_order_and_limit_of_a_power_law_are_found_whatever_the_ratios_of_the_sizes(
    order: float, limit: float, constant: float, ratios: tuple[float, float]
) -> None:
    sizes = [1.0, 1.0 / ratios[0], 1.0 / ratios[0] / ratios[1]]
    found = extrapolate_values(sizes, [limit + constant * size**order for size in sizes])
    assert found.order == approx(order, rel=1e-5)
    assert found.limit == approx(limit, rel=1e-6)
    assert found.remark == ""


def test_only_the_three_finest_sizes_count() -> None:
    found = extrapolate_values([8.0, 4.0, 2.0, 1.0], [-77.0, 17.0, 5.0, 2.0])
    assert found.order == approx(2.0)
    assert found.limit == approx(1.0)
    assert found.error == approx(1.0)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ([1.0, 2.0, 1.5], "not monotone"),
        ([1.0, 2.0, 2.0], "not monotone"),
        ([1.0, 2.0, 4.0], "not converging"),
        ([2.0, 2.0, 2.0], "does not depend"),
        ([2.0, 1.0, 1.0 - 1e-9], "faster than any order"),
    ],
)
def test_values_without_an_order_say_why(values: list[float], words: str) -> None:
    found = extrapolate_values([4.0, 2.0, 1.0], values)
    assert found.order is None
    assert found.limit is None
    assert words in found.remark


def test_a_very_low_order_warns_of_its_limit() -> None:
    found = extrapolate_values([4.0, 2.0, 1.0], [4.0**0.2, 2.0**0.2, 1.0])
    assert found.order == approx(0.2)
    assert "too coarse" in found.remark


@pytest.mark.parametrize("sizes", [[2.0, 1.0], [2.0, 1.0, 1.0]])
def test_fewer_than_three_sizes_are_refused(sizes: list[float]) -> None:
    with pytest.raises(ValueError, match="at least 3"):
        extrapolate_values(sizes, sizes)
