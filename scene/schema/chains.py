"""Keys of chains of masses and springs along one direction."""

from typing import Annotated, Self

from pydantic import Field, model_validator

from headstock.scene.schema.types import (
    Direction,
    End,
    LossFactor,
    NotNegativeDamping,
    Position,
    PositiveMass,
    PositiveStiffness,
    StrictTable,
    problem,
)

MOST_MASSES = 200


class ChainTable(StrictTable):
    """Point masses in a row that move along one direction, each on a spring to the one before.

    The mass `NAME_1` is the first, `NAME_spring_1` the spring before it.
    """

    origin: Annotated[End, Field(alias="from")]
    to: End | None = None
    axis: Direction
    at: Position | None = None
    masses: Annotated[list[PositiveMass], Field(min_length=1, max_length=MOST_MASSES)]
    stiffness: Annotated[list[PositiveStiffness], Field(min_length=1, max_length=MOST_MASSES + 1)]
    damping: list[NotNegativeDamping] = []
    loss_factor: LossFactor = 0.0

    @model_validator(mode="after")
    def _check(self) -> Self:
        springs = len(self.masses) + (self.to is not None)
        where = "one before each mass" + (" and one to the other end" if self.to else "")
        for name, values in (("stiffness", self.stiffness), ("damping", self.damping)):
            if len(values) != springs and (values or name == "stiffness"):
                raise problem(f"has {len(values)} entries of {name} for {springs} springs: {where}")
        ends = [end for end in (self.origin, self.to) if end is not None]
        if self.at is None and any(end.component is not None for end in ends):
            raise problem(
                'begins or ends at a component; write where its masses are: at = ["0 mm", "0 mm", "250 mm"]'
            )
        return self
