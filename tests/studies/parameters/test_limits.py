import math
from collections.abc import Sequence

from hypothesis import given
from hypothesis import strategies as st

from common import approx
from headstock.pipeline.numbers.estimates import DISCRETISATION, REDUCTION, Estimate
from headstock.pipeline.numbers.numbers import Number, make_key
from headstock.studies.parameters.limits import (
    Limit,
    MeshCosts,
    MeshedNumber,
    find_limit,
    find_need,
)

FACTORS = tuple(2.0 * math.sqrt(0.5) ** place for place in range(5))
COSTS = MeshCosts(
    FACTORS,
    tuple(round(8000.0 / factor**3) for factor in FACTORS),
    tuple(0.5 / factor**4 for factor in FACTORS),
    tuple(200.0 / factor**3 for factor in FACTORS),
)


def make_series(
    values: Sequence[float | None],
    errors: Sequence[float] | None = None,
    *,
    fixed: float = 0.0,
    name: str = "f1",
) -> MeshedNumber:
    key = make_key("frequency", pose="reference", mode=1)
    known = [None] * len(values) if errors is None else errors
    numbers = [
        None
        if value is None
        else Number(key, value, "Hz", Estimate({DISCRETISATION: error, REDUCTION: fixed}))
        for value, error in zip(values, known, strict=True)
    ]
    return MeshedNumber(name, name, tuple(numbers))


@given(order=st.floats(0.8, 3.8), limit=st.floats(1.0, 1e4), share=st.floats(1e-3, 0.2))
def test_the_limit_of_a_power_law_is_within_its_error(
    order: float, limit: float, share: float
) -> None:
    found = find_limit(
        FACTORS, make_series([limit * (1.0 + share * factor**order) for factor in FACTORS])
    )
    assert found.order == approx(order, abs=0.05)
    assert found.error is not None and abs(found.value - limit) <= found.error + 1e-9 * limit


def test_meshes_whose_sizes_say_nothing_have_a_limit_where_their_estimated_errors_vanish() -> None:
    # curved faces hold the mesh as it is until the size falls below their elements
    errors = [4.0, 3.7, 3.4, 3.0, 2.2]
    found = find_limit(FACTORS, make_series([100.0 + 0.4 * error for error in errors], errors))
    assert found.value == approx(100.0)
    assert found.error == approx(0.4 * 2.2 / 3.0)


def test_a_number_that_hardly_follows_its_estimate_is_not_believed_to_be_near_its_limit() -> None:
    # torsion of a bar that has two elements across on each of the last meshes
    errors = [53.0, 34.0, 23.0, 19.0, 14.0]
    found = find_limit(FACTORS, make_series([100.0 + 0.05 * error for error in errors], errors))
    assert found.order is None
    assert found.error == approx(0.45 * 14.0)
    assert found.remark == "two ways differ"


def test_values_that_follow_neither_size_nor_estimate_have_no_order_and_a_wide_error() -> None:
    found = find_limit(FACTORS, make_series([103.0, 101.0, 100.0, 101.0, 100.2], [3, 2.5, 2, 1, 1]))
    assert found.order is None
    assert found.value == 100.2
    assert found.error is not None and found.error >= 1.5
    assert found.remark


def test_two_meshes_are_too_few_and_modes_left_out_stay_in_the_error() -> None:
    few = find_limit(FACTORS, make_series([None, None, None, 101.0, 100.5], [1.0] * 5))
    assert (few.value, few.error, few.order, few.remark) == (100.5, 1.0, None, "too few meshes")
    values = [100.0 + factor**2 for factor in FACTORS]
    sharp, blunt = (find_limit(FACTORS, make_series(values, fixed=fixed)) for fixed in (0.0, 3.0))
    assert sharp.error is not None and blunt.error == approx(sharp.error + 3.0)


def test_the_mesh_that_an_accuracy_takes_is_read_between_and_beyond_the_meshes() -> None:
    series = [make_series([100.0 * (1.0 + 0.02 * factor**2) for factor in FACTORS])]
    limits = [find_limit(FACTORS, each) for each in series]
    between = find_need(0.01, COSTS, series, limits)
    # 0.02 factor^2 = 0.01
    assert between.reach == "between"
    assert between.factor == approx(math.sqrt(0.5), rel=0.02)
    assert between.dofs == approx(8000.0 * 2.0**1.5, rel=0.06)
    beyond = find_need(0.002, COSTS, series, limits)
    assert beyond.reach == "beyond"
    assert beyond.factor == approx(math.sqrt(0.1), rel=0.05)
    assert beyond.dofs == approx(8000.0 * 10.0**1.5, rel=0.15)
    assert beyond.seconds == approx(0.5 * 10.0**2, rel=0.25)
    assert find_need(0.2, COSTS, series, limits).reach == "coarsest"
    assert find_need(1e-5, COSTS, series, limits).reach == "far"


def test_nobody_can_tell_the_mesh_for_a_number_whose_error_is_unknown() -> None:
    series = [make_series([None, None, None, None, 100.0])]
    assert find_need(0.01, COSTS, series, [Limit(100.0, None)]).reach == "far"


def test_the_number_that_takes_the_finest_mesh_decides() -> None:
    low_frequency, fast = (
        make_series([1.0 + share * f**2 for f in FACTORS], name=name)
        for name, share in (("f1", 0.001), ("f2", 0.02))
    )
    limits = [find_limit(FACTORS, each) for each in (low_frequency, fast)]
    assert find_need(0.01, COSTS, [low_frequency, fast], limits).decisive == "f2"
