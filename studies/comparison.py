"""Variants of a machine side by side, as ``compare.json`` has them: which modes are the same, and
how far apart they are.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NotRequired, TypedDict

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.pipeline.results.estimates import Estimate, FrequencyErrors, scale_shares
from headstock.pipeline.results.static import UM_PER_KN
from headstock.pipeline.storage.json_texts import check_finite, null_open
from headstock.pipeline.storage.provenance import ProvenanceSummary
from headstock.reduction.motions.body_fields import BodyPlaces, choose_places, machine_field
from headstock.reduction.motions.compliance_budget import PointBudget, WeakLink
from headstock.solvers.linear.mode_pairing import SAME_MODE, ModeSet, pair_modes
from headstock.studies.variants import Effort, VariantSolution


@dataclass(frozen=True)
class ModeCell:
    """A mode of one variant in its row.

    Attributes:
        index: Number of the mode in its variant, from 0.
        frequency_hz: [Hz].
        deviation: Relative deviation from the row's first variant; None there and for rigid-body
            modes.
        correlation: MAC with the shape in the row's first variant; None there.
    """

    index: int
    frequency_hz: float
    deviation: float | None = None
    correlation: float | None = None


@dataclass(frozen=True)
class ModeRow:
    """One mode throughout the variants.

    Attributes:
        name: What it is called in the variant in which it was found first: the reference, if it is
            there.
        origin: That variant.
        cells: Variant to cell, that of the origin first; variants without this mode are not in it.
    """

    name: str
    origin: str
    cells: dict[str, ModeCell] = field(default_factory=dict)

    @property
    def frequency_hz(self) -> float:
        """Frequency in the variant in which it was found first [Hz]."""
        return self.cells[self.origin].frequency_hz


@dataclass(frozen=True, eq=False)
class Comparison:
    """Variants side by side.

    Attributes:
        scene: Name of the scene.
        pose: Pose they were solved in.
        reference: Variant the others are held against.
        solutions: By variant name, in the order asked for.
        rows: Modes, rising.
        same_from: Correlation from which two modes are the same.
    """

    scene: str
    pose: str
    reference: str
    solutions: dict[str, VariantSolution]
    rows: tuple[ModeRow, ...]
    same_from: float


@dataclass(eq=False)
class _Family:
    """Rows that begin in one place, and the shapes they begin with."""

    rows: list[ModeRow]
    modes: ModeSet


def compare_variants(
    solutions: Sequence[VariantSolution], *, scene: str, reference: str | None = None
) -> Comparison:
    """Pair the modes of all variants with those of a reference, and the rest with each other.

    Motions are compared at places that stand for the mass of each body, the same in all variants
    whatever their fidelity.

    Args:
        solutions: At least one, all in the same pose.
        scene: Name for headings.
        reference: Variant to hold the others against; by default the first of those with most
            elastic, then segmented components.
    """
    by_name = {solution.choice.name: solution for solution in solutions}
    richest = sorted(by_name, key=lambda name: _richness(by_name[name]), reverse=True)
    best = reference or richest[0]
    order = [best, *(name for name in richest if name != best)]
    places = {
        name: choose_places(part)
        for name, part in by_name[best].coupled.layout.superelements.items()
    }
    families: list[_Family] = []
    for name in order:
        left = _mode_set(by_name[name], places)
        numbers = list(range(len(left.frequencies_hz)))
        for family in families:
            left, numbers = _enter_cells(family, name, left, numbers, SAME_MODE)
        rows = [
            ModeRow(by_name[name].mode_names[i], name, {name: ModeCell(i, float(hz))})
            for i, hz in zip(numbers, left.frequencies_hz, strict=True)
        ]
        families.append(_Family(rows, left))
    every = [row for family in families for row in family.rows]
    kept = [
        row
        for row in every
        if any(cell.index < by_name[name].wanted for name, cell in row.cells.items())
    ]
    rows = sorted(kept, key=lambda row: row.frequency_hz)
    return Comparison(scene, by_name[best].pose, best, by_name, tuple(rows), SAME_MODE)


def full_dofs(solution: VariantSolution) -> int:
    """Degrees of freedom of all components before reduction."""
    return sum(facts.full_dofs for facts in solution.components.values())


def _richness(solution: VariantSolution) -> tuple[int, int]:
    """Number of elastic and of segmented components."""
    kinds = [facts.fidelity for facts in solution.components.values()]
    return kinds.count("elastic") + kinds.count("superelement"), kinds.count("segmented")


def _mode_set(solution: VariantSolution, places: Mapping[str, BodyPlaces]) -> ModeSet:
    if solution.modal is None:
        return ModeSet(np.zeros(0), np.zeros((0, 0)))
    shapes = machine_field(solution.coupled, places, solution.modal.shapes)
    return ModeSet(
        solution.modal.frequencies_hz, shapes, min(solution.modal.rigid_count, shapes.shape[1])
    )


def _enter_cells(
    family: _Family, name: str, modes: ModeSet, numbers: list[int], same_from: float
) -> tuple[ModeSet, list[int]]:
    """Enter a variant's modes into the rows they belong to; the modes that are left, with their
    numbers in the variant.
    """
    pairs = pair_modes(family.modes, modes, same_from=same_from)
    for pair in pairs:
        row, hz = family.rows[pair.first], float(modes.frequencies_hz[pair.second])
        rigid = pair.second < modes.rigid_count or pair.first < family.modes.rigid_count
        deviation = None if rigid else hz / row.frequency_hz - 1.0
        row.cells[name] = ModeCell(numbers[pair.second], hz, deviation, pair.correlation)
    used = {pair.second for pair in pairs}
    kept = [i for i in range(len(numbers)) if i not in used]
    rigid_left = sum(i < modes.rigid_count for i in kept)
    shapes: FloatArray = modes.field[:, kept]
    return ModeSet(modes.frequencies_hz[kept], shapes, rigid_left), [numbers[i] for i in kept]


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


class LinkSummary(TypedDict):
    """What gives most at a point in a direction."""

    name: str
    share: float
    change_if_doubled: float


class VariantPointSummary(TypedDict):
    """Compliance of a variant at a point; directions x, y, z are keys of errors, budgets and
    links.
    """

    compliance_um_per_kN: list[list[float | None]]
    compliance_6x6: list[list[float | None]]
    error_um_per_kN: dict[str, float | None]
    error_share: dict[str, dict[str, float | None]]
    error_left_out: list[str]
    budget: dict[str, dict[str, float]]
    weak_link: dict[str, LinkSummary | None]


class EffortSummary(TypedDict):
    """What a model cost, by step and in ``total`` [s], and how many of its components came from the
    store.
    """

    seconds: dict[str, float]
    cpu_seconds: dict[str, float]
    import_seconds: float
    elastic_components: int
    from_store: int


class VariantSummary(FrequencyErrors):
    """A column of a comparison; lists have an item per mode that was asked for."""

    variant: str | None
    overrides: list[str]
    fidelity: dict[str, str]
    full_dofs: int
    reduced_dofs: int
    coupled_dofs: int
    frequencies_hz: list[float]
    error_hz: list[float | None]
    mode_names: list[str]
    static: dict[str, VariantPointSummary]
    effort: EffortSummary
    failures: list[str]


class EffortsSummary(TypedDict):
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
    same_from: float
    modes: list[RowSummary]
    variants: dict[str, VariantSummary]
    effort: NotRequired[EffortsSummary]
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
        "same_from": comparison.same_from,
        "modes": [_summarise_row(row, comparison) for row in comparison.rows],
        "variants": {
            name: _summarise_variant(solution) for name, solution in comparison.solutions.items()
        },
    }


def _summarise_row(row: ModeRow, comparison: Comparison) -> RowSummary:
    cells: dict[str, CellSummary | None] = dict.fromkeys(comparison.solutions)
    for name, cell in row.cells.items():
        cells[name] = {
            "number": cell.index + 1,
            "frequency_hz": check_finite(f"frequencies of variant {name}", [cell.frequency_hz])[0],
            "error_hz": comparison.solutions[name].mode_errors[cell.index].total,
            "deviation": cell.deviation,
            "mac": cell.correlation,
        }
    return {"name": row.name, "origin": row.origin, "variants": cells}


def _summarise_variant(solution: VariantSolution) -> VariantSummary:
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
        "static": {
            name: _summarise_point(name, budget, solution)
            for name, budget in solution.points.items()
        },
        "effort": summarise_effort(solution.effort),
        "failures": list(solution.failures),
    }


def _summarise_point(
    name: str, budget: PointBudget, solution: VariantSolution
) -> VariantPointSummary:
    what = f"static compliance at {name} in variant {solution.choice.name}"
    along = np.diag(budget.compliance)[:3]
    # a free direction has no number, and no error
    errors = {
        direction: Estimate() if np.isnan(value) else error
        for (direction, error), value in zip(
            solution.point_errors[name].items(), along, strict=True
        )
    }
    return {
        "compliance_um_per_kN": null_open(
            what, budget.compliance[:3, :3] * UM_PER_KN, free=budget.free
        ),
        "compliance_6x6": null_open(what, budget.compliance, free=budget.free),
        "error_um_per_kN": {
            direction: None if error.total is None else UM_PER_KN * error.total
            for direction, error in errors.items()
        },
        "error_share": {
            direction: scale_shares(error, UM_PER_KN) for direction, error in errors.items()
        },
        "error_left_out": _left_out(errors.values()),
        "budget": {direction: dict(shares) for direction, shares in budget.shares.items()},
        "weak_link": {
            direction: _summarise_link(link)
            for direction, link in solution.weak_links[name].items()
        },
    }


def _left_out(errors: Iterable[Estimate]) -> list[str]:
    return sorted({words for error in errors for words in error.left_out})


def _summarise_link(link: WeakLink | None) -> LinkSummary | None:
    return (
        None
        if link is None
        else {"name": link.name, "share": link.share, "change_if_doubled": link.change}
    )


def summarise_effort(effort: Effort) -> EffortSummary:
    """What it cost to get from the scene to the modes."""
    return {
        "seconds": {step: round(value, 4) for step, value in effort.seconds.items()}
        | {"total": round(effort.total, 4)},
        "cpu_seconds": {step: round(value, 4) for step, value in effort.cpu_seconds.items()}
        | {"total": round(effort.cpu_total, 4)},
        "import_seconds": round(effort.import_seconds, 4),
        "elastic_components": effort.reduced,
        "from_store": effort.stored,
    }
