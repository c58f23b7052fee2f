"""Figures 17 and 18 are drawn from the rows of the validation, and from nothing else."""

import dataclasses

from headstock.app.charts.axis_kit import FIGURE_NAME, draw_axis_kit
from headstock.validation.machines.axis_kit_cases import (
    CASE,
    FIDELITIES,
    MEASURED_COMPLIANCE,
    VARIANTS,
    compliance_name,
)
from headstock.validation.references.rows import Target, ValidationRow, compare_value


def make_rows(factor: float) -> list[ValidationRow]:
    return [
        dataclasses.replace(
            compare_value(
                compliance_name(variant, fidelity, axis),
                factor * right,
                Target(right, "um/kN", float("nan"), "shown only"),
            ),
            case=CASE,
        )
        for variant in VARIANTS
        for fidelity in FIDELITIES
        for axis, right in MEASURED_COMPLIANCE.items()
    ]


def test_the_figure_shows_the_deviations_of_the_rows() -> None:
    twice, thrice = (draw_axis_kit(make_rows(factor))[FIGURE_NAME] for factor in (2.0, 3.0))
    assert twice.startswith(b"\x89PNG") and thrice.startswith(b"\x89PNG")
    assert twice != thrice


def test_other_cases_have_no_such_figure() -> None:
    assert draw_axis_kit([]) == {}
