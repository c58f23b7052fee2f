"""Schema of joints: shafts of ball screws, carriages on rails, the joint itself."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from headstock.scene.schema.guide_errors import RailErrorsTable
from headstock.scene.schema.types import (
    Count,
    Direction,
    End,
    Exceptions,
    Flag,
    JointDamping,
    JointStiffness,
    Length,
    LossFactor,
    Name,
    NotNegativeLength,
    Number,
    Position,
    PositiveLength,
    PositivePressure,
    PositiveRotationalStiffness,
    PositiveStiffness,
    PositiveStiffnessPerArea,
    StrictTable,
    Text,
    problem,
)


class ScrewTable(StrictTable):
    """The shaft of a ball screw between its bearings; the motor is locked."""

    origin: Annotated[Text | None, Field(alias="from")] = None
    diameter: PositiveLength
    bore: NotNegativeLength = 0.0
    E: PositivePressure | None = None
    nu: Number | None = None
    lead: PositiveLength | None = None
    bearing: PositiveStiffness | None = None
    coupling: PositiveRotationalStiffness | None = None
    floating_end: End | None = None
    second_end: End | None = None
    second_bearing: PositiveStiffness | None = None
    length: PositiveLength | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.bore >= self.diameter:
            raise problem(
                f"its bore of {1e3 * self.bore:.6g} mm is not smaller than its diameter of {1e3 * self.diameter:.6g} mm"
            )
        if (self.second_end is None) != (self.length is None):
            raise problem(
                'a second fixed bearing needs the shaft\'s length between both, and only it does; write second_end = "bed.bearing_2", length = "900 mm"'
            )
        if self.second_end is not None and self.floating_end is not None:
            raise problem(
                "a shaft between two bearings has its own length; remove floating_end or second_end"
            )
        if self.second_end is None and self.second_bearing is not None:
            raise problem('there is no second bearing; write second_end = "bed.bearing_2" too')
        if self.coupling is not None and self.lead is None:
            raise problem('a coupling deflects along the thread only; write lead = "10 mm" too')
        return self


class CarriagesTable(StrictTable):
    """Carriages on parallel rails."""

    middle: Position
    along: Length = 0.0
    across: Length = 0.0
    rails: Count = 2
    per_rail: Count = 2


class LayerTable(StrictTable):
    """A contact layer between the faces of a bolted or glued joint: stiffness per area."""

    normal: PositiveStiffnessPerArea
    shear: PositiveStiffnessPerArea


class JointTable(StrictTable):
    """A joint between two interfaces, or an interface and ground; which stiffness keys it takes
    depends on its kind.
    """

    origin: Annotated[Text | None, Field(alias="from")] = None
    between: Annotated[list[End], Field(min_length=2, max_length=2)]
    kind: Literal[
        "rigid",
        "spring",
        "linear_guide",
        "ball_screw",
        "bolted",
        "bearing",
        "mount",
        "revolute",
        "universal",
        "spherical",
        "prismatic",
    ]
    axis: Direction | None = None
    normal: Direction | None = None
    at: Position | None = None
    places: list[Position] | dict[Name, Position] | None = None
    carriages: CarriagesTable | None = None
    each: Exceptions = {}
    length: PositiveLength | None = None
    screw: ScrewTable | None = None
    stiffness: dict[Name, JointStiffness] = {}
    stiffness_per_area: LayerTable | None = None
    damping: dict[Name, JointDamping] = {}
    loss_factor: LossFactor = 0.0
    errors: RailErrorsTable | None = None
    allow_negative: Flag = False
    soft: Flag = False
