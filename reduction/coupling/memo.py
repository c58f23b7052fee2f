"""A memo of what poses of the same superelements share.

A memo changes no result: a coupling with one gives the numbers of a coupling without, whatever was
coupled before.
"""

from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from typing import Any

import numpy as np


@dataclass(eq=False)
class CouplingMemo:
    """Values made last under each name, with what they were made of.

    Attributes:
        channels: Names of the points and interfaces that are loaded and observed; None for all.
    """

    channels: Collection[str] | None = None
    _kept: dict[str, tuple[tuple[object, ...], Any]] = field(default_factory=dict)

    def recall[T](self, name: str, made_of: tuple[object, ...], make: Callable[[], T]) -> T:
        """Return a value made anew, or that of the last call of this name where it was made of the
        same: arrays equal, the rest identical.

        Args:
            name: One per kind of value.
            make: Makes the value; it must depend on nothing else.
        """
        kept = self._kept.get(name)
        if kept is not None and len(kept[0]) == len(made_of) and all(map(_same, kept[0], made_of)):
            value: T = kept[1]
            return value
        made = make()
        self._kept[name] = (made_of, made)
        return made


def _same(one: object, other: object) -> bool:
    return one is other or (
        isinstance(one, np.ndarray) and isinstance(other, np.ndarray) and np.array_equal(one, other)
    )
