"""Keys of a summary are read from their texts, and watched paths are followed along them."""

import pytest

from headstock.pipeline.results.summary_keys import _parse_keys, list_summary_keys
from headstock.scene.reading.watch_paths import parse_watch
from headstock.studies.parameters.runs import _find_fault


def test_keys_are_read_with_what_they_hold() -> None:
    assert _parse_keys("a b[](c d.*) e.** f[][]") == {
        "a": None,
        "b": ("[]", {"c": None, "d": (".*", None)}),
        "e": (".**", None),
        "f": ("[]", ("[]", None)),
    }


@pytest.mark.parametrize(
    ("path", "fault"),
    [
        ("modal.frequencies_hz[0]", ""),
        ("map.quantities.f1_hz[0][1]", ""),
        ("frf.rest.error.bounded_to_hz", ""),
        ("stages.seconds", "stages is a list; write stages[0]"),
        ("static.tcp.text.x", "static.tcp.text is a single value, without 'x'"),
        ("path.start", "path.start is a table; name one of its entries"),
    ],
)
def test_a_path_is_followed_to_a_number(path: str, fault: str) -> None:
    assert _find_fault(parse_watch(path).steps, list_summary_keys(), "", {"rest"}) == fault
