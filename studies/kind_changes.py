"""Numbers of two runs compared by kind: how far each kind moves, and where most."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import TypedDict

import numpy as np

from headstock.pipeline.answers.path import SIZES
from headstock.pipeline.answers.volumetric import TOTAL
from headstock.pipeline.numbers.changes import compare_numbers
from headstock.pipeline.numbers.kinds import KINDS
from headstock.pipeline.numbers.numbers import Key, Number

RIGID_HZ = 1e-2  # below it a frequency is a rigid-body mode's
ROUNDING = 1e-9  # relative to the largest number of a kind
DERIVED = SIZES[2:]  # figures of a deviation that follow its peak and range


class ChangeSummary(TypedDict):
    """How far the numbers of a kind move; the name of the number that moves most, and its value without
    the effect and with it, in the unit on screen.
    """

    answer: str
    share: float
    entry: str
    unit: str
    without: float | None
    present: float | None


@dataclass(frozen=True)
class Change:
    """How far the numbers of a kind are apart in two runs.

    Attributes:
        key: Of the number that is furthest apart.
        share: Its difference over the larger of its two values, or over the largest component of its
            vector.
        without: Its value without the effect, in SI; None where that run lacks it.
    """

    key: Key
    share: float
    without: float | None
    present: float | None
    unit: str

    @property
    def label(self) -> str:
        """Plural of the kind in plain words."""
        return self.key.group.label

    @property
    def place(self) -> str:
        """The number of the kind in plain words: ``frequency 3 in pose left``, ``face 1, mean, x``."""
        key = self.key
        return key.describe(several_poses=True) if key.group.words else key.describe_place()

    def summarise(self) -> ChangeSummary:
        """Return it as it stands in JSON."""
        unit, factor = self.key.group.show_unit(self.unit)
        without, present = (
            None if value is None else factor * value for value in (self.without, self.present)
        )
        return {
            "answer": self.label,
            "share": self.share,
            "entry": str(self.key),
            "unit": unit,
            "without": without,
            "present": present,
        }


def select_compared(numbers: Iterable[Number]) -> dict[Key, Number]:
    """Return the numbers that comparisons list: of elastic modes, peaks and ranges of deviations, errors
    in a volume from all sources; no settling along a path, which jumps by periods and means nothing of
    an output that symmetry keeps at rest.
    """
    return {
        number.key: number
        for number in numbers
        if number.key.group.compared
        and number.key.get("source") in (None, TOTAL)
        and number.key.get("figure") not in DERIVED
        and not (number.key.kind == "frequency" and number.value < RIGID_HZ)
        and not (number.key.kind == "settling_time" and number.key.get("feed"))
    }


def compare_kinds(without: Iterable[Number], present: Iterable[Number]) -> list[Change]:
    """Return the largest change of each kind of numbers of two runs, of lengths and angles apart, in the
    order of the kinds.

    A number that one run lacks is a change of all of it.
    """
    before, after = select_compared(without), select_compared(present)
    worst: dict[tuple[str, str], Change] = {}
    for change in _list_changes(before, after):
        group = change.key.kind, change.unit
        if group not in worst or change.share > worst[group].share:
            worst[group] = change
    order = [*KINDS]
    return sorted(worst.values(), key=lambda change: order.index(change.key.kind))


def _list_changes(before: Mapping[Key, Number], after: Mapping[Key, Number]) -> Iterator[Change]:
    moved = compare_numbers(before.values(), after.values())
    vectors: dict[tuple[Key, str], float] = {}
    kinds: dict[str, float] = {}
    for number in (*before.values(), *after.values()):
        key, size = number.key, abs(float(np.nan_to_num(number.value)))
        vectors[key.vector, number.unit] = max(size, vectors.get((key.vector, number.unit), 0.0))
        kinds[key.kind] = max(size, kinds.get(key.kind, 0.0))
    for key, number in {**before, **after}.items():
        first, second = (
            None if key not in found or np.isnan(found[key].value) else found[key].value
            for found in (before, after)
        )
        largest = vectors[key.vector, number.unit]
        unknown = first is None and second is None
        if unknown or largest <= ROUNDING * kinds[key.kind]:
            continue
        known = first is not None and second is not None
        share = abs(moved.difference[key]) / largest if known else 1.0
        yield Change(key, share, first, second, number.unit)
