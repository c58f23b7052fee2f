"""Statements are judged by the numbers of a series: small series whose verdicts are known
beforehand.
"""

import math

import pytest

from common import approx, present
from headstock.validation.references.rows import reference_case
from headstock.validation.refinement.points import (
    ModelKind,
    RefinementPoint,
    RefinementSeries,
    ndof_within,
    pick_series,
)
from headstock.validation.refinement.references import Group, ReferenceBeam, reference_beam
from headstock.validation.refinement.statements import _Statement

BEAM = reference_beam("kono-cantilever")
TWIST, SHEAR = "dx(Mc)", "dy(Fy)"


def series(
    kind: ModelKind, quantity: str, deviations: dict[int, float], group: Group = "static"
) -> RefinementSeries:
    """A series of one quantity with given deviations from the analytic value by nDOF."""
    right = BEAM.references[quantity].analytic
    points = [
        RefinementPoint(
            kind,
            ndof,
            group,
            {} if math.isnan(off) else {quantity: right * (1.0 + off)},
            {quantity: 0.9},
            1.0,
            1.0,
        )
        for ndof, off in deviations.items()
    ]
    return pick_series(BEAM, points, group, kind)


def test_a_limit_holds_from_the_ndof_it_is_claimed_from() -> None:
    refinement = series("segmented", TWIST, {12: 0.5, 30: -0.09, 60: 0.01})
    assert present(_Statement(refinement, "", [TWIST]).below(0.10, above=30)).confirmed
    broken = present(_Statement(refinement, "", [TWIST]).below(0.10, above=12))
    assert not broken.confirmed
    assert broken.decides == "dx(Mc) +50 % at nDOF 12 (segmented)"
    assert broken.figure == 6


def test_a_limit_that_a_right_model_cannot_meet_names_the_reference() -> None:
    off = BEAM.references["Y2"].solid / BEAM.references["Y2"].analytic - 1.0
    judged = present(_Statement(series("hex27", "Y2", {300: off}, "modal"), "", ["Y2"]).below(0.15))
    assert not judged.confirmed
    assert "converged 3D elasticity itself lies at -16.04 %" in judged.note
    assert "shear" in judged.note


def test_a_missing_mode_counts_against_a_limit() -> None:
    assert not present(
        _Statement(series("hex8", "X3", {30: math.nan, 60: 0.01}, "modal"), "", ["X3"]).below(0.2)
    ).confirmed
    missing = present(
        _Statement(
            series("hex8", "X3", {30: math.nan, 60: 0.01}, "modal"), "", ["X3"]
        ).coarsest_lacks()
    )
    assert missing.confirmed
    assert missing.value is None
    assert not present(
        _Statement(series("hex8", "X3", {60: 0.01}, "modal"), "", ["X3"]).coarsest_lacks()
    ).confirmed


def test_what_stays_above_a_limit_stays_there_in_every_model_of_the_range() -> None:
    refinement = series("tet4", TWIST, {100: -0.9, 1000: -0.75, 9000: -0.6, 90000: -0.1})
    assert present(_Statement(refinement, "", [TWIST]).exceeds(0.7, above=0, below=2000)).confirmed
    fallen = present(_Statement(refinement, "", [TWIST]).exceeds(0.7, above=0, below=1e4))
    assert not fallen.confirmed
    assert fallen.decides == "dx(Mc) -60 % at nDOF 9000 (tet4); larger before"


def test_what_only_the_coarsest_model_shows_says_where_it_ends() -> None:
    judged = present(
        _Statement(
            series("hex8", TWIST, {100: -0.9, 1000: -0.75, 9000: -0.6}), "", [TWIST]
        ).coarsest_exceeds(0.7)
    )
    assert judged.confirmed
    assert judged.note == "no longer from nDOF 9000 on"
    assert not present(
        _Statement(series("hex8", TWIST, {100: -0.6}), "", [TWIST]).coarsest_exceeds(0.7)
    ).confirmed


def test_deviations_between_two_limits() -> None:
    assert present(
        _Statement(series("tet10", TWIST, {100: -0.3, 1000: 0.13}), "", [TWIST]).between(0.12, 0.40)
    ).confirmed
    outside = present(
        _Statement(series("tet10", TWIST, {100: -0.3, 1000: 0.05}), "", [TWIST]).between(0.12, 0.40)
    )
    assert not outside.confirmed
    assert outside.value == approx(0.05)


def test_deviations_that_shrink_grow_or_stay() -> None:
    assert present(
        _Statement(series("segmented", TWIST, {12: 0.3, 30: -0.1, 60: 0.05}), "", [TWIST]).shrinks()
    ).confirmed
    grown = present(
        _Statement(series("segmented", TWIST, {12: 0.1, 30: -0.13}), "", [TWIST]).shrinks()
    )
    assert not grown.confirmed
    assert grown.value == approx(0.03)
    still = present(
        _Statement(series("segmented", TWIST, {12: 0.03, 30: 0.03}), "", [TWIST]).shrinks()
    )
    assert still.confirmed
    assert "nothing is left to shrink" in still.note


def test_deviations_that_are_almost_constant_stay_within_a_band() -> None:
    refinement = series("segmented", TWIST, {12: 0.5, 60: 0.031, 90: 0.030, 420: 0.028})
    flat = present(_Statement(refinement, "flat", [TWIST]).constant(0.01, above=60))
    assert flat.confirmed
    assert flat.value == approx(0.003)
    assert not present(_Statement(refinement, "flat", [TWIST]).constant(0.002, above=60)).confirmed
    assert not present(_Statement(refinement, "flat", [TWIST]).constant(0.01, above=12)).confirmed
    assert _Statement(refinement, "flat", [TWIST]).constant(0.01, above=400) is None, (
        "one model shows nothing"
    )


def test_one_kind_deviates_less_than_another_in_a_range_of_ndof() -> None:
    few, many = (
        series("segmented", "X2", {30: 0.4, 60: -0.1, 96: 0.05, 150: 0.3}, "modal"),
        series("hex8", "X2", {54: 0.2, 90: 0.08}, "modal"),
    )
    assert present(_Statement(few, "", ["X2"]).smaller_than(many, above=40, below=100)).confirmed
    wider = present(_Statement(few, "", ["X2"]).smaller_than(many, above=40, below=300))
    assert not wider.confirmed
    assert "nDOF 150" in wider.decides
    assert (
        _Statement(series("segmented", "X2", {96: 0.05}, "modal"), "", ["X2"]).smaller_than(
            series("hex8", "X2", {400: 0.2}, "modal"), above=40, below=100
        )
        is None
    )
    lacking = series("segmented", "X2", {60: math.nan, 96: 0.01}, "modal")
    assert not present(
        _Statement(lacking, "", ["X2"]).smaller_than(many, above=40, below=100)
    ).confirmed


def test_two_kinds_of_models_are_compared_at_about_equal_ndof() -> None:
    few, many = (
        series("segmented", TWIST, {30: 0.2, 100: 0.02}),
        series("hex8", TWIST, {110: 0.05, 900: 0.01}),
    )
    assert present(_Statement(many, "", [TWIST]).like(few, 0.05, above=100)).confirmed
    assert present(_Statement(many, "", [TWIST]).like(few, 0.05, above=100)).value == approx(0.03)
    assert not present(_Statement(many, "", [TWIST]).like(few, 0.02, above=100)).confirmed
    assert present(_Statement(few, "", [TWIST]).softer_than(many)).confirmed
    assert not present(_Statement(many, "", [TWIST]).softer_than(few)).confirmed


def test_how_many_times_the_dofs_one_kind_needs() -> None:
    few, many = (
        series("segmented", TWIST, {12: 0.2, 30: 0.05}),
        series("hex8", TWIST, {90: 0.3, 900: 0.09, 1800: -0.02}),
    )
    assert ndof_within(many, [TWIST], 0.1) == 900
    judged = present(_Statement(many, "", [TWIST]).costlier_than(few, 0.1, least=30.0))
    assert judged.confirmed
    assert judged.value == approx(30.0)
    never = present(_Statement(many, "", [TWIST]).costlier_than(few, 0.1, least=31.0))
    assert not never.confirmed
    out_of_reach = present(
        _Statement(series("hex8", TWIST, {90: 0.3, 1200: 0.2}), "", [TWIST]).costlier_than(
            few, 0.1, least=30.0
        )
    )
    assert out_of_reach.confirmed
    assert "more than 1200" in out_of_reach.decides


def test_what_is_reached_is_reached_by_the_largest_model() -> None:
    solid = BEAM.references[SHEAR].solid / BEAM.references[SHEAR].analytic - 1.0
    assert present(
        _Statement(series("tet10", SHEAR, {900: 0.5, 9000: solid + 0.001}), "", [SHEAR]).reaches(
            3e-3, against="solid"
        )
    ).confirmed
    assert not present(
        _Statement(series("tet10", SHEAR, {900: solid, 9000: solid + 0.01}), "", [SHEAR]).reaches(
            3e-3, against="solid"
        )
    ).confirmed


CANTILEVER, FIXED = reference_beam("kono-cantilever"), reference_beam("kono-fixed-beam")


def test_the_order_of_modes_is_the_paper_s() -> None:
    assert [name for name, r in CANTILEVER.references.items() if r.group == "modal"] == [
        "X1",
        "Y1",
        "X2",
        "T1",
        "Y2",
        "X3",
    ]
    assert [name for name, r in FIXED.references.items() if r.group == "modal"] == [
        "X1",
        "T1",
        "X2",
    ]


def test_analytic_values_are_those_of_the_tables() -> None:
    frequencies = reference_case("kono-cantilever-theory").values
    for name in ("X1", "X2", "X3", "Y1", "Y2"):
        assert CANTILEVER.references[name].analytic == approx(
            frequencies[f"Euler-Bernoulli {name}"], rel=1e-5
        )
        assert CANTILEVER.references[name].beam == approx(
            frequencies[f"Timoshenko {name}"], rel=1e-5
        )
    shifts = reference_case("kono-fixed-beam-static-theory").values
    assert FIXED.references["dx(Fx), h_F = 0"].analytic == approx(shifts["dx, h_F=0"], rel=1e-4)
    assert FIXED.references["dx(Fx), h_F = 100 mm"].analytic == approx(
        shifts["dx, h_F=100mm"], rel=1e-4
    )
    # printed with the table's source: |dz| 1.480 um
    assert FIXED.references["dz(Fx), h_F = 100 mm"].analytic == approx(1.480, rel=1e-3)


@pytest.mark.parametrize("beam", [CANTILEVER, FIXED], ids=lambda beam: beam.name)
def test_where_the_analytic_value_is_more_than_a_per_cent_off_the_reason_is_given(
    beam: ReferenceBeam,
) -> None:
    assert beam.references
    for reference in beam.references.values():
        assert reference.solid > 0.0
        assert reference.note or abs(reference.solid / reference.analytic - 1.0) < 0.01
