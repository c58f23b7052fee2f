"""The numbers that a scene asks for, with their relative errors, and the component and source with
the largest part.

Two rounds with different meshes show how reliable the estimates are for a machine: how much its
numbers still change.
"""

import dataclasses
import math
from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from headstock.pipeline.accuracy.followed import FOLLOWED, list_followed
from headstock.pipeline.answers.accuracy import AccuracyRound
from headstock.pipeline.answers.frf import PoseResponse
from headstock.pipeline.answers.modal import FREQUENCY
from headstock.pipeline.numbers.changes import Owner
from headstock.pipeline.numbers.estimates import (
    CURVED_FACES,
    DISCRETISATION,
    REDUCTION,
    Estimate,
    show_share,
)
from headstock.pipeline.numbers.numbers import Key
from headstock.pipeline.stages.run_state import RunState

# Safety factor of ± for 95 % of true errors (`validate coverage`), proportionally less for hexahedra,
# counts until a component was refined: then its rounds show how good its estimates are, between a
# share of them and more than this factor (LEAST_FACTOR, MOST_FACTOR).
MESH_SAFETY = 1.55
Factors = Mapping[str, float]  # component to the safety factor on the estimates of its mesh
# errors are assumed to fall with this power of the mesh size, or with that of their estimates where
# these fall faster, and the remaining error is multiplied by the factor below
LEVEL_RATE, FASTEST_LEVEL_RATE = 1.5, 4.0
LEVEL_SAFETY = 1.5
# In walls and next to grid lines of patches estimates of hexahedra were up to four times the
# true error; no less than this share of them counts.
LEAST_FACTOR = 0.4
MOST_FACTOR = 1.8  # the smallest estimates are little more than half of the true error
DECISIVE = 0.5  # of a component's largest error: numbers with a smaller share do not count
CLOSE = 0.7  # meshes with a larger ratio of sizes cannot raise the factor of earlier rounds


@dataclass(frozen=True)
class Quantity:
    """Describe a requested number with its relative error.

    Attributes:
        key: Key of the number, the same in every round.
        value: [Hz] or [m/N].
        parts: Component and source to their relative part of the error; inf where there is no
            bound.
        faces: Part of the error by curved faces of uncorrected meshes: the machine may be too soft
            as well as too stiff.
        corrected: Components whose meshes are corrected by their estimates: the remaining error may
            have either sign.
        response: True for peaks and levels of a frequency response, whose error may have either
            sign.
    """

    key: Key
    name: str
    value: float
    parts: Mapping[Owner, float]
    faces: float = 0.0
    corrected: frozenset[str] = frozenset()
    response: bool = False

    @property
    def error(self) -> float:
        """Relative error, all parts together."""
        return sum(self.parts.values())

    @property
    def two_sided(self) -> float:
        """The part of the error that may have either sign."""
        if self.response:
            return self.error
        return self.faces + sum(
            part
            for (name, source), part in self.parts.items()
            if name in self.corrected and source == DISCRETISATION
        )

    @property
    def owner(self) -> Owner:
        """Component and source with the largest part of the error."""
        return max(self.parts, key=lambda key: self.parts[key])

    def parts_by_meshes(self, names: Container[str]) -> dict[Owner, float]:
        """Return the parts of the error by the meshes of some components."""
        return {
            (name, source): part
            for (name, source), part in self.parts.items()
            if source == DISCRETISATION and name in names and part > 0.0
        }

    def error_left(self, before: "Quantity", steps: Mapping[str, float]) -> float:
        """Return the remaining error after meshes were refined, relative to the number.

        Args:
            steps: Refined component to its new size over the old one.
        """
        moved = self.parts_by_meshes(steps)
        total, change = sum(moved.values()), abs(self.value / before.value - 1.0)
        return sum(
            change
            * part
            / total
            * _share_left(steps[owner[0]], before.parts.get(owner, 0.0) / part)
            for owner, part in moved.items()
        )

    def report(self) -> AccuracyRound:
        """Return the report of a round in which this number has the largest error."""
        component, source = self.owner
        share = show_share(self.parts[self.owner])
        reason = f"{self.name} may be off by {show_share(self.error)}; {share} is the {source} of {component}"
        error = self.error if math.isfinite(self.error) else None
        return AccuracyRound(self.name, error, reason, self.owner)


def gather_quantities(state: RunState) -> list[Quantity]:
    """Return every frequency, compliance, and peak and level of a frequency response of a run, with
    its error in parts as estimated; on rank 0, after its analyses.
    """
    corrected = frozenset(
        name for name, part in state.reduced.items() if part.superelement.errors.corrected
    )
    several = len(state.plan.poses) > 1
    found: list[Quantity] = []
    for answer in state.answers:
        if not isinstance(answer, FOLLOWED):
            continue
        response = isinstance(answer, PoseResponse)
        heights_hz: dict[Key, float] = {}
        if isinstance(answer, PoseResponse):
            heights_hz = {answer.key(height): height.hz for height in answer.heights}
        for number in list_followed(answer):
            error, key = number.error or Estimate(), number.key
            parts = _relative_parts(error, number.value) | _unseen_parts(state, error)
            hz = number.value if key.kind == FREQUENCY else heights_hz.get(key)
            if hz is not None and error.shares.get(REDUCTION, 0.0) is None:
                parts |= {(name, REDUCTION): np.inf for name in _list_truncated(state, hz)}
            found.append(
                Quantity(
                    key,
                    number.describe(several_poses=several),
                    number.value,
                    parts,
                    0.0 if response else _faces_of(error, number.value, corrected),
                    frozenset() if response else corrected,
                    response,
                )
            )
    return found


def count_safely(quantities: Sequence[Quantity], factors: Factors) -> list[Quantity]:
    """Return the same quantities with safety factors on their errors.

    Args:
        factors: Factors of components that were refined between two rounds.
    """

    def factor(owner: Owner) -> float:
        return factors.get(owner[0], MESH_SAFETY) if owner[1] == DISCRETISATION else 1.0

    return [
        dataclasses.replace(
            quantity,
            parts={owner: factor(owner) * part for owner, part in quantity.parts.items()},
        )
        for quantity in quantities
    ]


def worst_quantity(quantities: list[Quantity]) -> Quantity | None:
    """Return the quantity with the largest relative error; None where nothing has an error."""
    known = [quantity for quantity in quantities if quantity.parts]
    return max(known, key=lambda quantity: quantity.error) if known else None


def _relative_parts(error: Estimate, value: float) -> dict[Owner, float]:
    """Return the parts of an error as estimated, without the safety factor of ± that covers 95 %;
    errors by curved faces count as errors of the mesh, as finer meshes approximate these faces
    better.
    """
    found: dict[Owner, float] = {}
    for source, sizes in error.parts.items():
        for name, size in sizes.items():
            owner = name, DISCRETISATION if source == CURVED_FACES else source
            covering = MESH_SAFETY if source == DISCRETISATION else 1.0
            if size > 0.0:
                found[owner] = found.get(owner, 0.0) + size / covering / value
    return found


def _unseen_parts(state: RunState, error: Estimate) -> dict[Owner, float]:
    """Return the meshes whose error cannot be estimated: rows of single elements."""
    if error.shares.get(DISCRETISATION, 0.0) is not None:
        return {}
    return {
        (name, DISCRETISATION): np.inf
        for name, part in state.reduced.items()
        if part.superelement.errors.missing_energy is not None
        and not part.superelement.errors.missing_energy.any()
    }


def _faces_of(error: Estimate, value: float, corrected: frozenset[str]) -> float:
    faces = error.parts.get(CURVED_FACES, {})
    return sum(size for name, size in faces.items() if name not in corrected) / value


def _list_truncated(state: RunState, hz: float) -> list[str]:
    """List the components whose modes are complete only to below a frequency."""
    return [
        name
        for name, part in state.reduced.items()
        if part.superelement.errors.truncation and part.superelement.cutoff_hz <= hz
    ]


def weigh_estimates(
    before: Sequence[Quantity],
    after: Sequence[Quantity],
    steps: Mapping[str, float],
    known: Factors,
    unseen: Container[str] = (),
) -> dict[str, float]:
    """Return safety factors of mesh estimates, by the change of numbers between rounds.

    If a number changed by ``d`` while the mesh size was multiplied by ``s``, the remaining error is
    ``d s^p / (1 - s^p)``, where errors fall with the power ``p``. Among the numbers with large
    parts by a component the one with the largest remaining error counts, as some do not change by
    chance. Components that were not refined keep their factor.

    Args:
        before: Numbers of a round, with estimates as they are.
        after: The same of the next one.
        steps: Refined component to its new size over the old one.
        known: Factors from earlier rounds.
        unseen: Components whose estimates contain only part of the error: changes of numbers count
            in full.

    Source: Roache (1994), J. Fluids Eng. 116, 405-413, on the grid convergence index.
    """
    earlier = {quantity.key: quantity for quantity in before}
    # of each component: its part of a number, and the remaining error over the estimated one
    ratios: dict[str, list[tuple[float, float]]] = {}
    for quantity in after:
        moved = quantity.parts_by_meshes(steps)
        total = sum(moved.values())
        if quantity.key in earlier and 0.0 < total < np.inf:
            ratio = LEVEL_SAFETY * quantity.error_left(earlier[quantity.key], steps) / total
            for (name, _), part in moved.items():
                ratios.setdefault(name, []).append((part, ratio))
    factors = dict(known)
    for name, own in ratios.items():
        decisive = DECISIVE * max(part for part, _ in own)
        largest = max(ratio for part, ratio in own if part >= decisive)
        factor = float(np.clip(largest, LEAST_FACTOR, np.inf if name in unseen else MOST_FACTOR))
        factors[name] = min(factor, known.get(name, factor)) if steps[name] > CLOSE else factor
    return factors


def choose_greedily[Worst, Option](
    find_worst: Callable[[], tuple[float, Worst]],
    aim: float,
    *,
    options: Callable[[Worst], Sequence[Option]],
    gain: Callable[[Option, Worst], float],
    take: Callable[[Option, Worst], None],
) -> Worst:
    """Take the option that gains most for the item with the largest error, until that is within an
    aim or no option is left; return that error.

    Args:
        find_worst: Returns the largest error with the options taken, and the item that has it.
        gain: Returns the gain of an option, over its cost.
    """
    while True:
        size, worst = find_worst()
        choices = options(worst) if size > aim else ()
        if not choices:
            return worst
        take(max(choices, key=lambda option: gain(option, worst)), worst)


def _share_left(step: float, smaller: float) -> float:
    """Return the remaining error over the reduction by a refinement.

    Args:
        step: New mesh size over the old one.
        smaller: Estimate before over the estimate after.
    """
    observed = math.log(smaller) / math.log(1.0 / step) if 1.0 < smaller < np.inf else 0.0
    share = step ** min(max(LEVEL_RATE, observed), FASTEST_LEVEL_RATE)
    return float(share / (1.0 - share))
