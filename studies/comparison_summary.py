"""A comparison of variants as ``compare.json`` has it, with what of the reference a simpler model of
it agrees with, and which modes that lacks.
"""

from typing import NotRequired, TypedDict

import numpy as np

from headstock.geometry.frames import DIRECTIONS
from headstock.pipeline.answers.static import UM_PER_KN
from headstock.pipeline.numbers.estimates import Estimate, list_left_out, scale_shares, scale_total
from headstock.pipeline.numbers.numbers import Numbers
from headstock.pipeline.storage.json_texts import check_finite, null_open
from headstock.pipeline.storage.provenance import ProvenanceSummary
from headstock.reduction.motions.compliance_budget import PointBudget
from headstock.reduction.motions.part_names import name_families
from headstock.studies.comparison import Comparison, ModeRow
from headstock.studies.kind_changes import select_compared
from headstock.studies.responses import HOLDS, EntrySummary
from headstock.studies.variants import Effort, VariantSolution


class CellSummary(TypedDict):
    """A mode of one variant in its row."""

    number: int
    frequency_hz: float
    error_hz: float | None
    deviation: float | None
    mac: float | None


class RowSummary(TypedDict):
    """One mode throughout the variants; None where a variant has not got it."""

    name: str
    origin: str
    variants: dict[str, CellSummary | None]


class _LinkSummary(TypedDict):
    """What gives most at a point in a direction."""

    name: str
    share: float
    change_if_doubled: float


class _VariantPointSummary(TypedDict):
    """Compliance of a variant at a point; x, y, z are keys of errors, budgets and links."""

    compliance_um_per_kN: list[list[float | None]]
    compliance_6x6: list[list[float | None]]
    error_um_per_kN: dict[str, float | None]
    error_share: dict[str, dict[str, float | None]]
    error_left_out: list[str]
    budget: dict[str, dict[str, float]]
    weak_link: dict[str, _LinkSummary | None]


class EffortSummary(TypedDict):
    """What a model cost, by step and in ``total`` [s], and how many of its components came from the
    store.
    """

    seconds: dict[str, float]
    cpu_seconds: dict[str, float]
    import_seconds: float
    elastic_components: int
    from_store: int
    peak_rss_mb: float


class JudgedModeSummary(TypedDict):
    """A mode of the reference that another model lacks, or has elsewhere.

    Attributes:
        number: In the reference, from 1.
        frequency_hz: In the reference [Hz].
        part: Component with the largest share of its strain energy, or several whose names differ
            by a number only; empty without one.
        deviation: Relative deviation of the model's frequency; None where it has no such mode.
        mac: That of its partner, or the largest with any mode of the model.
    """

    number: int
    frequency_hz: float
    name: str
    part: str
    part_share: float
    deviation: float | None
    mac: float


class VerdictSummary(TypedDict):
    """A model against the reference, which is the same machine at another fidelity.

    Attributes:
        agreement: Relative deviation up to which an answer counts as agreeing.
        compliance: ``"POINT DIRECTION"`` to the relative deviation of the compliance along it.
        agreeing: Numbers of the elastic modes of the reference that agree, from 1.
        agreeing_within: Largest deviation among those; None where there is none.
        deviating: Modes that the model has, but not within ``agreement``.
    """

    agreement: float
    compliance: dict[str, float]
    agreeing: list[int]
    agreeing_within: float | None
    deviating: list[JudgedModeSummary]
    missing: list[JudgedModeSummary]


class OtherSummary(TypedDict):
    """A number of another analysis, and its ±, in the unit on screen."""

    value: float | None
    error: float | None
    unit: str


class VariantSummary(TypedDict):
    """A column of a comparison; lists have an item per mode that was asked for. ``mac`` is that of
    the reference's wanted modes (rows) with all modes of the variant; empty of the reference.
    ``others`` are numbers of other analyses, by kind and name.
    """

    variant: str | None
    overrides: list[str]
    fidelity: dict[str, str]
    full_dofs: int
    reduced_dofs: int
    coupled_dofs: int
    frequencies_hz: list[float]
    rigid_count: int
    error_hz: list[float | None]
    error_share: list[dict[str, float | None]]
    error_left_out: list[str]
    mode_names: list[str]
    strain_share: list[dict[str, float]]
    mac: list[list[float]]
    static: dict[str, _VariantPointSummary]
    frf: list[EntrySummary]
    others: dict[str, dict[str, OtherSummary]]
    effort: EffortSummary
    failures: list[str]


class _EffortsSummary(TypedDict):
    """Costs from an empty store: of each variant its ``first`` model, and one ``changed`` after
    it.
    """

    change: list[str]
    variants: dict[str, dict[str, EffortSummary]]


class ComparisonSummary(TypedDict):
    """The content of ``compare.json``."""

    scene: str
    pose: str
    reference: str
    mac_threshold: float
    modes: list[RowSummary]
    columns: list[str]
    variants: dict[str, VariantSummary]
    not_computed: dict[str, str]
    verdicts: dict[str, VerdictSummary]
    not_compared: list[str]
    effort: NotRequired[_EffortsSummary]
    provenance: NotRequired[ProvenanceSummary]


def summarise_comparison(comparison: Comparison) -> ComparisonSummary:
    """The content of ``compare.json``.

    Raises:
        AccuracyError: A result is not a finite number.
    """
    return {
        "scene": comparison.scene,
        "pose": comparison.pose,
        "reference": comparison.reference,
        "mac_threshold": comparison.mac_threshold,
        "modes": [_summarise_row(row, comparison) for row in comparison.rows],
        "columns": list(comparison.columns),
        "variants": {
            name: _summarise_variant(solution, comparison)
            for name, solution in comparison.solutions.items()
        },
        "not_computed": dict(comparison.not_computed),
        "verdicts": {
            name: _evaluate_model(comparison, solution)
            for name, solution in comparison.solutions.items()
            if _is_model_of(solution, comparison.solutions[comparison.reference])
        },
        "not_compared": list(comparison.not_compared),
    }


def _summarise_row(row: ModeRow, comparison: Comparison) -> RowSummary:
    cells: dict[str, CellSummary | None] = dict.fromkeys(comparison.solutions)
    for name, cell in row.cells.items():
        cells[name] = {
            "number": cell.index + 1,
            "frequency_hz": check_finite(f"frequencies of variant {name}", [cell.frequency_hz])[0],
            "error_hz": comparison.solutions[name].mode_error(cell.index).total,
            "deviation": cell.deviation,
            "mac": cell.correlation,
        }
    return {"name": row.name, "origin": row.origin, "variants": cells}


def _summarise_variant(solution: VariantSolution, comparison: Comparison) -> VariantSummary:
    choice, modal = solution.choice, solution.modal
    errors = [solution.mode_error(index) for index in range(solution.wanted)]
    frequencies = np.zeros(0) if modal is None else modal.frequencies_hz[: solution.wanted]
    return {
        "variant": choice.variant,
        "overrides": list(choice.overrides),
        "fidelity": {name: facts.fidelity for name, facts in solution.components.items()},
        "full_dofs": sum(facts.full_dofs for facts in solution.components.values()),
        "reduced_dofs": sum(facts.reduced_dofs for facts in solution.components.values()),
        "coupled_dofs": len(solution.machine.system.labels),
        "frequencies_hz": check_finite(f"frequencies of variant {choice.name}", frequencies),
        "error_hz": [error.total for error in errors],
        "error_share": [dict(error.shares) for error in errors],
        "error_left_out": list_left_out(errors),
        "rigid_count": 0 if modal is None else min(modal.rigid_count, solution.wanted),
        "mode_names": list(solution.named.names[: solution.wanted]),
        "strain_share": list(solution.named.strain_shares[: solution.wanted]),
        "mac": [
            [float(value) for value in row]
            for row in comparison.correlations.get(choice.name, np.zeros((0, 0)))
        ],
        "static": {
            name: _summarise_point(name, budget, solution)
            for name, budget in solution.points.items()
        },
        "frf": comparison.entries.get(choice.name, []),
        "others": _summarise_others(solution.others),
        "effort": summarise_effort(solution.effort),
        "failures": list(solution.failures),
    }


def _summarise_others(numbers: Numbers) -> dict[str, dict[str, OtherSummary]]:
    others: dict[str, dict[str, OtherSummary]] = {}
    for key, number in select_compared(numbers.values()).items():
        unit, factor = number.shown
        others.setdefault(key.group.label, {})[str(key)] = {
            "value": factor * number.value if np.isfinite(number.value) else None,
            "error": scale_total(number.error, factor),
            "unit": unit,
        }
    return others


def _summarise_point(
    name: str, budget: PointBudget, solution: VariantSolution
) -> _VariantPointSummary:
    what = f"static compliance at {name} in variant {solution.choice.name}"
    along = np.diag(budget.compliance)[:3]
    # a free direction has no number, and no error
    errors = {
        direction: Estimate() if np.isnan(value) else solution.point_error(name, direction)
        for direction, value in zip(DIRECTIONS, along, strict=True)
    }
    return {
        "compliance_um_per_kN": null_open(
            what, budget.compliance[:3, :3] * UM_PER_KN, free=budget.free
        ),
        "compliance_6x6": null_open(what, budget.compliance, free=budget.free),
        "error_um_per_kN": {
            direction: scale_total(error, UM_PER_KN) for direction, error in errors.items()
        },
        "error_share": {
            direction: scale_shares(error, UM_PER_KN) for direction, error in errors.items()
        },
        "error_left_out": list_left_out(errors.values()),
        "budget": {direction: dict(shares) for direction, shares in budget.shares.items()},
        "weak_link": {
            direction: None
            if link is None
            else {"name": link.name, "share": link.share, "change_if_doubled": link.change}
            for direction, link in solution.weak_links[name].items()
        },
    }


def summarise_effort(effort: Effort) -> EffortSummary:
    """Return the cost from the scene to the answers."""
    return {
        "seconds": {step: round(value, 4) for step, value in effort.seconds.items()}
        | {"total": round(effort.total, 4)},
        "cpu_seconds": {step: round(value, 4) for step, value in effort.cpu_seconds.items()}
        | {"total": round(effort.cpu_total, 4)},
        "import_seconds": round(effort.import_seconds, 4),
        "elastic_components": effort.reduced,
        "from_store": effort.stored,
        "peak_rss_mb": round(effort.peak_rss_mb, 1),
    }


def _is_model_of(solution: VariantSolution, best: VariantSolution) -> bool:
    """Whether a variant is the reference at another fidelity."""
    return (
        solution is not best
        and solution.choice.fidelity is not None
        and best.choice.fidelity is not None
        and solution.choice.variant == best.choice.variant
    )


def _evaluate_model(comparison: Comparison, solution: VariantSolution) -> VerdictSummary:
    """Return what of the reference a model of it agrees with."""
    best = comparison.solutions[comparison.reference]
    modes = _evaluate_modes(comparison, solution, best)
    agreeing = {
        mode["number"]: abs(mode["deviation"])
        for mode in modes
        if mode["deviation"] is not None and abs(mode["deviation"]) <= HOLDS
    }
    deviating = [mode for mode in modes if mode["number"] not in agreeing]
    return {
        "agreement": HOLDS,
        "compliance": _compare_compliances(solution, best),
        "agreeing": list(agreeing),
        "agreeing_within": max(agreeing.values(), default=None),
        "deviating": [mode for mode in deviating if mode["deviation"] is not None],
        "missing": [mode for mode in deviating if mode["deviation"] is None],
    }


def _compare_compliances(solution: VariantSolution, best: VariantSolution) -> dict[str, float]:
    deviations = {}
    for point in (name for name in best.points if name in solution.points):
        pairs = (np.diag(variant.points[point].compliance)[:3] for variant in (solution, best))
        for direction, value, wanted in zip(DIRECTIONS, *pairs, strict=True):
            if wanted > 0.0 and not np.isnan(value):  # a free direction has none
                deviations[f"{point} {direction}"] = float(value / wanted - 1.0)
    return deviations


def _evaluate_modes(
    comparison: Comparison, solution: VariantSolution, best: VariantSolution
) -> list[JudgedModeSummary]:
    """Elastic modes of the reference that the scene asks for, rising."""
    name, rigid = solution.choice.name, 0 if best.modal is None else best.modal.rigid_count
    table, modes = comparison.correlations.get(name), list[JudgedModeSummary]()
    for row in comparison.rows:
        if row.origin != comparison.reference:
            continue
        first, cell = row.cells[comparison.reference], row.cells.get(name)
        if not rigid <= first.index < best.wanted:
            continue
        shares = best.named.strain_shares[first.index]
        strained = {
            family: sum(shares[part] for part in members)
            for family, members in name_families(shares.keys() & best.components.keys()).items()
        }
        part = max(strained, key=lambda key: strained[key], default="")
        nearest = 0.0 if table is None else float(table[first.index].max())
        modes.append(
            {
                "number": first.index + 1,
                "frequency_hz": first.frequency_hz,
                "name": row.name,
                "part": part,
                "part_share": strained.get(part, 0.0),
                "deviation": None if cell is None else cell.deviation,
                "mac": nearest if cell is None else (cell.correlation or 0.0),
            }
        )
    return modes
