"""Reference values with their provenance, read from the table beside this file."""

import functools
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

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
    return reference_cases()[name]


@functools.cache
def reference_cases() -> dict[str, ReferenceCase]:
    """Return every reference case by name."""
    with TABLE.open("rb") as stream:
        table = tomllib.load(stream)
    return {name: ReferenceCase(name=name, **entry) for name, entry in table.items()}
