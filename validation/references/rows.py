"""Rows of the validation table (a value, what it should be, and whether it is), also as a JSON list,
and the reference values with their provenance, read from the table beside this file.
"""

import dataclasses
import functools
import json
import math
import tomllib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, SupportsFloat

Provenance = Literal["published", "derived-closed-form", "derived-numerical"]

TABLE = Path(__file__).with_name("reference_cases.toml")


@dataclass(frozen=True)
class ReferenceCase:
    """Numbers that a correct program reproduces.

    Attributes:
        provenance: ``published``, ``derived-closed-form`` or ``derived-numerical``.
        source: Where the numbers come from.
        tolerance: Relative tolerance within which they are to be met [-].
        traps: What they must not be used for.
    """

    name: str
    id: str
    description: str
    provenance: Provenance
    source: str
    tolerance: float
    traps: str
    unit: str
    values: dict[str, float]


def reference_case(name: str) -> ReferenceCase:
    """Return the reference case of a name.

    Raises:
        KeyError: There is no such case.
    """
    return _reference_cases()[name]


@functools.cache
def _reference_cases() -> dict[str, ReferenceCase]:
    """Return every reference case by name."""
    with TABLE.open("rb") as stream:
        table = tomllib.load(stream)
    return {name: ReferenceCase(name=name, **entry) for name, entry in table.items()}


@dataclass(frozen=True)
class ValidationRow:
    """One number compared with another.

    Attributes:
        case: Its validation case, which the registry fills in where it is empty.
        quantity: What was computed.
        value: The number, NaN when the computation failed.
        reference: What it is compared with, NaN where there is nothing to compare with.
        relative_error: ``value / reference - 1``; the value itself where the reference is zero.
        tolerance: Largest allowed size of the relative error, NaN where the row is shown only.
        kind: Where the reference comes from: ``published``, ``closed form``, ``converged 3D``,
            ``identity``, ``shown only``...
        passed: Within the tolerance; always true for rows that are shown only.
        note: What a reader should know.
    """

    case: str
    quantity: str
    value: float
    reference: float
    unit: str
    relative_error: float
    tolerance: float
    kind: str
    passed: bool
    note: str = ""


@dataclass(frozen=True)
class Target:
    """What a value is compared with.

    Attributes:
        reference: The right value, NaN when there is none.
        tolerance: Largest allowed relative error, NaN for a row that is shown only.
        kind: Where the reference comes from.
    """

    reference: float
    unit: str
    tolerance: float
    kind: str


KIND_OF_PROVENANCE = {
    "published": "published",
    "derived-closed-form": "closed form",
    "derived-numerical": "converged 3D",
}


SHOWN_ONLY = "shown only"


def verdict(confirmed: bool) -> str:
    """Return what became of a statement of a paper."""
    return "confirmed" if confirmed else "not confirmed"


def compare_value(
    quantity: str, value: SupportsFloat, target: Target, note: str = ""
) -> ValidationRow:
    """Return a row that passes when the value lies within the target's tolerance; a value that is
    not finite never passes.

    Args:
        quantity: What the value is, in words.
        target: The right value and the relative error allowed; where the right value is zero, the
            absolute one.
    """
    # plain numbers: numpy's own do not go into JSON
    number, right, allowed = float(value), float(target.reference), float(target.tolerance)
    error = number / right - 1.0 if right else number
    passed = math.isfinite(number) and (math.isnan(allowed) or abs(error) <= allowed)
    return ValidationRow(
        "", quantity, number, right, target.unit, error, allowed, target.kind, passed, note
    )


def observe_order(coarse: float, fine: float, finer: float = 2.0) -> float:
    """Return the order with which an error or a difference falls from one mesh or step to the next.

    Args:
        coarse: Error before, of any sign.
        finer: Size before over the size after [-].
    """
    return math.log(abs(coarse / fine)) / math.log(finer)


def compare_order(
    quantity: str,
    errors: Sequence[float],
    expected: float,
    *,
    finer: float = 2.0,
    within: float = 0.2,
) -> ValidationRow:
    """Return a row for an order of convergence by the last two errors, which passes near to what
    theory promises.

    Args:
        quantity: What the value is, in words.
        expected: Order of the theory [-].
        finer: Size before over the size after [-].
        within: How far off it may be [-].
    """
    target = Target(expected, "-", within / expected, "theory")
    order = observe_order(errors[-2], errors[-1], finer)
    return compare_value(quantity, order, target, f"order, within {within:g}")


def compare_bound(
    quantity: str, value: SupportsFloat, bound: float, note: str = ""
) -> ValidationRow:
    """Return a row for a number that should be zero and may be as large as a bound.

    Args:
        quantity: What the value is, in words.
        value: Relative or counted [-].
        bound: Largest magnitude allowed.
    """
    return compare_value(quantity, value, Target(0.0, "-", bound, "identity"), note)


def show(quantity: str, value: SupportsFloat, unit: str, note: str = "") -> ValidationRow:
    """Return a row that is printed for the reader and cannot fail unless it is not finite.

    Args:
        quantity: What the value is, in words.
    """
    return compare_value(quantity, value, Target(math.nan, unit, math.nan, SHOWN_ONLY), note)


def compare_values(
    reference: ReferenceCase,
    values: Iterable[float],
    *,
    tolerance: float | None = None,
    notes: Sequence[str] = (),
) -> list[ValidationRow]:
    """Return one row for each value of a reference case, in its order.

    Args:
        reference: What the values are compared with.
        values: As many as the reference has.
        tolerance: In place of the reference's own.
        notes: As many as there are values, or none.

    Raises:
        ValueError: The numbers of values differ.
    """
    allowed = reference.tolerance if tolerance is None else tolerance
    kind = KIND_OF_PROVENANCE[reference.provenance]
    remarks = notes or [""] * len(reference.values)
    return [
        compare_value(quantity, value, Target(right, reference.unit, allowed, kind), note)
        for (quantity, right), value, note in zip(
            reference.values.items(), values, remarks, strict=True
        )
    ]


def named_case(case: str, rows: Iterable[ValidationRow]) -> list[ValidationRow]:
    """Return the rows under a name of their own in place of that of their case."""
    return [dataclasses.replace(row, case=case) for row in rows]


def named_after(kind: str, rows: Iterable[ValidationRow]) -> list[ValidationRow]:
    """Return the rows with a word before each quantity, such as the kind of element."""
    return [dataclasses.replace(row, quantity=f"{kind} {row.quantity}") for row in rows]


def failed_computation(reason: str) -> ValidationRow:
    """Return the row of a case that ended with an error in place of numbers."""
    return ValidationRow(
        "", "computation", math.nan, math.nan, "-", math.nan, math.nan, "failure", False, reason
    )


def rows_as_json(rows: Sequence[ValidationRow]) -> str:
    """Return a JSON list with one object per row; numbers that do not exist are ``null``."""
    entries = [
        {
            key: None if isinstance(value, float) and not math.isfinite(value) else value
            for key, value in dataclasses.asdict(row).items()
        }
        for row in rows
    ]
    return json.dumps(entries, indent=1, allow_nan=False) + "\n"
