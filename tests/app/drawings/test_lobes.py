"""Stability lobes in the report can be read on a narrow screen."""

import dataclasses
import re

import numpy as np
import pytest

from headstock.app.drawings.lobes import LETTER, SIZE, WIDTH, draw_lobes
from headstock.geometry.frames import FloatArray
from headstock.pipeline.answers.lobes import DirectionLobes, Lobe, PoseLobes

LONG = "Y translation of y_slider + z_slider on y_carriage_1..4 + y_drive"
TEXT = re.compile(
    r'<text x="([^"]+)" y="[^"]+" font-size="([^"]+)" text-anchor="([^"]+)"[^>]*>(.*?)<'
)
NARROWEST = 368.0  # picture on a page of 400 px
GREEN = 'fill="#6a9a5b" opacity="0.12"'
READABLE = 7.5  # height of a font [px]


def make_lobes(lowest_at: float, *, confirmed: bool = True) -> tuple[PoseLobes, DirectionLobes]:
    rpm: FloatArray = 3000.0 + 1000.0 * np.arange(13.0)
    place, count = int(np.argmin(abs(rpm - lowest_at))), len(rpm)
    direction = DirectionLobes(
        name="x",
        direction=(1.0, 0.0, 0.0),
        depths=1e-3 * (0.5 + 1e-4 * abs(rpm - lowest_at)),
        limited=np.full(count, True),
        zeroth=np.full(count, 5e-4),
        chatter=np.full(count, 2.0 * np.pi * 125.0),
        owner=np.zeros(count, dtype=np.intp),
        lobes=(Lobe(place, 0, count - 1, 1, LONG, 258.0, 0.6, "y_drive"),),
        best=(0, 6, count - 1),
        depth_errors={"mesh": np.full(count, 1.2e-5)},
        chatter_errors={"mesh": np.full(count, 1.2)},
    )
    found = PoseLobes(
        pose="left",
        material="steel",
        radial_depth=1e-3,
        diameter=0.02,
        teeth=2,
        tool="rigid",
        sense="climb",
        up_to_hz=500.0,
        modes_to_hz=500.0,
        deepest=0.01,
        method="multipliers",
        confirmed=confirmed,
        speeds=rpm * (np.pi / 30.0),
        directions=(direction,),
    )
    return found, direction


@pytest.mark.parametrize("lowest_at", [3000.0, 9000.0, 15000.0])
def test_every_text_is_whole_and_large_enough_for_a_narrow_screen(lowest_at: float) -> None:
    texts = TEXT.findall(str(draw_lobes(*make_lobes(lowest_at), "lobes")))
    assert any(LONG in words for *_, words in texts)
    for x, size, anchor, words in texts:
        width = LETTER * len(words)
        start = float(x) - {"start": 0.0, "middle": 0.5, "end": 1.0}[anchor] * width
        assert start > -0.5 * LETTER, words
        assert start + width < WIDTH + 0.5 * LETTER, words
        assert float(size) >= SIZE
    assert SIZE * NARROWEST / WIDTH > READABLE


def test_what_is_not_known_is_hatched_and_never_green() -> None:
    found, direction = make_lobes(9000.0)
    whole = str(draw_lobes(found, direction, "a"))
    assert whole.count(GREEN) == 12 and "url(#a_hatch)" not in whole
    direction.depths[4] = np.nan
    part = str(draw_lobes(found, direction, "a"))
    assert part.count(GREEN) == 10 and part.count("url(#a_hatch)") == 2
    assert "hatched: nothing is known" in part
    none = str(draw_lobes(dataclasses.replace(found, confirmed=False), direction, "a"))
    assert GREEN not in none and none.count("url(#a_hatch)") == 12
