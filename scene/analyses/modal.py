"""Natural frequencies and modes."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, ClassVar

from pydantic import Field

from headstock.geometry.frames import FloatArray
from headstock.scene.building.draft import Draft, SceneAnalysis
from headstock.scene.scene import Request
from headstock.scene.schema import types

DEFAULT_MODES = 6


@dataclass(frozen=True)
class ModalRequest(Request):
    """Natural frequencies: a count or everything up to a frequency [Hz], in named poses.

    ``from_hz``: modes below are counted and not listed. ``stated``: the count is the scene's own.
    ``spread``: also with every interface rigid and with every one averaging.
    """

    analysis: ClassVar[str] = "modal"

    count: int | None = None
    up_to_hz: float | None = None
    poses: tuple[str, ...] = ()
    spread: bool = False
    from_hz: float = 0.0
    stated: bool = True

    def describe(self) -> str:
        """In a few words: what is computed, and how far."""
        if self.from_hz:
            return f"frequencies from {self.from_hz:g} to {self.up_to_hz:g} Hz"
        if self.up_to_hz is None:
            return "all frequencies" if self.count is None else f"{self.count} frequencies"
        first = "frequencies" if self.count is None else f"{self.count} frequencies at most,"
        return f"{first} up to {self.up_to_hz:g} Hz"

    def count_wanted(self, frequencies_hz: FloatArray, rigid_count: int) -> int:
        """Return how many of the modes solved for are asked for.

        Args:
            frequencies_hz: ``(m,)`` rising [Hz].
            rigid_count: How many of them are rigid-body modes, which a highest frequency keeps.
        """
        count = len(frequencies_hz)
        wanted = count if self.count is None else min(self.count, count)
        if self.up_to_hz is None:
            return wanted
        below = int(frequencies_hz.searchsorted(self.up_to_hz, side="right"))
        return min(wanted, max(rigid_count, below))


class _ModalTable(types.RequestTable):
    """Natural frequencies and modes; six of them unless `count` or `up_to` is given; `from` and
    `up_to` are a window of frequencies.
    """

    highest: ClassVar[str] = "up_to"

    model_config = types.not_both("count", "up_to")

    count: types.Count | None = None
    """number of modes; default: 6, or all up to `up_to`"""
    start: Annotated[types.Frequency, Field(alias="from")] = 0.0
    """lowest frequency of a window that ends at `up_to`; modes below keep their numbers and are not listed"""
    up_to: types.PositiveFrequency | None = None
    """all modes up to this frequency, in place of `count`"""
    poses: types.Names | None = None
    """poses in which it is computed; default: all of them"""
    spread: types.Flag = False
    """solve again with all interfaces rigid and with all averaging: gives a range for each frequency"""

    def _faults(self) -> Iterator[str]:
        if self.count is not None and self.up_to is not None:
            yield "gives both count and up_to; keep one"
        if self.start and self.up_to is None:
            yield 'a window of frequencies ends somewhere; write up_to = "500 Hz" as well'
        if self.up_to is not None and self.start >= self.up_to:
            yield f"begins at {self.start:g} Hz and ends at {self.up_to:g} Hz; write a lower `from`"


def _build(table: _ModalTable, draft: Draft) -> ModalRequest:
    """Build the request: in all poses unless the table names some."""
    count = DEFAULT_MODES if table.count is None and table.up_to is None else table.count
    return ModalRequest(
        count,
        table.up_to,
        tuple(table.poses or draft.poses),
        table.spread,
        table.start,
        stated=table.count is not None,
    )


ANALYSIS = SceneAnalysis(_ModalTable, ModalRequest, "natural frequencies and modes", build=_build)
