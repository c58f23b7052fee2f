"""Stability lobes in the report can be read on a narrow screen."""

import re
from typing import get_type_hints

import pytest

from headstock.app.drawings.lobes import LETTER, SIZE, WIDTH, draw_lobes
from headstock.pipeline.answers.lobes import DirectionSummary, LobeSummary

LONG = "Y translation of y_slider + z_slider on y_carriage_1..4 + y_drive"
TEXT = re.compile(
    r'<text x="([^"]+)" y="[^"]+" font-size="([^"]+)" text-anchor="([^"]+)"[^>]*>(.*?)<'
)
NARROWEST = 368.0  # picture on a page of 400 px
GREEN = 'fill="#6a9a5b" opacity="0.12"'
READABLE = 7.5  # height of a font [px]


def make_direction(lowest_at: float) -> DirectionSummary:
    lobe: LobeSummary = {
        "rpm": lowest_at,
        "limit_depth_mm": 0.5,
        "chatter_hz": 125.0,
        "waves": 1,
        "from_rpm": 3000.0,
        "to_rpm": 15000.0,
        "mode": LONG,
        "mode_hz": 258.0,
        "mode_share": 0.6,
        "part": "y_drive",
    }
    speeds = [3000.0 + 1000.0 * number for number in range(13)]
    depths = [0.5 + 1e-4 * abs(speed - lowest_at) for speed in speeds]
    best = [speeds[0], speeds[6], speeds[-1]]
    found: DirectionSummary = {
        "direction": [1.0, 0.0, 0.0],
        "name": "x",
        "lowest": lobe,
        "lowest_error_mm": 0.012,
        "lowest_error_share": {},
        "chatter_error_hz": 1.2,
        "chatter_error_share": {},
        "error_left_out": [],
        "best_speeds": [
            {
                "rpm": speed,
                "limit_depth_mm": depths[speeds.index(speed)],
                "error_mm": 0.012,
                "limited": True,
            }
            for speed in best
        ],
        "lobes": [lobe],
        "series": {
            "rpm": speeds,
            "limit_depth_mm": list(depths),
            "error_mm": [0.012] * len(speeds),
            "limited": [True] * len(speeds),
            "zeroth_order_mm": depths,
            "chatter_hz": [125.0] * len(speeds),
            "lobe": [0] * len(speeds),
        },
    }
    assert set(found) == set(get_type_hints(DirectionSummary))
    return found


@pytest.mark.parametrize("lowest_at", [3000.0, 9000.0, 15000.0])
def test_every_text_is_whole_and_large_enough_for_a_narrow_screen(lowest_at: float) -> None:
    texts = TEXT.findall(str(draw_lobes(make_direction(lowest_at), "lobes", confirmed=True)))
    assert any(LONG in words for *_, words in texts)
    for x, size, anchor, words in texts:
        width = LETTER * len(words)
        start = float(x) - {"start": 0.0, "middle": 0.5, "end": 1.0}[anchor] * width
        assert start > -0.5 * LETTER, words
        assert start + width < WIDTH + 0.5 * LETTER, words
        assert float(size) >= SIZE
    assert SIZE * NARROWEST / WIDTH > READABLE


def test_what_is_not_known_is_hatched_and_never_green() -> None:
    found = make_direction(9000.0)
    whole = str(draw_lobes(found, "a", confirmed=True))
    assert whole.count(GREEN) == 12 and "url(#a_hatch)" not in whole
    found["series"]["limit_depth_mm"][4] = None
    part = str(draw_lobes(found, "a", confirmed=True))
    assert part.count(GREEN) == 10 and part.count("url(#a_hatch)") == 2
    assert "hatched: nothing is known" in part
    none = str(draw_lobes(found, "a", confirmed=False))
    assert GREEN not in none and none.count("url(#a_hatch)") == 12
