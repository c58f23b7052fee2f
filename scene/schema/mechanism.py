"""Schema of a closed-loop mechanism (kind, dimensions, mounting, limits, lumped springs), and of
contouring.
"""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from headstock.scene.schema.components import Rotations
from headstock.scene.schema.types import (
    Angle,
    AxisPosition,
    Count,
    Direction,
    Length,
    Name,
    Names,
    NotNegativeLength,
    Position,
    PositiveAngularSpeed,
    PositiveForce,
    PositiveFrequency,
    PositiveLength,
    PositiveSpeed,
    PositiveStiffness,
    PositiveTime,
    RequestTable,
    StrictTable,
    Text,
    problem,
)

Pair = Annotated[list[Length], Field(min_length=2, max_length=2)]


class ExechonTable(StrictTable):
    """Lengths of an Exechon: two UPR legs whose first axis is common (y), one SPR leg, a two-axis
    wrist.
    """

    base: Position
    platform: Position
    universal_offsets: Pair = [0.0, 0.0]
    platform_heights: Pair = [0.0, 0.0]
    wrist: Pair = [0.0, 0.0]
    tool_length: NotNegativeLength = 0.0


class SpringsTable(StrictTable):
    """Springs of each leg: platform joint, and along the leg in series with it the drive and the
    screw, softer as the leg grows.
    """

    joint: PositiveStiffness
    drive: PositiveStiffness
    screw: PositiveForce
    screw_offset: Length = 0.0


class MechanismTable(StrictTable):
    """A closed-loop mechanism that carries components; the poses of the scene are then tool poses:
    X, Y, Z, A, B.
    """

    kind: Literal["exechon"]
    model: Literal["lumped", "components"] = "lumped"
    dimensions: ExechonTable
    at: Position = Field(default=[0.0, 0.0, 0.0], validate_default=False)
    rotate: Rotations = Field(default=[], validate_default=False)
    tool: Direction = (0.0, 0.0, -1.0)
    carries: dict[Name, Names]
    limits: dict[Name, Annotated[list[AxisPosition], Field(min_length=2, max_length=2)]] = {}
    springs: SpringsTable | None = None
    screw_lead: PositiveLength | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.model == "lumped" and self.springs is None:
            raise problem(
                'model = "lumped" needs its springs; write springs = { joint = "275 N/um", drive = "375 N/um", screw = "412 MN" }'
            )
        return self


class MillTable(StrictTable):
    """A cylindrical end mill; a positive helix pulls a tool that turns clockwise down."""

    diameter: PositiveLength
    teeth: Annotated[Count, Field(le=100)]
    helix: Angle = 0.0
    runout: NotNegativeLength = 0.0


class ContouringTable(RequestTable):
    """A square block milled around from outside, clockwise seen from above (climb milling)."""

    side: PositiveLength
    at: Position
    feed: PositiveSpeed
    spindle: PositiveAngularSpeed
    mill: MillTable
    axial_depth: PositiveLength
    radial_depth: PositiveLength
    material: Literal["al7075-t6", "al7075-t6-dry", "al6061-t6"] | None = None
    forces: Text | None = None
    lead: Length = 0.02
    averaging: PositiveTime = 0.01
    model: Literal["linear", "nonlinear"] = "linear"
    steps_per_turn: Annotated[Count, Field(ge=24, le=2000)] = 96
    point: Text | None = None
    modes_to: PositiveFrequency | None = None
    pose_model: Literal["pose_dependent", "frozen"] = "pose_dependent"
