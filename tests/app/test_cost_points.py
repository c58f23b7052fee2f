"""Errors of a study's points against its truth, and which of them are worth their cost."""

import math
from typing import Any

import pytest

from headstock.app.cost_charts import draw_costs
from headstock.app.cost_listing import cost_table, digit_words, list_costs
from headstock.pipeline.cost_points import cheapest_within, pareto_front, weigh_costs
from headstock.pipeline.study_points import TRUTH, Study, StudyFamily
from headstock.pipeline.study_records import StudyRecord
from headstock.pipeline.study_tables import tabulate_study

SIZE = "components.column.mesh.size"
FAMILIES = (
    StudyFamily(TRUTH, "held against", {}, {}),
    StudyFamily("tets", "tets", {}, {SIZE: ("40 mm", "20 mm", "10 mm")}),
    StudyFamily("automatic", "automatic", {}, {"accuracy": ("1 %",)}),
)


def make_record(family: str, varied: dict[str, Any], hz: float | None, seconds: float, **more: Any) -> StudyRecord:
    modes = [] if hz is None else [hz, 200.0]
    summary = {
        "modal": [{"pose_name": "reference", "frequencies_hz": modes}],
        "totals": {"peak_rss_mb": 100.0, "full_dofs": 3000},
        **more,
    }
    times = (seconds, 1.5 * seconds, 0.5 * seconds)
    return StudyRecord("", family, varied, "done", summary=summary, seconds=times, cpu_seconds=times)


@pytest.fixture
def points():
    records = [
        make_record(TRUTH, {}, 100.0, 50.0),
        make_record("tets", {SIZE: "40 mm"}, 109.0, 1.0),
        make_record("tets", {SIZE: "20 mm"}, 100.9, 4.0),
        make_record("tets", {SIZE: "10 mm"}, 102.0, 8.0),
        make_record("automatic", {"accuracy": "1 %"}, 100.5, 6.0, accuracy={"asked": 0.01}),
    ]
    study = Study("cost", FAMILIES, ("modal[0].frequencies_hz[0:2]", "seconds"), repeats=3, truth={SIZE: "5 mm"})
    return weigh_costs(tabulate_study(study, records))


def test_errors_are_the_largest_relative_ones_and_costs_the_medians(points) -> None:
    assert [point.error for point in points] == pytest.approx([0.09, 0.009, 0.02, 0.005])
    assert [point.cpu_seconds for point in points] == [(1.0, 1.0), (4.0, 4.0), (8.0, 8.0), (6.0, 6.0)]
    assert "frequencies_hz[0]" in points[0].worst


def test_best_is_what_nothing_else_beats_in_time_and_error_and_the_automatic_choice_does_not_compete(points) -> None:
    assert [point.best for point in points] == [True, True, False, False]
    assert [point.automatic for point in points] == [False, False, False, True]
    assert [point.cpu_seconds[0] for point in pareto_front(points, "cpu")] == [1.0, 4.0, 6.0]
    assert cheapest_within(points, 0.03) is points[1]
    assert cheapest_within(points, 0.001) is None


def test_the_price_of_the_next_digit_and_of_the_automatic_choice_is_told(points) -> None:
    lines = digit_words(points)
    assert "10 %: tets, column.mesh.size = 40 mm, 1 s of processor time" in lines[0]
    assert "4 times the line above" in lines[1]
    assert "0.1 %: reached by none of these" in lines
    assert "1.5 times the cheapest that is close enough (tets, column.mesh.size = 20 mm)" in lines[-1]
    assert len(cost_table(points).rows) == 4


def test_a_point_that_lacks_a_number_is_off_without_bound_and_stays_out_of_the_picture() -> None:
    records = [make_record(TRUTH, {}, 100.0, 1.0), make_record("tets", {SIZE: "40 mm"}, None, 1.0)]
    study = Study("cost", FAMILIES, ("modal[0].frequencies_hz[0:2]",), truth={})
    points = weigh_costs(tabulate_study(study, records))
    assert points[0].error == math.inf
    assert list_costs(points)["costs"][0]["error"] is None
    assert draw_costs(points, {}) is None


def test_without_a_truth_nothing_is_weighed() -> None:
    failed = StudyRecord("", TRUTH, {}, "failed", error="no memory")
    study = Study("cost", FAMILIES, ("modal[0].frequencies_hz[0:2]",), truth={})
    assert weigh_costs(tabulate_study(study, [failed, make_record("tets", {SIZE: "40 mm"}, 1.0, 1.0)])) == []
