"""Deviations of the rungs of a ladder from their references, and where they come within a limit."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from headstock.validation.ladder.points import LadderKind, LadderPoint
from headstock.validation.ladder.references import Group, LadderBeam

Against = Literal["analytic", "beam", "solid"]


@dataclass(frozen=True, eq=False)
class Rungs:
    """Models of some kinds by rising nDOF, static or modal.

    Attributes:
        beam: What they are models of.
        kinds: Of models.
        group: Static or modal.
        points: By rising nDOF.
    """

    beam: LadderBeam
    kinds: tuple[LadderKind, ...]
    group: Group
    points: tuple[LadderPoint, ...]

    @property
    def models(self) -> str:
        """What they are, in short."""
        return " + ".join(self.kinds)

    @property
    def figure(self) -> int:
        """Number of the paper's figure."""
        return self.beam.figures[(0 if self.kinds == ("segmented",) else 1) + (0 if self.group == "static" else 2)]


@dataclass(frozen=True)
class Deviation:
    """A relative deviation of one quantity of one model [-]."""

    value: float
    quantity: str
    point: LadderPoint

    def __str__(self) -> str:
        """As a reader takes it in: ``dy(Fy) +3.06 % at nDOF 30 (hex8)``."""
        return f"{self.quantity} {100 * self.value:+.3g} % at nDOF {self.point.ndof} ({self.point.kind})"


def pick_rungs(beam: LadderBeam, points: Sequence[LadderPoint], group: Group, *kinds: LadderKind) -> Rungs:
    """The models of some kinds, by rising nDOF."""
    own = sorted((point for point in points if point.group == group and point.kind in kinds), key=lambda point: point.ndof)
    return Rungs(beam, kinds, group, tuple(own))


def deviations(rungs: Rungs, quantities: Sequence[str], *, above: float = 0.0, against: Against = "analytic") -> list[Deviation]:
    """Every deviation of some quantities in models of at least so many dofs."""
    return [
        Deviation(point.values[name] / reference_value(rungs.beam, name, against) - 1.0, name, point)
        for point in rungs.points
        if point.ndof >= above
        for name in quantities
        if name in point.values
    ]


def reference_value(beam: LadderBeam, quantity: str, against: Against) -> float:
    """What a quantity is held against."""
    value: float = getattr(beam.references[quantity], against)
    return value


def worst_of(found: Sequence[Deviation]) -> Deviation:
    """The largest deviation, whatever its sign."""
    return max(found, key=lambda deviation: abs(deviation.value))


def worst_by_ndof(
    rungs: Rungs, quantities: Sequence[str], *, above: float = 0.0, against: Against = "analytic"
) -> dict[int, Deviation]:
    """The largest deviation at each nDOF, by rising nDOF; models of equal nDOF count together."""
    grouped: dict[int, list[Deviation]] = {}
    for deviation in deviations(rungs, quantities, above=above, against=against):
        grouped.setdefault(deviation.point.ndof, []).append(deviation)
    return {ndof: worst_of(found) for ndof, found in grouped.items()}


def ndof_within(rungs: Rungs, quantities: Sequence[str], limit: float, *, against: Against = "analytic") -> int | None:
    """Smallest nDOF from which on every deviation is within a limit; None where the largest model is outside."""
    enough: int | None = None
    for ndof, worst in reversed(worst_by_ndof(rungs, quantities, against=against).items()):
        if abs(worst.value) > limit:
            break
        enough = ndof
    return enough


def nearest_rung(rungs: Rungs, ndof: int, quantity: str) -> LadderPoint | None:
    """The model with this quantity whose nDOF comes nearest, by ratio."""
    own = [point for point in rungs.points if quantity in point.values]
    distances = [abs(math.log(point.ndof / ndof)) for point in own]
    return own[distances.index(min(distances))] if own else None
