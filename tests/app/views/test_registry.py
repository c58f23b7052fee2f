"""Every analysis that a summary may hold is shown, or is known to be shown elsewhere."""

import pytest
from made_results import make_results

from headstock.app.views.registry import NAMES, find_views, load_view
from headstock.app.views.view import View
from headstock.pipeline.answers.accuracy import AccuracyAnswer, AccuracyRound
from headstock.pipeline.results.summary_keys import list_summary_keys

# of the run as a whole, of several poses of another entry, and what only files hold
OTHER_ENTRIES = {
    *("format", "name", "status", "versions", "stages", "totals", "components", "warnings"),
    *("failures", "assumptions", "files", "provenance", "static_poses", "mechanism", "guards"),
}


@pytest.mark.parametrize("name", NAMES)
def test_a_name_of_the_registry_has_a_view(name: str) -> None:
    assert isinstance(load_view(name), View)


def test_what_a_summary_may_hold_has_a_view() -> None:
    assert {*list_summary_keys()} - OTHER_ENTRIES == {*NAMES}


def test_an_analysis_without_an_answer_has_no_view() -> None:
    run = make_results(AccuracyAnswer(0.1, (AccuracyRound("frequency 1", 0.05, ""),), {}))
    assert [*map(id, find_views(run))] == [id(load_view("accuracy"))]
