"""A machine and the same machine changed: the changes, one loop that tries them, the differences
between their numbers, and the ± that follows.

A machine here is whatever is changed: a coupled machine, superelements, or a scene; a list of
changes never mixes these levels.
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

# the component with a source of error, empty for all, or the key of a coefficient; and the source
type Owner = tuple[str, str]
type Split = Callable[[Key, float], Mapping[str, float]]
type Join = Literal["sum", "largest", "replace"]


@dataclass(frozen=True, eq=False)
class Change[M]:
    """Describe a change of a machine.

    Attributes:
        owner: Component and source of the error that the change removes.
        prepare: Returns the changed machine; None where it would be the same. Collective.
    """

    owner: Owner
    prepare: Callable[[M], M | None]


@dataclass(frozen=True, eq=False)
class Tried:
    """Store the outcome of a change.

    Attributes:
        outcome: Numbers of the changed machine under the keys of the unchanged one, on rank 0; or
            the reason why there are none.
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
    """Try changes of a machine one after the other, except those that change nothing.

    Preparing is collective; solving is done on rank 0.

    Args:
        refused: Exceptions that become the outcome of a change, so that the others are still tried.
        is_root: True on rank 0.
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
            outcome = str(error)
        tried.append(Tried(change.owner, outcome))
    return tried


@dataclass(frozen=True, eq=False)
class Moved:
    """Store the differences between numbers of a changed machine and of the unchanged one.

    Attributes:
        difference: Changed minus unchanged; of magnitudes where the ± is that of a magnitude.
        lost: Numbers that the changed machine lacks, or that are undetermined in it.
        added: Numbers that only the changed machine has.
        errors: ± of the changed machine, where estimated.
    """

    difference: Mapping[Key, float]
    lost: frozenset[Key]
    added: Mapping[Key, Number]
    errors: Mapping[Key, Estimate]


def compare_numbers(base: Iterable[Number], other: Iterable[Number]) -> Moved:
    """Return the differences between numbers of two machines; equal keys are a pair."""
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
    """Return the contribution of changes to the ± of each number.

    Args:
        moves: Owner of an error to the differences in the machine without it, or with it in another
            form.
        join: ``sum``: the errors of several owners add up; ``largest``: they are forms of one
            error, of which the largest counts; ``replace``: the one change, together with the ± of
            the changed machine, replaces the ± of the unchanged one.
        split: Divides the size of a number's change among components; None divides it by owner.
    """
    return {number.key: _JOINS[join](number.key, moves, split) for number in base}


def _size(key: Key, owner: Owner, moved: Moved) -> float | None:
    """Return the possible error of a number; None where the changed machine lacks it."""
    if key in moved.lost:
        return None
    return key.group.cover_of(owner[1]) * abs(moved.difference[key])


def _add(key: Key, moves: Mapping[Owner, Moved], split: Split | None) -> Estimate:
    parts = []
    for owner, moved in moves.items():
        size, (name, source) = _size(key, owner, moved), owner
        of_owner = {} if size is None or not name else {source: {name: size}}
        parts.append(Estimate({source: size}, (), of_owner))
    return combine_estimates(parts)


def _take_largest(key: Key, moves: Mapping[Owner, Moved], split: Split | None) -> Estimate:
    sizes = [_size(key, owner, moved) for owner, moved in moves.items()]
    bounded, source = [size for size in sizes if size is not None], next(iter(moves))[1]
    size = max(bounded) if len(bounded) == len(sizes) else None
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

    A ± that a number already has is added where any change could be tried.

    Args:
        tried: Changes that remove errors, each of another owner; refused ones are listed as left
            out.
        unknown: The error of a mesh cannot be estimated.
        left_out: Sources of error that are not estimated.
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
    """List the changes that could not be tried, with the reasons."""
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
