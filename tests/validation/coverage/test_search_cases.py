"""The suite of searches on slender parts, on two coarse ones."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from headstock.validation.coverage.search_cases import (
    ASKED,
    FRESH_PARTS,
    PARTS,
    SMOKE_PARTS,
    SlenderTruth,
    evaluate_searches,
    find_truth,
    make_scene,
    search_part,
)

# of the elliptical ring, from swept grids of hexahedra with 27 nodes (find_truth)
TRUTH = np.array([1026.16, 1129.80, 1682.43, 1758.13])


def test_twenty_parts_have_names_of_their_own() -> None:
    assert len({part.name for part in (*PARTS, *FRESH_PARTS)}) == 20


def test_a_ring_whose_walls_single_tets_fill_is_met_by_a_second_mesh_only(tmp_path: Path) -> None:
    ring = dataclasses.replace(FRESH_PARTS[0], up_to_hz=1900.0)
    # the first mesh, which called it met, is 1.4 % above
    truth = SlenderTruth(TRUTH, np.zeros(len(TRUTH)))
    found = search_part(ring, make_scene(ring, tmp_path), truth)
    assert found.met
    assert len(found.errors) == len(TRUTH)
    assert found.errors.max() < 0.2 * ASKED
    assert (found.errors < found.given).all()


@pytest.mark.trials
def test_searches_of_two_parts_are_met_and_covered(tmp_path: Path) -> None:
    found = []
    for part in SMOKE_PARTS:
        coarse = dataclasses.replace(part, up_to_hz=0.6 * part.up_to_hz)
        scene = make_scene(coarse, tmp_path)
        found.append(search_part(coarse, scene, find_truth(coarse)))
    rows = evaluate_searches(found)
    assert [row.passed for row in rows[:3]] == [True, True, True]
