import pytest
from hypothesis import given
from hypothesis import strategies as st

from cases import cases
from headstock.scene.reading.watch_paths import WatchError, parse_watch, read_watch

SUMMARY = {
    "status": "done",
    "static": {
        "tcp": {"compliance_um_per_kN": [[1.0, 2.0], [3.0, 4.0]]},
        "far end": {"text": "soft"},
    },
    "modal": [
        {"pose_name": "left", "frequencies_hz": [10.0, 20.0, 30.0], "rigid_count": 0},
        {"pose_name": "right", "frequencies_hz": [11.0, 21.0, 31.0], "rigid_count": 0},
    ],
}


@cases
def test_a_path_leads_to_its_values_each_under_a_path_of_its_own(
    path: str, found: dict[str, float | str]
) -> None:
    assert read_watch(parse_watch(path), SUMMARY) == found


@pytest.mark.parametrize(
    "path",
    ["", "modl.frequencies_hz", "modal.frequencies_hz[", "modal..x", ".modal", "[0]", "modal.frequencies_hz[a]", "__import__('os')",
     "modal.frequencies_hz[0:6:2]", "modal x", "status.__class__()", 'static."tcp', "modal.(1)", "static" + ".a" * 50],
)  # fmt: skip
def test_what_is_no_path_is_refused(path: str) -> None:
    with pytest.raises(WatchError):
        parse_watch(path)


@cases
def test_a_path_that_leads_nowhere_says_where_it_ends(path: str, words: str) -> None:
    with pytest.raises(WatchError) as caught:
        read_watch(parse_watch(path), SUMMARY)
    assert words in str(caught.value)


@given(st.text(max_size=60))
def test_any_text_is_a_path_or_refused_by_name(text: str) -> None:
    try:
        path = parse_watch(text)
    except WatchError:
        return
    assert path.steps
    try:
        read_watch(path, SUMMARY)
    except WatchError:
        return
