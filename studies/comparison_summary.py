"""What a comparison of variants reads like as ``compare.json``."""

from collections.abc import Iterable

import numpy as np

from headstock.pipeline.results.estimates import Estimate
from headstock.pipeline.results.summary import UM_PER_KN, scale_shares
from headstock.pipeline.storage.json_texts import Json, check_finite, null_open
from headstock.reduction.motions.compliance_budget import PointBudget, WeakLink
from headstock.studies.comparison import Comparison, ModeRow, full_dofs
from headstock.studies.variants import Effort, VariantSolution


def summarise_comparison(comparison: Comparison) -> Json:
    """The content of ``compare.json``.

    Raises:
        AccuracyError: A result is not a finite number.
    """
    return {
        "scene": comparison.scene,
        "pose": comparison.pose,
        "reference": comparison.reference,
        "same_from": comparison.same_from,
        "modes": [_summarise_row(row, comparison) for row in comparison.rows],
        "variants": {name: _summarise_variant(solution) for name, solution in comparison.solutions.items()},
    }


def _summarise_row(row: ModeRow, comparison: Comparison) -> Json:
    cells: Json = dict.fromkeys(comparison.solutions)
    for name, cell in row.cells.items():
        cells[name] = {
            "number": cell.index + 1,
            "frequency_hz": check_finite(f"frequencies of variant {name}", cell.frequency_hz),
            "error_hz": comparison.solutions[name].mode_errors[cell.index].total,
            "deviation": cell.deviation,
            "mac": cell.correlation,
        }
    return {"name": row.name, "origin": row.origin, "variants": cells}


def _summarise_variant(solution: VariantSolution) -> Json:
    choice, modal, errors = solution.choice, solution.modal, solution.mode_errors[: solution.wanted]
    frequencies = np.zeros(0) if modal is None else modal.frequencies_hz[: solution.wanted]
    return {
        "variant": choice.variant,
        "overrides": list(choice.overrides),
        "fidelity": {name: facts.fidelity for name, facts in solution.components.items()},
        "full_dofs": full_dofs(solution),
        "reduced_dofs": sum(facts.reduced_dofs for facts in solution.components.values()),
        "coupled_dofs": len(solution.coupled.system.labels),
        "frequencies_hz": check_finite(f"frequencies of variant {choice.name}", frequencies),
        "error_hz": [error.total for error in errors],
        "error_share": [dict(error.shares) for error in errors],
        "error_left_out": _left_out(errors),
        "rigid_count": 0 if modal is None else min(modal.rigid_count, solution.wanted),
        "mode_names": list(solution.mode_names[: solution.wanted]),
        "static": {name: _summarise_point(name, budget, solution) for name, budget in solution.points.items()},
        "effort": summarise_effort(solution.effort),
        "failures": list(solution.failures),
    }


def _summarise_point(name: str, budget: PointBudget, solution: VariantSolution) -> Json:
    what = f"static compliance at {name} in variant {solution.choice.name}"
    along = np.diag(budget.compliance)[:3]
    # a free direction has no number, and no error
    errors = {
        direction: Estimate() if np.isnan(value) else error
        for (direction, error), value in zip(solution.point_errors[name].items(), along, strict=True)
    }
    return {
        "compliance_um_per_kN": null_open(what, budget.compliance[:3, :3] * UM_PER_KN, free=budget.free),
        "compliance_6x6": null_open(what, budget.compliance, free=budget.free),
        "error_um_per_kN": {
            direction: None if error.total is None else UM_PER_KN * error.total for direction, error in errors.items()
        },
        "error_share": {direction: scale_shares(error, UM_PER_KN) for direction, error in errors.items()},
        "error_left_out": _left_out(errors.values()),
        "budget": {direction: dict(shares) for direction, shares in budget.shares.items()},
        "weak_link": {direction: _summarise_link(link) for direction, link in solution.weak_links[name].items()},
    }


def _left_out(errors: Iterable[Estimate]) -> list[str]:
    return sorted({words for error in errors for words in error.left_out})


def _summarise_link(link: WeakLink | None) -> Json | None:
    return None if link is None else {"name": link.name, "share": link.share, "change_if_doubled": link.change}


def summarise_effort(effort: Effort) -> Json:
    """What it cost to get from the scene to the modes."""
    return {
        "seconds": {step: round(value, 4) for step, value in effort.seconds.items()} | {"total": round(effort.total, 4)},
        "cpu_seconds": {step: round(value, 4) for step, value in effort.cpu_seconds.items()}
        | {"total": round(effort.cpu_total, 4)},
        "import_seconds": round(effort.import_seconds, 4),
        "elastic_components": effort.reduced,
        "from_store": effort.stored,
    }
