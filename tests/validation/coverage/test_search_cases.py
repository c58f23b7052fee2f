"""The suite of searches on slender parts, on two coarse ones."""

import dataclasses
from pathlib import Path

import pytest

from headstock.validation.coverage.search_cases import (
    PARTS,
    SMOKE_PARTS,
    find_truth,
    judge_searches,
    make_scene,
    search_part,
)


def test_twelve_parts_have_names_of_their_own() -> None:
    assert len({part.name for part in PARTS}) == 12


@pytest.mark.trials
def test_searches_of_two_parts_are_met_and_covered(tmp_path: Path) -> None:
    found = []
    for part in SMOKE_PARTS:
        coarse = dataclasses.replace(part, up_to_hz=0.6 * part.up_to_hz)
        scene = make_scene(coarse, tmp_path)
        found.append(search_part(coarse, scene, find_truth(coarse)))
    rows = judge_searches("search", found)
    assert [row.passed for row in rows[:3]] == [True, True, True]
