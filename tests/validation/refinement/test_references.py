import pytest

from common import approx
from headstock.validation.references.rows import reference_case
from headstock.validation.refinement.references import ReferenceBeam, reference_beam

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
