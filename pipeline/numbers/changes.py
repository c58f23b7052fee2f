"""Numbers of the same machine, changed: how far they move, and the ± that follows."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from headstock.pipeline.numbers.estimates import DISCRETISATION, Estimate, combine_estimates
from headstock.pipeline.numbers.numbers import Key, Number

# the component alone that has a source of error, empty for all, or the key of a coefficient; and the source
type Owner = tuple[str, str]


@dataclass(frozen=True, eq=False)
class Moved:
    """How far numbers of a machine move as it is changed.

    Attributes:
        difference: Of the changed machine less that of the other; of magnitudes where ± is of these.
        lost: Numbers that the changed machine lacks, or that are undetermined in it.
        added: Numbers that it alone has.
    """

    difference: Mapping[Key, float]
    lost: frozenset[Key]
    added: Mapping[Key, Number]


def compare(base: Iterable[Number], other: Iterable[Number]) -> Moved:
    """Return how far numbers move; equal keys are a pair."""
    left = {number.key: number for number in other}
    difference: dict[Key, float] = {}
    lost: set[Key] = set()
    for number in base:
        moved = left.pop(number.key, None)
        if moved is None or math.isnan(moved.value) or math.isnan(number.value):
            lost.add(number.key)
        elif number.key.group.of_size:
            difference[number.key] = abs(moved.value) - abs(number.value)
        else:
            difference[number.key] = moved.value - number.value
    return Moved(difference, frozenset(lost), left)


def to_errors(
    base: Iterable[Number],
    moves: Mapping[Owner, Moved],
    *,
    join: Literal["sum", "largest"],
    split: Callable[[Key, float], Mapping[str, float]] | None = None,
) -> dict[Key, Estimate]:
    """Return the part of each number's ± that follows from how far it moves.

    Args:
        moves: Owner of an error to what the machine without it, or with it in another form, changes.
        join: Errors of several owners add up; or forms of one error stand for each other, and the
            largest counts.
        split: Parts of components in the size of a number's change; by owner without it.
    """
    found: dict[Key, Estimate] = {}
    for key in (number.key for number in base):
        sizes = {
            owner: None
            if key in moved.lost
            else key.group.cover_of(owner[1]) * abs(moved.difference[key])
            for owner, moved in moves.items()
        }
        known = [size for size in sizes.values() if size is not None]
        if join == "largest":
            source = next(iter(moves))[1]
            size = max(known) if len(known) == len(sizes) else None
            parts = {} if size is None or split is None else {source: split(key, size)}
            found[key] = Estimate({source: size}, (), parts)
            continue
        found[key] = combine_estimates(
            [
                Estimate(
                    {source: size}, (), {} if size is None or not owner else {source: {owner: size}}
                )
                for (owner, source), size in sizes.items()
            ]
        )
    return found


def estimate_changes(
    base: Sequence[Number],
    changed: Mapping[Owner, Iterable[Number]],
    *,
    unknown: bool = False,
    left_out: tuple[str, ...] = (),
) -> dict[Key, Estimate]:
    """Return the ± of numbers from those of the machine without each source of error.

    A number keeps its own ± where something of the change is known.

    Args:
        changed: Owner of an error to the numbers without it.
        unknown: A mesh shows nothing of its error.
        left_out: What is not looked at.
    """
    moves = {owner: compare(base, numbers) for owner, numbers in changed.items()}
    moved = to_errors(base, moves, join="sum")
    silent = [Estimate({DISCRETISATION: None})] if unknown else []
    return {
        number.key: combine_estimates(
            [
                moved[number.key],
                *silent,
                *([number.error] if number.error is not None and (moves or unknown) else []),
                Estimate({}, left_out),
            ]
        )
        for number in base
    }
