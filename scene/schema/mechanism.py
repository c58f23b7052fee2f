"""Schema of a closed-loop mechanism (kind, dimensions, mounting, limits, lumped springs), of
contouring on it, and of stability lobes, which share its tool.
"""

import math
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from headstock.scene.reading.tool_positions import MOST_CORNERS
from headstock.scene.reading.units import ANGULAR_SPEED
from headstock.scene.requests import FEED
from headstock.scene.schema.components import Rotations
from headstock.scene.schema.guide_errors import ProfileTable
from headstock.scene.schema.types import (
    THREE_NUMBERS,
    Angle,
    AxisPosition,
    Between,
    Count,
    DampingShare,
    Direction,
    Flag,
    JsonForm,
    Length,
    Name,
    Names,
    NotNegativeLength,
    NotNegativeShare,
    Position,
    PositiveAngularSpeed,
    PositiveForce,
    PositiveFrequency,
    PositiveLength,
    PositiveSpeed,
    PositiveStiffness,
    PositiveTime,
    QuantityPattern,
    RequestTable,
    StrictTable,
    Text,
    one_of,
    problem,
    read_direction,
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


class LegErrorsTable(StrictTable):
    """Errors of the screws of the legs of a lumped mechanism over the length of the leg; used with
    the effect `guide_errors`.
    """

    leg_1: ProfileTable | None = None
    leg_2: ProfileTable | None = None
    leg_3: ProfileTable | None = None

    def profiles(self) -> dict[str, ProfileTable]:
        """Those given, by leg."""
        given = {"leg_1": self.leg_1, "leg_2": self.leg_2, "leg_3": self.leg_3}
        return {leg: profile for leg, profile in given.items() if profile is not None}


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
    errors: LegErrorsTable | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.model == "lumped" and self.springs is None:
            raise problem(
                'model = "lumped" needs its springs; write springs = { joint = "275 N/um", drive = "375 N/um", screw = "412 MN" }'
            )
        return self


MOST_TEETH = 40
LEAST_DIAMETER, MOST_DIAMETER = 2e-5, 1.0  # of mills [m]
MOST_HELIX = 75.0  # [deg]
MOST_RUNOUT = 0.1  # of the diameter


def _check_diameter(value: float) -> float:
    if not LEAST_DIAMETER <= value <= MOST_DIAMETER:
        raise problem(
            f"is {1e3 * value:g} mm; mills measure {1e3 * LEAST_DIAMETER:g} to {1e3 * MOST_DIAMETER:g} mm; check the unit"
        )
    return value


def _check_helix(value: float) -> float:
    if not abs(value) <= math.radians(MOST_HELIX) * (1.0 + 1e-12):
        raise problem(
            f"is {math.degrees(value):g} deg; a helix angle, counted from the tool's axis, lies between {-MOST_HELIX:g} and {MOST_HELIX:g} deg;"
            " check the unit"
        )
    return value


class MillTable(StrictTable):
    """A cylindrical end mill; a positive helix pulls a tool that turns clockwise down."""

    diameter: Annotated[PositiveLength, AfterValidator(_check_diameter)]
    teeth: Annotated[Count, Between(1, MOST_TEETH)]
    helix: Annotated[Angle, AfterValidator(_check_helix)] = 0.0
    runout: NotNegativeLength = 0.0

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.runout > MOST_RUNOUT * self.diameter:
            raise problem(
                f"has a runout of {1e3 * self.runout:g} mm, more than {100.0 * MOST_RUNOUT:g} % of its diameter; check the unit"
            )
        return self


class ToolModeTable(StrictTable):
    """A lumped mode of spindle or tool: a mass on a spring on what stands before it."""

    name: Name
    frequency: PositiveFrequency
    damping: DampingShare
    stiffness: PositiveStiffness
    direction: Direction | None = None


class ContouringTable(RequestTable):
    """A square block milled around from outside, or a line of corners that the tool's centre
    follows.
    """

    model_config = one_of("side", "polyline", "polyline_file")

    side: PositiveLength | None = None
    at: Position | None = None
    polyline: Annotated[list[Position], Field(min_length=2, max_length=MOST_CORNERS)] | None = None
    polyline_file: Text | None = None
    corner_radius: NotNegativeLength = 0.0
    feed: PositiveSpeed
    spindle: PositiveAngularSpeed
    mill: MillTable
    axial_depth: PositiveLength
    radial_depth: PositiveLength
    sense: Literal["down", "up"] = "down"
    part_side: Literal["right", "left"] | None = None
    material: Text | None = None
    forces: Text | None = None
    traces: Text | None = None
    traces_knots: PositiveTime = 0.01
    lead: NotNegativeLength = 0.02
    averaging: PositiveTime = 0.01
    model: Literal["linear", "nonlinear"] = "linear"
    steps_per_turn: Annotated[Count, Between(24, 2000)] = 96
    point: Text | None = None
    modes_to: PositiveFrequency | None = None
    pose_model: Literal["pose_dependent", "frozen"] = "pose_dependent"
    tool_modes: Annotated[list[ToolModeTable], Field(max_length=12)] = []
    cut_off: PositiveLength = 0.8e-3
    estimate: Flag = True

    @model_validator(mode="after")
    def _check(self) -> Self:
        written = [
            name
            for name in ("side", "polyline", "polyline_file")
            if getattr(self, name) is not None
        ]
        if len(written) != 1:
            raise problem(
                f"gives {' and '.join(written) or 'no way for the tool'}; write either a block, side and at, or polyline, or polyline_file"
            )
        if (self.side is None) != (self.at is None):
            raise problem(
                "has at, the centre of a block, without side"
                if self.side is None
                else "has side without at, the centre of the block and the height of the tool point"
            )
        return self


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
    count: Annotated[Count, Between(2, MOST_SPEEDS)]

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


def _read_travel(value: object) -> object:
    return value if value == FEED else read_direction(value)


Travel = Annotated[
    Literal["feed"] | tuple[float, float, float],
    BeforeValidator(_read_travel),
    JsonForm(
        {
            "description": "x, -z ..., three plain numbers, or feed",
            "examples": ["x", "feed", [1, 1, 0]],
            "anyOf": [
                {
                    "enum": [
                        FEED,
                        *(f"{sign}{letter}" for sign in ("", "+", "-") for letter in "xyz"),
                    ]
                },
                THREE_NUMBERS,
            ],
        }
    ),
]


class LobesTable(RequestTable):
    """Stability lobes: limit depth of cut over the speed of the spindle."""

    speeds: Speeds
    mill: MillTable
    radial_depth: PositiveLength
    sense: Literal["down", "up"] = "down"
    part_side: Literal["right", "left"] | None = None
    material: Text
    feed_per_tooth: PositiveLength | None = None
    directions: Annotated[list[Travel], Field(min_length=1, max_length=12)] = [
        (1.0, 0.0, 0.0),
        (0.0, 1.0, 0.0),
    ]
    at: Text | None = None
    up: Direction = (0.0, 0.0, 1.0)
    up_to: PositiveFrequency = 1000.0
    deepest: PositiveLength = 0.05
    tool_modes: Annotated[list[ToolModeTable], Field(max_length=12)] = []
    tool_receptance: Text | None = None
    checked: NotNegativeShare = 1.0
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
