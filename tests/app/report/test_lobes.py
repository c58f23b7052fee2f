"""Stability lobes in the report can be read on a narrow screen."""

import re
from typing import get_type_hints

import pytest

from headstock.app.report.lobes import LETTER, SIZE, WIDTH, draw_lobes
from headstock.pipeline.answers.lobes import DirectionSummary, LobeSummary

LONG = "Y translation of y_slider + z_slider on y_carriage_1..4 + y_drive"
TEXT = re.compile(
    r'<text x="([^"]+)" y="[^"]+" font-size="([^"]+)" text-anchor="([^"]+)"[^>]*>(.*?)<'
)
NARROWEST = 368.0  # picture on a page of 400 px
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
        "lowest_any_speed_mm": 0.4,
        "best_speeds": [
            {"rpm": speed, "limit_depth_mm": depths[speeds.index(speed)], "limited": True}
            for speed in best
        ],
        "lobes": [lobe],
        "checks": [],
        "bisected": 0,
        "series": {
            "rpm": speeds,
            "limit_depth_mm": depths,
            "zeroth_order_mm": depths,
            "chatter_hz": [125.0] * len(speeds),
            "lobe": [0] * len(speeds),
        },
    }
    assert set(found) == set(get_type_hints(DirectionSummary))
    return found


@pytest.mark.parametrize("lowest_at", [3000.0, 9000.0, 15000.0])
def test_every_text_is_whole_and_large_enough_for_a_narrow_screen(lowest_at: float) -> None:
    texts = TEXT.findall(str(draw_lobes(make_direction(lowest_at), "lobes")))
    assert any(LONG in words for *_, words in texts)
    for x, size, anchor, words in texts:
        width = LETTER * len(words)
        start = float(x) - {"start": 0.0, "middle": 0.5, "end": 1.0}[anchor] * width
        assert start > -0.5 * LETTER, words
        assert start + width < WIDTH + 0.5 * LETTER, words
        assert float(size) >= SIZE
    assert SIZE * NARROWEST / WIDTH > READABLE
