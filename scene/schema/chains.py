"""Keys of chains of masses and springs along one direction."""

from collections.abc import Iterator
from typing import Annotated

from pydantic import Field

from headstock.scene.schema.types import (
    Direction,
    End,
    LossFactor,
    NotNegativeDamping,
    Position,
    PositiveMass,
    PositiveStiffness,
    StrictTable,
)

MOST_MASSES = 200


class ChainTable(StrictTable):
    """Point masses in a row that move along one direction, each on a spring to the one before.

    The mass `NAME_1` is the first, `NAME_spring_1` the spring before it.
    """

    origin: Annotated[End, Field(alias="from")]
    """where the first spring begins: `ground` or `component.interface`"""
    to: End | None = None
    """where the last spring ends, behind the last mass; default: the chain ends with a mass"""
    axis: Direction
    """direction in which the masses move"""
    at: Position | None = None
    """position of the masses in the machine frame; required where the chain is attached to a component"""
    masses: Annotated[list[PositiveMass], Field(min_length=1, max_length=MOST_MASSES)]
    """masses of `NAME_1`, `NAME_2`, ...; each is a component with the interface `center`"""
    stiffness: Annotated[list[PositiveStiffness], Field(min_length=1, max_length=MOST_MASSES + 1)]
    """stiffness of the spring before each mass, and of the one to the other end: the joints `NAME_spring_1`, ..."""
    damping: list[NotNegativeDamping] = []
    """viscous damping of each spring; used with the effect `damping`"""
    loss_factor: LossFactor = 0.0
    """structural damping of every spring; used with the effect `damping`"""

    def _faults(self) -> Iterator[str]:
        springs = len(self.masses) + (self.to is not None)
        where = "one before each mass" + (" and one to the other end" if self.to else "")
        for name, values in (("stiffness", self.stiffness), ("damping", self.damping)):
            if len(values) != springs and (values or name == "stiffness"):
                yield f"has {len(values)} entries of {name} for {springs} springs: {where}"
        ends = [end for end in (self.origin, self.to) if end is not None]
        if self.at is None and any(end.component is not None for end in ends):
            yield 'begins or ends at a component; write where its masses are: at = ["0 mm", "0 mm", "250 mm"]'
