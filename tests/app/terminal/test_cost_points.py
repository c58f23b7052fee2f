"""Errors of a study's points against its truth, and which of them are worth their cost."""

import dataclasses
import math

import pytest

from common import approx
from headstock.app.charts.study import draw_costs
from headstock.app.terminal.study import cost_table, digit_words, list_costs
from headstock.scene.reading.files import TomlValue
from headstock.scene.studies import REFERENCE_RUN, Study, StudyFamily
from headstock.studies.parameters.costs import CostPoint, cheapest_within, pareto_front, weigh_costs
from headstock.studies.parameters.records import StudyRecord
from headstock.studies.parameters.tables import tabulate_study

SIZE = "components.column.mesh.size"
FAMILIES = (
    StudyFamily(REFERENCE_RUN, "reference run", {}, {}),
    StudyFamily("tets", "tets", {}, {SIZE: ("40 mm", "20 mm", "10 mm")}),
    StudyFamily("automatic", "automatic", {}, {"accuracy": ("1 %",)}),
    StudyFamily("rigid_tip", "rigid tip", {}, {SIZE: ("40 mm", "10 mm")}, other_model=True),
)


def make_record(
    family: str, varied: dict[str, TomlValue], hz: float | None, seconds: float, **more: object
) -> StudyRecord:
    modes = [] if hz is None else [hz, 200.0]
    kinds = (("mesh", 0.5), ("reduce", 0.2), ("modal", 0.1))
    summary = {
        "modal": [{"pose_name": "reference", "frequencies_hz": modes}],
        "totals": {"peak_rss_mb": 100.0, "full_dofs": 3000},
        "stages": [{"stage": kind, "cpu_seconds": share * seconds} for kind, share in kinds],
        **more,
    }
    times = (seconds, 1.5 * seconds, 0.5 * seconds)
    record = StudyRecord("", family, varied, "done", summary=summary)
    peak_mb = () if family == "automatic" else (50.0, 70.0)
    return dataclasses.replace(record, seconds=times, cpu_seconds=times, peak_mb=peak_mb)


def weigh(records: list[StudyRecord], **more: object) -> list[CostPoint]:
    study = Study("cost", FAMILIES, ("modal[0].frequencies_hz[0:2]",), reference_run={})
    return weigh_costs(tabulate_study(dataclasses.replace(study, **more), records))  # type: ignore[arg-type]


@pytest.fixture
def points() -> list[CostPoint]:
    records = [
        make_record(REFERENCE_RUN, {}, 100.0, 50.0),
        make_record("tets", {SIZE: "40 mm"}, 109.0, 1.0),
        make_record("tets", {SIZE: "20 mm"}, 100.9, 4.0),
        make_record("tets", {SIZE: "10 mm"}, 102.0, 8.0),
        make_record("automatic", {"accuracy": "1 %"}, 100.5, 6.0, accuracy={"requested": 0.01}),
        make_record("rigid_tip", {SIZE: "40 mm"}, 104.0, 0.1),
        make_record("rigid_tip", {SIZE: "10 mm"}, 100.1, 0.2),
    ]
    watch = ("modal[0].frequencies_hz[0:2]", "seconds")
    return weigh(records, watch=watch, repeats=3, reference_run={SIZE: "5 mm"})


def test_errors_are_the_largest_relative_ones_and_costs_the_medians(
    points: list[CostPoint],
) -> None:
    assert [point.error for point in points[:4]] == approx([0.09, 0.009, 0.02, 0.005])
    assert [point.cpu_seconds for point in points[:4]] == [(s, s) for s in (1.0, 4.0, 8.0, 6.0)]
    assert points[1].solve_seconds == approx(0.3 * 4.0)
    memory = [(point.memory_mb, point.memory_known) for point in points[2:4]]
    assert memory == [(70.0, True), (100.0, False)]
    assert "frequencies_hz[0]" in points[0].worst


def test_best_is_what_nothing_else_beats_in_time_and_error_and_the_automatic_choice_does_not_compete(
    points: list[CostPoint],
) -> None:
    assert [point.best for point in points[:4]] == [True, True, False, False]
    assert [point.automatic for point in points[:4]] == [False, False, False, True]
    assert [point.cpu_seconds[0] for point in pareto_front(points[:4], "cpu")] == [1.0, 4.0, 6.0]
    assert cheapest_within(points, 0.03) is points[1]
    assert cheapest_within(points, 0.001) is None


def test_the_price_of_the_next_digit_and_of_the_automatic_choice_is_told(
    points: list[CostPoint],
) -> None:
    lines = digit_words(points)
    assert "10 %: tets, column.mesh.size = 40 mm (9 %), 1 s of processor time" in lines[0]
    price = "4 s of processor time, 4 times the line above"
    assert lines[1] == f"3 %: tets, column.mesh.size = 20 mm (0.9 %), {price}"
    assert lines[2] == "1 %: the same"
    assert "0.1 %: reached by none of these" in lines
    cheapest = "1.5 times the cheapest that is close enough (tets, column.mesh.size = 20 mm)"
    assert any(cheapest in line for line in lines)
    assert len(cost_table(points).rows) == 6


def test_another_model_is_a_spread_and_competes_with_none(points: list[CostPoint]) -> None:
    rigid = [point for point in points if point.other_model]
    names = [f"rigid tip, column.mesh.size = {size} mm" for size in (40, 10)]
    assert [point.name for point in rigid] == names
    assert not any(point.best for point in rigid)
    assert cheapest_within(points, 0.001) is None  # though the finer one of them is that close
    assert "a spread that no finer mesh takes away" in digit_words(points)[-1]
    assert draw_costs(points, {"rigid_tip": "rigid tip"}) is not None


def test_a_point_that_lacks_a_number_is_off_without_bound_and_stays_out_of_the_picture() -> None:
    coarse = make_record("tets", {SIZE: "40 mm"}, None, 1.0)
    points = weigh([make_record(REFERENCE_RUN, {}, 100.0, 1.0), coarse])
    assert points[0].error == math.inf
    assert list_costs(points)[0]["error"] is None
    assert draw_costs(points, {}) is None


def test_without_a_truth_nothing_is_weighed() -> None:
    failed = StudyRecord("", REFERENCE_RUN, {}, "failed", error="no memory")
    assert weigh([failed, make_record("tets", {SIZE: "40 mm"}, 1.0, 1.0)]) == []
