"""Schema of contouring: a block milled around, how fast, and how its path is followed."""

from typing import Annotated, Literal

from pydantic import Field

from headstock.scene.schema.mechanism import MillTable
from headstock.scene.schema.types import (
    Count,
    Length,
    Position,
    PositiveAngularSpeed,
    PositiveFrequency,
    PositiveLength,
    PositiveSpeed,
    PositiveTime,
    RequestTable,
    Text,
)


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
