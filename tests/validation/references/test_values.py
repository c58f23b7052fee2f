"""Claims about the table of reference values."""

import math

import pytest

from headstock.validation.references.rows import _reference_cases, reference_case


def test_every_case_has_a_source_a_trap_a_tolerance_and_finite_values() -> None:
    assert len(_reference_cases()) > 13
    for case in _reference_cases().values():
        assert case.source and case.traps and case.description and case.id
        assert 0.0 < case.tolerance < 1.0
        assert case.values and all(
            math.isfinite(value) and value != 0.0 for value in case.values.values()
        )
        assert case.provenance in ("published", "derived-closed-form", "derived-numerical")


def test_every_benchmark_of_the_acceptance_list_is_there() -> None:
    ids = {case.id for case in _reference_cases().values()}
    seeds = {f"SEED-{name}" for name in ("CANT-3D", "CANT-BEAM", "CANT-STATIC", "TORSION-J")}
    seeds |= {"SEED-FIXED-3D", "SEED-FIXED-STATIC"}
    derived = {"DER-BLOCK", "DER-FREE", "DER-SQCOL", "DER-ROD-NU0"}
    assert seeds | derived | {"NAFEMS-FV5", "MH-STRAIGHT", "NAFEMS-LE10", "ASTER-SDLL02"} <= ids


def test_an_unknown_case_is_refused() -> None:
    with pytest.raises(KeyError):
        reference_case("no such case")
