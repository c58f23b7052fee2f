"""What couplings of the same superelements in many poses share, so that a pose costs what its joints cost.

Nothing in it changes a result: a coupling with a memo gives the numbers of one without, whatever was coupled before.
"""

from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from typing import Any

import numpy as np


@dataclass(eq=False)
class CouplingMemo:
    """What was made last under each name, with what it was made of.

    Attributes:
        ports: Names of the points and interfaces that are loaded and observed; None for all.
    """

    ports: Collection[str] | None = None
    _kept: dict[str, tuple[tuple[object, ...], Any]] = field(default_factory=dict)

    def recall[T](self, name: str, made_of: tuple[object, ...], make: Callable[[], T]) -> T:
        """What ``make`` gives; that of the last call of this name where arrays are equal to those it had, and the rest is the same."""
        kept = self._kept.get(name)
        if kept is not None and len(kept[0]) == len(made_of) and all(map(_same, kept[0], made_of)):
            value: T = kept[1]
            return value
        made = make()
        self._kept[name] = (made_of, made)
        return made


def _same(one: object, other: object) -> bool:
    return one is other or (isinstance(one, np.ndarray) and isinstance(other, np.ndarray) and np.array_equal(one, other))
