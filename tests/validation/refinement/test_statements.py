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
from headstock.validation.refinement.statements import EvaluatedStatement, _Statement

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


def modal(kind: ModelKind, quantity: str, deviations: dict[int, float]) -> RefinementSeries:
    return series(kind, quantity, deviations, "modal")


def about(refinement: RefinementSeries, quantity: str = TWIST) -> _Statement:
    return _Statement(refinement, "", [quantity])


def holds(found: EvaluatedStatement | None) -> bool:
    """Whether what is said of a series is confirmed; there has to be something to see."""
    return present(found).confirmed


def test_a_limit_holds_from_the_ndof_it_is_claimed_from() -> None:
    statement = about(series("segmented", TWIST, {12: 0.5, 30: -0.09, 60: 0.01}))
    assert holds(statement.below(0.10, above=30))
    broken = present(statement.below(0.10, above=12))
    assert not broken.confirmed
    assert broken.decides == "dx(Mc) +50 % at nDOF 12 (segmented)"
    assert broken.figure == 6


def test_a_limit_that_a_right_model_cannot_meet_names_the_reference() -> None:
    off = BEAM.references["Y2"].solid / BEAM.references["Y2"].analytic - 1.0
    judged = present(about(modal("hex27", "Y2", {300: off}), "Y2").below(0.15))
    assert not judged.confirmed
    assert "converged 3D elasticity itself lies at -16.04 %" in judged.note
    assert "shear" in judged.note


def test_a_missing_mode_counts_against_a_limit() -> None:
    lacking = about(modal("hex8", "X3", {30: math.nan, 60: 0.01}), "X3")
    assert not holds(lacking.below(0.2))
    assert holds(lacking.coarsest_lacks())
    assert present(lacking.coarsest_lacks()).value is None
    assert not holds(about(modal("hex8", "X3", {60: 0.01}), "X3").coarsest_lacks())


def test_what_stays_above_a_limit_stays_there_in_every_model_of_the_range() -> None:
    statement = about(series("tet4", TWIST, {100: -0.9, 1000: -0.75, 9000: -0.6, 90000: -0.1}))
    assert holds(statement.exceeds(0.7, above=0, below=2000))
    fallen = present(statement.exceeds(0.7, above=0, below=1e4))
    assert not fallen.confirmed
    assert fallen.decides == "dx(Mc) -60 % at nDOF 9000 (tet4); larger before"


def test_what_only_the_coarsest_model_shows_says_where_it_ends() -> None:
    statement = about(series("hex8", TWIST, {100: -0.9, 1000: -0.75, 9000: -0.6}))
    judged = present(statement.coarsest_exceeds(0.7))
    assert judged.confirmed
    assert judged.note == "no longer from nDOF 9000 on"
    assert not holds(about(series("hex8", TWIST, {100: -0.6})).coarsest_exceeds(0.7))


def test_deviations_between_two_limits() -> None:
    assert holds(about(series("tet10", TWIST, {100: -0.3, 1000: 0.13})).between(0.12, 0.40))
    outside = present(about(series("tet10", TWIST, {100: -0.3, 1000: 0.05})).between(0.12, 0.40))
    assert not outside.confirmed
    assert outside.value == approx(0.05)


def test_deviations_that_shrink_grow_or_stay() -> None:
    assert holds(about(series("segmented", TWIST, {12: 0.3, 30: -0.1, 60: 0.05})).shrinks())
    grown = present(about(series("segmented", TWIST, {12: 0.1, 30: -0.13})).shrinks())
    assert not grown.confirmed
    assert grown.value == approx(0.03)
    still = present(about(series("segmented", TWIST, {12: 0.03, 30: 0.03})).shrinks())
    assert still.confirmed
    assert "nothing is left to shrink" in still.note


def test_deviations_that_are_almost_constant_stay_within_a_band() -> None:
    statement = about(series("segmented", TWIST, {12: 0.5, 60: 0.031, 90: 0.030, 420: 0.028}))
    flat = present(statement.constant(0.01, above=60))
    assert flat.confirmed
    assert flat.value == approx(0.003)
    assert not holds(statement.constant(0.002, above=60))
    assert not holds(statement.constant(0.01, above=12))
    assert statement.constant(0.01, above=400) is None, "one model shows nothing"


def test_one_kind_deviates_less_than_another_in_a_range_of_ndof() -> None:
    few = about(modal("segmented", "X2", {30: 0.4, 60: -0.1, 96: 0.05, 150: 0.3}), "X2")
    many = modal("hex8", "X2", {54: 0.2, 90: 0.08})
    assert holds(few.smaller_than(many, above=40, below=100))
    wider = present(few.smaller_than(many, above=40, below=300))
    assert not wider.confirmed
    assert "nDOF 150" in wider.decides
    apart = modal("hex8", "X2", {400: 0.2})
    lone = about(modal("segmented", "X2", {96: 0.05}), "X2")
    assert lone.smaller_than(apart, above=40, below=100) is None
    lacking = about(modal("segmented", "X2", {60: math.nan, 96: 0.01}), "X2")
    assert not holds(lacking.smaller_than(many, above=40, below=100))


def test_two_kinds_of_models_are_compared_at_about_equal_ndof() -> None:
    few = series("segmented", TWIST, {30: 0.2, 100: 0.02})
    many = series("hex8", TWIST, {110: 0.05, 900: 0.01})
    alike = present(about(many).like(few, 0.05, above=100))
    assert alike.confirmed and alike.value == approx(0.03)
    assert not holds(about(many).like(few, 0.02, above=100))
    assert holds(about(few).softer_than(many))
    assert not holds(about(many).softer_than(few))


def test_how_many_times_the_dofs_one_kind_needs() -> None:
    few = series("segmented", TWIST, {12: 0.2, 30: 0.05})
    many = series("hex8", TWIST, {90: 0.3, 900: 0.09, 1800: -0.02})
    assert ndof_within(many, [TWIST], 0.1) == 900
    judged = present(about(many).costlier_than(few, 0.1, least=30.0))
    assert judged.confirmed
    assert judged.value == approx(30.0)
    assert not holds(about(many).costlier_than(few, 0.1, least=31.0))
    beyond = about(series("hex8", TWIST, {90: 0.3, 1200: 0.2}))
    out_of_reach = present(beyond.costlier_than(few, 0.1, least=30.0))
    assert out_of_reach.confirmed
    assert "more than 1200" in out_of_reach.decides


def test_what_is_reached_is_reached_by_the_largest_model() -> None:
    solid = BEAM.references[SHEAR].solid / BEAM.references[SHEAR].analytic - 1.0
    near = series("tet10", SHEAR, {900: 0.5, 9000: solid + 0.001})
    far = series("tet10", SHEAR, {900: solid, 9000: solid + 0.01})
    assert holds(about(near, SHEAR).reaches(3e-3, against="solid"))
    assert not holds(about(far, SHEAR).reaches(3e-3, against="solid"))


CANTILEVER, FIXED = reference_beam("kono-cantilever"), reference_beam("kono-fixed-beam")


def test_the_order_of_modes_is_the_paper_s() -> None:
    modes = [
        [name for name, reference in beam.references.items() if reference.group == "modal"]
        for beam in (CANTILEVER, FIXED)
    ]
    assert modes == [["X1", "Y1", "X2", "T1", "Y2", "X3"], ["X1", "T1", "X2"]]


def test_analytic_values_are_those_of_the_tables() -> None:
    frequencies = reference_case("kono-cantilever-theory").values
    for name in ("X1", "X2", "X3", "Y1", "Y2"):
        reference = CANTILEVER.references[name]
        wanted = [frequencies[f"{theory} {name}"] for theory in ("Euler-Bernoulli", "Timoshenko")]
        assert [reference.analytic, reference.beam] == approx(wanted, rel=1e-5)
    shifts = reference_case("kono-fixed-beam-static-theory").values
    for height in ("0", "100 mm"):
        analytic = FIXED.references[f"dx(Fx), h_F = {height}"].analytic
        assert analytic == approx(shifts[f"dx, h_F={height.replace(' ', '')}"], rel=1e-4)
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
