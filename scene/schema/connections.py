"""Schema of what holds and loads the components: joints, axes, points, supports, loads, poses."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from headstock.scene.schema.components import DiskTable, RectTable, StripTable
from headstock.scene.schema.types import (
    Acceleration,
    AxisPosition,
    Count,
    Direction,
    End,
    Exceptions,
    Flag,
    Force,
    JointDamping,
    JointStiffness,
    Length,
    LossFactor,
    Moment,
    Name,
    Names,
    NotNegativeLength,
    Number,
    Position,
    PositiveLength,
    PositivePressure,
    PositiveRotationalStiffness,
    PositiveStiffness,
    Pressure,
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
    damping: dict[Name, JointDamping] = {}
    loss_factor: LossFactor = 0.0
    allow_negative: Flag = False


class AxisTable(StrictTable):
    """A machine axis; by default `moves` is worked out from the joints."""

    joints: Names | None = None
    joint: Text | None = None
    direction: Direction | None = None
    kind: Literal["linear", "rotary"] = "linear"
    center: Position = Field(default=[0.0, 0.0, 0.0], validate_default=False)
    limits: Annotated[list[AxisPosition], Field(min_length=2, max_length=2)] | None = None
    moves: Names | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if (self.joints is None) == (self.joint is None):
            raise problem(
                'needs the joints across which it moves; write joints = ["guide", "drive"]'
            )
        return self

    def joint_names(self) -> tuple[str, ...]:
        """Joints of the axis, however they were written."""
        return tuple(self.joints) if self.joints is not None else (self.joint or "",)


class PointTable(StrictTable):
    """Where results are wanted: the motion of `tool` relative to `work`."""

    tool: End
    work: End


class SupportTable(StrictTable):
    """Pointwise support of a face (`component.face`) or of an interface's patches (`at =
    component.interface`).
    """

    face: Text | None = None
    at: Text | None = None
    disk: DiskTable | None = None
    rect: RectTable | None = None
    strip: StripTable | None = None
    fix: Annotated[list[Literal["x", "y", "z"]], Field(min_length=1, max_length=3)]

    @model_validator(mode="after")
    def _check(self) -> Self:
        check_area(self.face, self.at, (self.disk, self.rect, self.strip))
        if len(set(self.fix)) < len(self.fix):
            raise problem("names a direction twice in fix")
        return self


class LoadTable(StrictTable):
    """A static load: force and moment at an interface, traction or pressure on an area, or a body
    acceleration field.
    """

    at: Text | None = None
    face: Text | None = None
    component: Text | None = None
    disk: DiskTable | None = None
    rect: RectTable | None = None
    strip: StripTable | None = None
    force: Annotated[list[Force], Field(min_length=3, max_length=3)] | None = None
    moment: Annotated[list[Moment], Field(min_length=3, max_length=3)] | None = None
    traction: Annotated[list[Pressure], Field(min_length=3, max_length=3)] | None = None
    pressure: Pressure | None = None
    body: Annotated[list[Acceleration], Field(min_length=3, max_length=3)] | None = None

    @property
    def kind(self) -> Literal["traction", "pressure", "body", "force"]:
        """What kind of load was written."""
        if self.traction is not None:
            return "traction"
        if self.pressure is not None:
            return "pressure"
        return "body" if self.body is not None else "force"

    @model_validator(mode="after")
    def _check(self) -> Self:
        point_load = self.force is not None or self.moment is not None
        kinds = [
            point_load,
            self.traction is not None,
            self.pressure is not None,
            self.body is not None,
        ]
        if sum(kinds) != 1:
            raise problem("needs exactly one of force (with moment), traction, pressure, body")
        if point_load and self.at is None:
            raise problem(
                'a force or moment acts at an interface; write at = "component.interface"'
            )
        if self.body is not None:
            if self.component is None or self.face is not None or self.at is not None:
                raise problem('a body load acts on a whole component; write component = "name"')
            return self
        if self.component is not None:
            raise problem(
                '`component` goes with body loads; write face = "component.z+" or at = "component.interface"'
            )
        check_area(self.face, self.at, (self.disk, self.rect, self.strip))
        return self


class ProbeTable(StrictTable):
    """A place on an elastic component, in its own frame, where displacement and stress under the
    static loads are wanted.
    """

    component: Text
    at: Position


def check_area(face: str | None, at: str | None, shapes: tuple[object, ...]) -> None:
    """Refuse an area that is given twice, not at all, or with two shapes.

    Args:
        face: ``component.face``, where given.
        at: ``component.interface``, where given.
        shapes: Disk, rect and strip; None for those that are not given.
    """
    if (face is None) == (at is None):
        raise problem('needs either face = "component.z-" or at = "component.interface"')
    if at is not None and any(shape is not None for shape in shapes):
        raise problem("an interface brings its own patches; disk, rect and strip go with face")
    if sum(shape is not None for shape in shapes) > 1:
        raise problem("an area is one of disk, rect, strip")
    text = face if face is not None else at or ""
    if text.count(".") != 1 or not all(text.split(".")):
        raise problem(
            f'{text!r:.80} names no component and area; write "component.z-" or "component.interface"'
        )


PoseTable = dict[Name, AxisPosition]
