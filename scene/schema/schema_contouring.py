"""Schema of a contouring simulation: the block, the way around it, the tool and the cut."""

from typing import Annotated, Literal

from pydantic import Field

from headstock.scene.schema.types import (
    Angle,
    Count,
    Length,
    NotNegativeLength,
    Position,
    PositiveAngularSpeed,
    PositiveLength,
    PositiveSpeed,
    PositiveTime,
    RequestTable,
    StrictTable,
    Text,
)


class MillTable(StrictTable):
    """A cylindrical end mill; a positive helix pulls a tool that turns clockwise down."""

    diameter: PositiveLength
    teeth: Annotated[Count, Field(le=100)]
    helix: Angle = 0.0
    runout: NotNegativeLength = 0.0


class ContouringTable(RequestTable):
    """A square block milled around from outside, clockwise seen from above (climb milling), on a lumped mechanism."""

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
