"""What a simpler model of a machine is good for: which answers of the reference it holds, which it
does not, and which modes it has not got.
"""

from dataclasses import dataclass

from headstock.geometry.frames import DIRECTIONS
from headstock.reduction.motions.body_motions import name_families
from headstock.studies.comparison import Comparison
from headstock.studies.responses import HOLDS
from headstock.studies.variants import VariantSolution


@dataclass(frozen=True)
class JudgedMode:
    """A mode of the reference that another model has not got, or has elsewhere.

    Attributes:
        number: In the reference, from 1.
        frequency_hz: In the reference [Hz].
        part: Component with the largest share of its strain energy, or several whose names differ
            by a number only; empty without one.
        deviation: Relative deviation of the model's frequency; None where it has no such mode.
        correlation: MAC of its partner, or the largest with any mode of the model.
    """

    number: int
    frequency_hz: float
    name: str
    part: str
    part_share: float
    deviation: float | None
    correlation: float


@dataclass(frozen=True)
class Verdict:
    """A model against the reference, which is the same machine at another fidelity.

    Attributes:
        agreement: Relative deviation up to which an answer counts as agreeing.
        compliance: ``"POINT DIRECTION"`` to the relative deviation of the compliance along it.
        agreeing: Numbers of the elastic modes of the reference that agree, from 1.
        agreeing_within: Largest deviation among those; None where there is none.
        deviating: Modes that the model has, but not within ``holds``.
        missing: Modes that it has not got.
    """

    agreement: float
    compliance: dict[str, float]
    agreeing: tuple[int, ...]
    agreeing_within: float | None
    deviating: tuple[JudgedMode, ...]
    missing: tuple[JudgedMode, ...]


def judge_models(comparison: Comparison) -> dict[str, Verdict]:
    """A verdict on each variant that is the reference at another fidelity."""
    best = comparison.solutions[comparison.reference]
    return {
        name: _judge(comparison, solution, best)
        for name, solution in comparison.solutions.items()
        if solution is not best
        and solution.choice.fidelity is not None
        and best.choice.fidelity is not None
        and solution.choice.variant == best.choice.variant
    }


def _judge(comparison: Comparison, solution: VariantSolution, best: VariantSolution) -> Verdict:
    modes = _judge_modes(comparison, solution, best)
    agreeing = {
        mode.number: abs(mode.deviation)
        for mode in modes
        if mode.deviation is not None and abs(mode.deviation) <= HOLDS
    }
    return Verdict(
        agreement=HOLDS,
        compliance=_compare_compliances(solution, best),
        agreeing=tuple(agreeing),
        agreeing_within=max(agreeing.values(), default=None),
        deviating=tuple(
            mode for mode in modes if mode.deviation is not None and mode.number not in agreeing
        ),
        missing=tuple(mode for mode in modes if mode.deviation is None),
    )


def _compare_compliances(solution: VariantSolution, best: VariantSolution) -> dict[str, float]:
    found = {}
    for point, budget in best.points.items():
        for place, direction in enumerate(DIRECTIONS):
            other = solution.points.get(point)
            wanted = float(budget.compliance[place, place])
            if other is not None and wanted > 0.0:
                value = float(other.compliance[place, place])
                if value == value:  # a free direction has none
                    found[f"{point} {direction}"] = value / wanted - 1.0
    return found


def _judge_modes(
    comparison: Comparison, solution: VariantSolution, best: VariantSolution
) -> list[JudgedMode]:
    """Elastic modes of the reference that the scene asks for, rising."""
    name, rigid = solution.choice.name, 0 if best.modal is None else best.modal.rigid_count
    table, found = comparison.correlations.get(name), []
    for row in comparison.rows:
        if row.origin != comparison.reference:
            continue
        own, cell = row.cells[comparison.reference], row.cells.get(name)
        if not rigid <= own.index < best.wanted:
            continue
        shares = best.named.strain_shares[own.index]
        strained = {
            family: sum(shares[part] for part in members)
            for family, members in name_families(shares.keys() & best.components.keys()).items()
        }
        part = max(strained, key=lambda key: strained[key], default="")
        nearest = 0.0 if table is None else float(table[own.index].max())
        found.append(
            JudgedMode(
                number=own.index + 1,
                frequency_hz=own.frequency_hz,
                name=row.name,
                part=part,
                part_share=strained.get(part, 0.0),
                deviation=None if cell is None else cell.deviation,
                correlation=nearest if cell is None else (cell.correlation or 0.0),
            )
        )
    return found
