"""The suite that says how often ± covers the truth."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from common import approx, present
from headstock.validation.coverage import cases
from headstock.validation.coverage.cases import (
    ADAPTED_PARTS,
    CALIBRATION,
    HEX_CALIBRATION,
    HEX_HOLD_OUT,
    HOLD_OUT,
    _measure_part,
    _PartCoverage,
)
from headstock.validation.coverage.parts import ADAPTED_KINDS, HEX_KINDS, KINDS, draw_part
from headstock.validation.coverage.search_cases import (
    ASKED,
    FRESH_PARTS,
    PARTS,
    SMOKE_PARTS,
    _evaluate_searches,
    _find_truth,
    _make_scene,
    _search_part,
    _SlenderTruth,
)
from headstock.validation.references.rows import ValidationRow


def made_up(
    seed: int, errors: list[float], estimates: list[float], lines: list[float]
) -> _PartCoverage:
    numbers = (np.zeros(len(errors)), np.array(errors), np.array(estimates))
    return _PartCoverage(seed, "block", *numbers, np.full(len(errors), 1e-6), np.array(lines))


def judged(parts: list[_PartCoverage]) -> dict[str, ValidationRow]:
    return {row.quantity.split(": ")[1]: row for row in cases._evaluate("some", parts)}


@pytest.mark.parametrize(
    ("one", "other", "kinds"),
    [(CALIBRATION, HOLD_OUT, KINDS), (HEX_CALIBRATION, HEX_HOLD_OUT, HEX_KINDS)],
    ids=["parts", "hexahedra"],
)
def test_every_kind_of_part_is_in_both_halves_which_share_none(
    one: Sequence[int], other: Sequence[int], kinds: Sequence[object]
) -> None:
    assert not set(one) & set(other)
    for half in (one, other):
        assert {seed % len(kinds) for seed in half} == set(range(len(kinds)))


@pytest.mark.parametrize("seed", range(HEX_HOLD_OUT[0], HEX_HOLD_OUT[0] + len(HEX_KINDS)))
def test_hexahedra_between_patches_are_coarse_and_then_finer(tmp_path: Path, seed: int) -> None:
    coarse, finer = draw_part(seed, tmp_path).meshes
    assert coarse.cells == finer.cells == "hex"
    assert (coarse.across_patches, finer.across_patches) == (2, 4)
    assert present(finer.size) < present(coarse.size)


@pytest.mark.parametrize("seed", ADAPTED_PARTS[: len(ADAPTED_KINDS)])
def test_adapted_parts_begin_with_one_coarse_mesh_of_tetrahedra_and_follow_its_errors(
    tmp_path: Path, seed: int
) -> None:
    part = draw_part(seed, tmp_path)
    (start,) = part.meshes
    assert start.cells == "tet" and start.sizes is None
    assert present(part.reference.size) < 0.3 * present(start.size)
    assert part.rounds == 2


def test_a_seed_draws_the_same_part_again(tmp_path: Path) -> None:
    one, other = (draw_part(20, tmp_path) for _ in range(2))
    first, second = (drawn.machine.components["part"] for drawn in (one, other))
    assert (first.solid, first.interfaces) == (second.solid, second.interfaces)
    assert one.meshes == other.meshes


def test_coverage_counts_numbers_parts_and_lines() -> None:
    good = made_up(0, [1e-2] * 20, [2e-2] * 20, [1.0, 0.96])
    poor = made_up(1, [1e-2] * 10, [2e-2] * 8 + [5e-3, np.nan], [0.9, 0.2])
    rows = judged([good, poor])
    missed = rows["share of numbers that ± does not cover"]
    assert missed.value == approx(1.0 / 29.0) and missed.passed
    assert "1 say ± ?" in missed.note
    assert rows["coverage by part, mean"].value == approx((1.0 + 8.0 / 9.0) / 2.0)
    assert rows["parts with 95 % of their numbers covered"].value == 0.5
    assert rows["± over true error, median"].value == approx(2.0)
    assert not rows["share of frequency responses without 95 % of their lines covered"].passed


def test_a_part_is_covered_on_its_meshes(tmp_path: Path) -> None:
    part = draw_part(27, tmp_path)
    found = _measure_part(dataclasses.replace(part, meshes=part.meshes[:1]))
    assert found.failure == ""
    assert len(found.errors) == 11
    assert (found.errors <= found.estimates).mean() >= 0.9
    assert (found.lines > 0.9).all()


# of the elliptical ring, from swept grids of hexahedra with 27 nodes (_find_truth)
TRUTH = np.array([1026.16, 1129.80, 1682.43, 1758.13])


def test_twenty_parts_have_names_of_their_own() -> None:
    assert len({part.name for part in (*PARTS, *FRESH_PARTS)}) == 20


def test_a_ring_whose_walls_single_tets_fill_is_met_by_a_second_mesh_only(tmp_path: Path) -> None:
    ring = dataclasses.replace(FRESH_PARTS[0], up_to_hz=1900.0)
    # the first mesh, which called it met, is 1.4 % above
    truth = _SlenderTruth(TRUTH, np.zeros(len(TRUTH)))
    found = _search_part(ring, _make_scene(ring, tmp_path), truth)
    assert found.met
    assert len(found.errors) == len(TRUTH)
    assert found.errors.max() < 0.2 * ASKED
    assert (found.errors < found.given).all()


@pytest.mark.trials
def test_searches_of_two_parts_are_met_and_covered(tmp_path: Path) -> None:
    found = []
    for part in SMOKE_PARTS:
        coarse = dataclasses.replace(part, up_to_hz=0.6 * part.up_to_hz)
        scene = _make_scene(coarse, tmp_path)
        found.append(_search_part(coarse, scene, _find_truth(coarse)))
    rows = _evaluate_searches("", found)
    assert [row.passed for row in rows[:3]] == [True, True, True]
