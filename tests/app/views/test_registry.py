"""Every analysis that a summary may hold is shown, or is known to be shown elsewhere."""

import pytest

from headstock.app.views.registry import NAMES, find_views, load_view
from headstock.app.views.view import FinishedRun, View
from headstock.pipeline.results.summary import list_entry_types

# of the run as a whole, of several poses of another entry, and what only files hold
OTHER_ENTRIES = {
    *("format", "name", "status", "versions", "stages", "totals", "components", "warnings"),
    *("failures", "assumptions", "files", "provenance", "static_poses", "mechanism"),
}


@pytest.mark.parametrize("name", NAMES)
def test_a_name_of_the_registry_has_a_view(name: str) -> None:
    assert isinstance(load_view(name), View)


def test_what_a_summary_may_hold_has_a_view() -> None:
    assert {*list_entry_types()} - OTHER_ENTRIES == {*NAMES}


def test_an_empty_entry_has_no_view() -> None:
    run = FinishedRun({"static": {}, "modal": [], "accuracy": {"asked": 0.1}})  # type: ignore[typeddict-item,typeddict-unknown-key]
    assert [*map(id, find_views(run))] == [id(load_view("accuracy"))]
