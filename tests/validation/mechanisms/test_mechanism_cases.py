"""The verification table of the Tripteor, the long runs shortened; ``headstock validate
tripteor_verification`` runs all of it.
"""

import dataclasses
from collections.abc import Iterable

import numpy as np
import pytest
from mpi4py import MPI

from headstock.solvers.mechanisms.modes import tool_compliance
from headstock.validation.case_registry import run_validation
from headstock.validation.mechanisms import mechanism_cases
from headstock.validation.mechanisms.mechanism_cases import check_limits, check_three_models
from headstock.validation.mechanisms.motion_cases import (
    _Run,
    check_constraint_drift,
    check_energy_balance,
    check_integration_orders,
)
from headstock.validation.mechanisms.tripteor_machine import load_tripteor
from headstock.validation.references.rows import ValidationRow

SHORT = _Run(0.0025, (50, 100, 200))


def failed(rows: Iterable[ValidationRow]) -> list[ValidationRow]:
    return [row for row in rows if not row.passed]


@pytest.mark.parametrize(("name", "count"), [
    ("mechanism-derivatives", 4), ("exechon-inverse-kinematics", 48), ("mirror-symmetry", 2), ("linear-limits", 6), ("three-models", 16),
    ("tripteor-lumped", 9), ("tripteor-claims", 9),
])  # fmt: skip
def test_every_row_passes(name: str, count: int) -> None:
    rows = run_validation([name], comm=MPI.COMM_SELF)
    assert len(rows) == count
    assert failed(rows) == []


def test_energy_gained_is_work_put_in() -> None:
    assert failed(check_energy_balance(MPI.COMM_SELF, SHORT)) == []


def test_both_integrators_are_of_second_order_to_the_same_reference() -> None:
    rows = list(check_integration_orders(MPI.COMM_SELF, SHORT))
    assert failed(rows) == []
    assert len([row for row in rows if "order" in row.quantity]) == 2


@pytest.mark.parametrize("steps", [1_000, pytest.param(10_000, marks=pytest.mark.trials)])
def test_loops_stay_closed_over_many_steps(steps: int) -> None:
    assert failed(check_constraint_drift(MPI.COMM_SELF, steps)) == []


def test_a_wrong_inertia_is_seen_by_the_model_in_absolute_coordinates(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    tripteor = load_tripteor()
    bodies = tuple(
        dataclasses.replace(body, inertia=body.inertia * 1.001) if body.name == "platform" else body
        for body in tripteor.model.bodies
    )
    wrong = dataclasses.replace(tripteor, model=dataclasses.replace(tripteor.model, bodies=bodies))
    right_system = mechanism_cases.absolute_tripteor

    monkeypatch.setattr(mechanism_cases, "load_tripteor", lambda: wrong)
    monkeypatch.setattr(
        mechanism_cases, "absolute_tripteor", lambda _, drive: right_system(tripteor, drive)
    )
    assert any("absolute" in row.quantity for row in failed(check_three_models(MPI.COMM_SELF)))


def test_a_wrong_spring_law_fails_the_static_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        mechanism_cases,
        "tool_compliance",
        lambda model, motions: tool_compliance(model, motions) * (1.0 + 1e-5),
    )
    assert np.sum(["static" in row.quantity for row in failed(check_limits(MPI.COMM_SELF))]) == 3
