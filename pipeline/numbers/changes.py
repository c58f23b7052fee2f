"""Numbers of the same machine, changed: the changes, the one loop that tries them, how far numbers move,
and the ± that follows.

A machine is whatever a level changes: coupled, of superelements, or a scene; a list of changes never
mixes them.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from headstock.pipeline.numbers.estimates import (
    CUTTING,
    DISCRETISATION,
    Estimate,
    combine_estimates,
)
from headstock.pipeline.numbers.numbers import Key, Number

# the component alone that has a source of error, empty for all, or the key of a coefficient; and the source
type Owner = tuple[str, str]
type Split = Callable[[Key, float], Mapping[str, float]]
type Join = Literal["sum", "largest", "replace"]


@dataclass(frozen=True, eq=False)
class Change[M]:
    """A change of a machine.

    Attributes:
        owner: Who has the error that it takes away, and which.
        prepare: Returns the changed machine; None where it would be the same. Collective.
    """

    owner: Owner
    prepare: Callable[[M], M | None]


@dataclass(frozen=True, eq=False)
class Tried:
    """A change that was tried.

    Attributes:
        outcome: Numbers of the changed machine under the keys of the other, on rank 0; or why there
            are none.
    """

    owner: Owner
    outcome: tuple[Number, ...] | str


def try_changes[M](
    machine: M,
    changes: Iterable[Change[M]],
    solve: Callable[[M], Iterable[Number]],
    *,
    refused: tuple[type[Exception], ...],
    is_root: bool = True,
) -> list[Tried]:
    """Try changes of a machine, one after the other; those that change nothing are left out.

    Preparing is collective; solving is done on rank 0.

    Args:
        refused: Errors that become the outcome of a change; the others are tried all the same.
        is_root: This is rank 0.
    """
    tried = []
    for change in changes:
        outcome: tuple[Number, ...] | str = ()
        try:
            changed = change.prepare(machine)
            if changed is None:
                continue
            if is_root:
                outcome = tuple(solve(changed))
        except refused as error:
            # what all ranks know of has no words of its own, but a cause on rank 0
            outcome = str(error) or str(error.__cause__ or "")
        tried.append(Tried(change.owner, outcome))
    return tried


@dataclass(frozen=True, eq=False)
class Moved:
    """How far numbers of a machine move as it is changed.

    Attributes:
        difference: Of the changed machine less that of the other; of magnitudes where ± is of these.
        lost: Numbers that the changed machine lacks, or that are undetermined in it.
        added: Numbers that it alone has.
        errors: ± that the changed machine has, where it is estimated.
    """

    difference: Mapping[Key, float]
    lost: frozenset[Key]
    added: Mapping[Key, Number]
    errors: Mapping[Key, Estimate]


def compare_numbers(base: Iterable[Number], other: Iterable[Number]) -> Moved:
    """Return how far numbers move; equal keys are a pair."""
    added = {number.key: number for number in other}
    errors = {key: number.error for key, number in added.items() if number.error is not None}
    difference: dict[Key, float] = {}
    lost: set[Key] = set()
    for number in base:
        moved = added.pop(number.key, None)
        if moved is None or math.isnan(moved.value) or math.isnan(number.value):
            lost.add(number.key)
        elif number.key.group.of_size:
            difference[number.key] = abs(moved.value) - abs(number.value)
        else:
            difference[number.key] = moved.value - number.value
    return Moved(difference, frozenset(lost), added, errors)


def to_errors(
    base: Iterable[Number], moves: Mapping[Owner, Moved], *, join: Join, split: Split | None = None
) -> dict[Key, Estimate]:
    """Return the part of each number's ± that follows from how far it moves.

    Args:
        moves: Owner of an error to what the machine without it, or with it in another form, changes.
        join: Errors of several owners add up (``sum``); or they are forms of one error, of which the
            largest counts; or of the one change, beside the ± that the changed machine has, which
            replace those of the other.
        split: Parts of components in the size of a number's change; by owner without it.
    """
    return {number.key: _JOINS[join](number.key, moves, split) for number in base}


def _size(key: Key, owner: Owner, moved: Moved) -> float | None:
    """Return how far a number may be off; None where the changed machine lacks it."""
    if key in moved.lost:
        return None
    return key.group.cover_of(owner[1]) * abs(moved.difference[key])


def _add(key: Key, moves: Mapping[Owner, Moved], split: Split | None) -> Estimate:
    parts = []
    for owner, moved in moves.items():
        size, (name, source) = _size(key, owner, moved), owner
        own = {} if size is None or not name else {source: {name: size}}
        parts.append(Estimate({source: size}, (), own))
    return combine_estimates(parts)


def _take_largest(key: Key, moves: Mapping[Owner, Moved], split: Split | None) -> Estimate:
    sizes = [_size(key, owner, moved) for owner, moved in moves.items()]
    known, source = [size for size in sizes if size is not None], next(iter(moves))[1]
    size = max(known) if len(known) == len(sizes) else None
    parts = {} if size is None or split is None else {source: split(key, size)}
    return Estimate({source: size}, (), parts)


def _replace(key: Key, moves: Mapping[Owner, Moved], split: Split | None) -> Estimate:
    ((owner, moved),) = moves.items()
    source, size = owner[1], _size(key, owner, moved)
    if size is None:
        return Estimate({source: None}, next(iter(moved.errors.values()), Estimate()).left_out)
    other = moved.errors.get(key, Estimate())
    parts = {} if split is None else {source: split(key, size)}
    return Estimate({source: size, **other.shares}, other.left_out, {**parts, **other.parts})


_JOINS: Mapping[Join, Callable[[Key, Mapping[Owner, Moved], Split | None], Estimate]] = {
    "sum": _add,
    "largest": _take_largest,
    "replace": _replace,
}


def estimate_changes(
    base: Sequence[Number],
    tried: Sequence[Tried],
    *,
    unknown: bool = False,
    left_out: tuple[str, ...] = (),
) -> dict[Key, Estimate]:
    """Return the ± of numbers from those of the machine without each source of error.

    A number keeps its ± where something of the change is known.

    Args:
        tried: Changes that take errors away, each another's; what was refused is left out.
        unknown: A mesh shows nothing of its error.
        left_out: What is not looked at.
    """
    moves = {
        change.owner: compare_numbers(base, change.outcome)
        for change in tried
        if isinstance(change.outcome, tuple)
    }
    moved = to_errors(base, moves, join="sum")
    silent = [Estimate({DISCRETISATION: None})] if unknown else []
    return {
        number.key: combine_estimates(
            [
                moved[number.key],
                *silent,
                *([number.error] if number.error is not None and (moves or unknown) else []),
                Estimate({}, (*left_out, *list_refused(tried))),
            ]
        )
        for number in base
    }


def list_refused(tried: Iterable[Tried]) -> tuple[str, ...]:
    """Return what of the changes could not be tried, and why."""
    return tuple(
        f"{_describe(change.owner)}: {change.outcome}"
        for change in tried
        if isinstance(change.outcome, str)
    )


def _describe(owner: Owner) -> str:
    name, source = owner
    if source == CUTTING:
        return f"{name} of the {source}"
    return f"{source} of {name}" if name else source
