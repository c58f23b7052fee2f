"""Schema of stability lobes: speeds, tool, material and engagement, and what stands between the
machine and the tip of the tool.
"""

from typing import Annotated, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from headstock.scene.reading.units import ANGULAR_SPEED
from headstock.scene.schema.mechanism import MillTable
from headstock.scene.schema.types import (
    Count,
    Direction,
    JsonForm,
    LossFactor,
    Name,
    Names,
    NotNegativeShare,
    PositiveAngularSpeed,
    PositiveFrequency,
    PositiveLength,
    PositiveStiffness,
    QuantityPattern,
    RequestTable,
    StrictTable,
    Text,
    problem,
)

MOST_SPEEDS = 5000


def _read_speeds(value: object) -> object:
    if not isinstance(value, list) or len(value) != 3:
        raise problem(
            'is not a span; write lowest, highest and number of speeds: ["2000 rpm", "12000 rpm", 400]'
        )
    return {"low": value[0], "high": value[1], "count": value[2]}


class SpeedsTable(StrictTable):
    """Lowest and highest speed of the spindle and the number of speeds."""

    low: PositiveAngularSpeed
    high: PositiveAngularSpeed
    count: Annotated[Count, Field(ge=2, le=MOST_SPEEDS)]

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.high <= self.low:
            raise problem("ends at no higher speed than it begins; write the lowest speed first")
        return self


Speeds = Annotated[
    SpeedsTable,
    BeforeValidator(_read_speeds),
    JsonForm(
        {
            "type": "array",
            "examples": [["2000 rpm", "12000 rpm", 400]],
            "prefixItems": [
                *2 * [{"type": "string", "pattern": QuantityPattern((ANGULAR_SPEED,))}],
                {"type": "integer", "minimum": 2},
            ],
            "minItems": 3,
            "maxItems": 3,
        }
    ),
]


class ToolModeTable(StrictTable):
    """A lumped mode of spindle or tool: a mass on a spring on what stands before it."""

    name: Name
    frequency: PositiveFrequency
    damping: LossFactor
    stiffness: PositiveStiffness
    direction: Direction | None = None


class LobesTable(RequestTable):
    """Stability lobes: limit depth of cut over the speed of the spindle, the part on the right of the
    travel.
    """

    speeds: Speeds
    mill: MillTable
    radial_depth: PositiveLength
    material: Literal["al7075-t6", "al7075-t6-dry", "al6061-t6"]
    directions: Annotated[list[Direction], Field(min_length=1, max_length=12)] = [
        (1.0, 0.0, 0.0),
        (0.0, 1.0, 0.0),
    ]
    at: Text | None = None
    up: Direction = (0.0, 0.0, 1.0)
    up_to: PositiveFrequency = 1000.0
    deepest: PositiveLength = 0.05
    tool_modes: Annotated[list[ToolModeTable], Field(max_length=12)] = []
    tool_receptance: Text | None = None
    checked: NotNegativeShare = 0.005
    low_immersion: NotNegativeShare = 0.1
    poses: Names | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.radial_depth > self.mill.diameter:
            raise problem(
                f"radial_depth is {1e3 * self.radial_depth:g} mm and the tool has {1e3 * self.mill.diameter:g} mm; take at most"
                " its diameter"
            )
        if self.tool_modes and self.tool_receptance is not None:
            raise problem("gives both tool_modes and tool_receptance; keep one")
        return self
