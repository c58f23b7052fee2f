"""Line numbers of keys, against texts that tomllib accepts."""

import tomllib
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from fixture_machines import stored_scene
from headstock.scene.reading.findings import KeyPath
from headstock.scene.reading.positions import find_lines

TEXT = stored_scene("positions")


def test_every_key_has_the_line_it_is_written_in() -> None:
    lines, _ = find_lines(TEXT)
    assert lines["name",] == 1
    assert lines["materials", "steel"] == 3
    assert lines["materials", "steel", "quoted.key"] == 5
    assert lines["materials", "steel", "a", "b", "c", 1] == 6
    assert lines["materials", "steel", "a", "b", "c", 3, "y", 0] == 7
    assert lines["materials", "steel", "when"] == 8
    assert lines["materials", "steel", "literal"] == 12
    assert lines["materials", "steel", "last"] == 15
    assert lines["parts", 1, "k"] == 20
    assert lines["parts", 1, "sub", "m"] == 22


def test_positions_cover_exactly_the_keys_tomllib_finds() -> None:
    assert set(find_lines(TEXT)[0]) == set(_paths(tomllib.loads(TEXT)))


def test_a_repeated_key_is_found_with_both_lines() -> None:
    lines, repeated = find_lines("[a]\nx = 1\ny = 2\nx = 3\n")
    assert lines["a", "x"] == 2
    assert repeated == [(("a", "x"), 4)]


@given(st.text(alphabet="ab.=[]{}\"'#\n, 1", max_size=60))
def test_no_text_stops_the_scanner_and_valid_texts_are_covered(text: str) -> None:
    lines, _ = find_lines(text)
    try:
        parsed = tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        return
    assert set(lines) == set(_paths(parsed))


def _paths(value: Any, prefix: KeyPath = ()) -> list[KeyPath]:
    items = (
        value.items()
        if isinstance(value, dict)
        else enumerate(value)
        if isinstance(value, list)
        else ()
    )
    return [path for key, item in items for path in ((*prefix, key), *_paths(item, (*prefix, key)))]
