"""Claims about selecting and running validation cases."""

import pytest
from mpi4py import MPI

from headstock.geometry.errors import HeadstockError
from headstock.validation import case_registry
from headstock.validation.case_registry import (
    CASES,
    Case,
    SeedError,
    UnknownCaseError,
    _group_names,
    _select_cases,
    run_validation,
)
from headstock.validation.coverage.cases import CALIBRATION, HOLD_OUT
from headstock.validation.machines.axes_estimate_cases import HELD_OUT, LOOKED_AT, SEEDS
from headstock.validation.machines.model_choice_cases import MACHINES
from headstock.validation.references.rows import ValidationRow, compare_bound


def test_case_names_are_unique_and_differ_from_group_names() -> None:
    names = [case.name for case in CASES]
    assert len(set(names)) == len(names)
    assert not set(names) & set(_group_names())


def test_no_name_selects_everything_and_a_group_its_cases() -> None:
    assert _select_cases([]) == [case for case in CASES if not case.on_request]
    assert {case.group for case in _select_cases(["beams"])} == {"beams"}


def test_a_case_named_twice_runs_once() -> None:
    assert [
        case.name for case in _select_cases(["torsion-constant", "beams", "Torsion-Constant"])
    ].count("torsion-constant") == 1


def test_an_unknown_name_is_refused_with_a_suggestion_and_the_list() -> None:
    with pytest.raises(
        UnknownCaseError, match=r"'beems' \(did you mean 'beams'\?\).*torsion-constant"
    ):
        run_validation(["beams", "beems"], comm=MPI.COMM_SELF)


def test_the_closed_form_cases_all_pass() -> None:
    names = [
        case.name
        for case in CASES
        if case.name.endswith("-theory") or case.name == "torsion-constant"
    ]
    rows = run_validation(names, comm=MPI.COMM_SELF)
    assert len(rows) > 50
    assert [row for row in rows if not row.passed] == []


def test_a_case_that_breaks_leaves_a_failed_row_and_the_others_run(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def breaks(comm: MPI.Comm) -> list[ValidationRow]:
        raise HeadstockError("no convergence")

    def works(comm: MPI.Comm) -> list[ValidationRow]:
        return [compare_bound("q", 0.0, 1.0)]

    monkeypatch.setattr(
        case_registry, "CASES", (Case("breaks", "g", breaks), Case("works", "g", works))
    )
    seen: list[str] = []
    rows = run_validation(
        [], comm=MPI.COMM_SELF, on_case=lambda case, found: seen.append(case.name)
    )
    assert [(row.case, row.passed) for row in rows] == [("breaks", False), ("works", True)]
    assert "no convergence" in rows[0].note
    assert seen == ["breaks", "works"]


def test_a_seed_draws_what_no_factor_was_fitted_on(monkeypatch: pytest.MonkeyPatch) -> None:
    def compute(comm: MPI.Comm) -> list[ValidationRow]:
        return [compare_bound("as a rule", 0.0, 1.0)]

    def draw(first: int) -> list[ValidationRow]:
        return [compare_bound(f"from {first} on", 0.0, 1.0)]

    drawn = Case("drawn", "g", compute, draw=draw, fresh=49)
    monkeypatch.setattr(case_registry, "CASES", (drawn, Case("beam", "g", compute)))

    def run(name: str, seed: int | None) -> list[str]:
        return [row.quantity for row in run_validation([name], comm=MPI.COMM_SELF, seed=seed)]

    assert run("drawn", None) == ["as a rule"]
    assert run("drawn", 60) == ["from 60 on"]
    with pytest.raises(SeedError, match="drawn: seeds below 49 were used before; write --seed 49"):
        run("drawn", 48)
    with pytest.raises(SeedError, match="beam draws nothing; a seed is for drawn"):
        run("beam", 60)


def test_seeds_used_by_coverage_and_model_estimates_are_not_drawn_again() -> None:
    fresh = {case.name: case.fresh for case in CASES if case.draw is not None}
    used = {
        "coverage": max(*CALIBRATION, *HOLD_OUT),
        "model-estimates": max(MACHINES),
        "axes-estimates": max(SEEDS),
        "contour-estimates": max(LOOKED_AT, HELD_OUT),
    }
    assert fresh.keys() == used.keys()
    assert all(fresh[name] > used[name] for name in used)
