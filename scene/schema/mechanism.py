"""Schema of a closed-loop mechanism (kind, dimensions, mounting, limits, lumped springs), of
contouring on it, and of stability lobes, which share its tool.
"""

import math
from typing import Annotated, Literal, NamedTuple, Self

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
    WholeNumber,
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
    """positions of the base joints: y of legs 1 and 2, x of leg 3"""
    platform: Position
    """positions of the platform joints: y of legs 1 and 2, x of leg 3"""
    universal_offsets: Pair = [0.0, 0.0]
    """distance between the two axes of the universal joints of legs 1 and 2"""
    platform_heights: Pair = [0.0, 0.0]
    """z of the platform joints of legs 1 and 2"""
    wrist: Pair = [0.0, 0.0]
    """x and z of the wrist centre on the platform"""
    tool_length: NotNegativeLength = 0.0
    """distance of the tool point from the wrist centre"""


class SpringsTable(StrictTable):
    """Springs of each leg: platform joint, and along the leg in series with it the drive and the
    screw, softer as the leg grows.
    """

    joint: PositiveStiffness
    """stiffness of the joint between leg and platform, along and across the leg"""
    drive: PositiveStiffness
    """stiffness of nut and bearings, along the leg"""
    screw: PositiveForce
    """Young's modulus times cross-section of the screw; divided by its free length it is the stiffness"""
    screw_offset: Length = 0.0
    """free length of the screw less the length of the leg"""


class LegErrorsTable(StrictTable):
    """Errors of the screws of the legs of a lumped mechanism over the length of the leg; used with
    the effect `guide_errors`.
    """

    leg_1: ProfileTable | None = None
    """how much longer leg 1 is than commanded, over its length"""
    leg_2: ProfileTable | None = None
    """how much longer leg 2 is than commanded, over its length"""
    leg_3: ProfileTable | None = None
    """how much longer leg 3 is than commanded, over its length"""

    def profiles(self) -> dict[str, ProfileTable]:
        """Those given, by leg."""
        given = {"leg_1": self.leg_1, "leg_2": self.leg_2, "leg_3": self.leg_3}
        return {leg: profile for leg, profile in given.items() if profile is not None}


class MechanismTable(StrictTable):
    """A closed-loop mechanism that carries components; the poses of the scene are then tool poses:
    X, Y, Z, A, B.
    """

    kind: Literal["exechon"]
    """`exechon`: two UPR legs on a common first axis, one SPR leg, a two-axis wrist"""
    model: Literal["lumped", "components"] = "lumped"
    """`lumped`: every component is rigid, the legs' springs are the only compliance; `components`: the components and joints of the scene
    are the model"""
    dimensions: ExechonTable
    """dimensions of its bodies"""
    at: Position = Field(default=[0.0, 0.0, 0.0], validate_default=False)
    """position of its base in the machine frame: y along the common axis of legs 1 and 2, x to leg 3, z to the platform"""
    rotate: Rotations = Field(default=[], validate_default=False)
    """rotations of its base, one after the other"""
    tool: Direction = (0.0, 0.0, -1.0)
    """direction of the tool from the wrist to its tip, in poses without rotation"""
    carries: dict[Name, Names]
    """components by the body they are fixed to, in whose frame they are placed: `leg_1` turns with leg 1, `tip_1` is its sliding end, then
    `platform`, `wrist_4`, `wrist_5`"""
    limits: dict[Name, Annotated[list[AxisPosition], Field(min_length=2, max_length=2)]] = {}
    """lowest and highest value of coordinates: lengths `q1 q2 q3`, wrist angles `g4 g5`, passive angles `phi th1 ps1 th2 ps2 a1 a2 a3 ps3`;
    default: no limits"""
    springs: SpringsTable | None = None
    """stiffness of each leg; required by the lumped model"""
    screw_lead: PositiveLength | None = None
    """travel of a leg per turn of its motor; contours then report motor torques"""
    errors: LegErrorsTable | None = None
    """errors of the legs' screws in the lumped model, see [geometric errors](geometric_errors.md)"""

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
    """diameter of the tool"""
    teeth: Annotated[WholeNumber, Between(1, MOST_TEETH)]
    """number of teeth"""
    helix: Annotated[Angle, AfterValidator(_check_helix)] = 0.0
    """helix angle; a positive one pulls the tool down"""
    runout: NotNegativeLength = 0.0
    """distance of the tool axis from the spindle axis"""

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
    """name in tables"""
    frequency: PositiveFrequency
    """natural frequency on a rigid base"""
    damping: DampingShare
    """damping ratio on a rigid base"""
    stiffness: PositiveStiffness
    """stiffness of its spring; its mass follows from the frequency"""
    direction: Direction | None = None
    """direction in which it moves; default: both directions across the tool"""


class ContouringTable(RequestTable):
    """A square block milled around from outside, or a line of corners that the tool's centre
    follows.
    """

    model_config = one_of("side", "polyline", "polyline_file")

    side: PositiveLength | None = None
    """side of the finished block, gone around clockwise seen from above if it lies on the right of the travel"""
    at: Position | None = None
    """centre of the block and height of the tool point: in the machine frame of a mechanism; of axes, how far the tool stands from its
    work, counted from its position with all axes at zero, as a program has it; required with `side`"""
    polyline: Annotated[list[Position], Field(min_length=2, max_length=MOST_CORNERS)] | None = None
    """in place of a block: corners that the tool's centre follows, at one height, in the places of `at`"""
    polyline_file: Text | None = None
    """the same from a CSV file with the columns `x,y,z` in m, and `feed` to each corner in m/s if it differs"""
    corner_radius: NotNegativeLength = 0.0
    """radius of arcs around the corners of a polyline; sharp ones are rounded by the averages"""
    feed: PositiveSpeed
    """feed rate of the tool's centre along the path"""
    spindle: PositiveAngularSpeed
    """speed of the spindle"""
    mill: MillTable
    """the milling tool"""
    axial_depth: PositiveLength
    """depth of cut along the tool"""
    radial_depth: PositiveLength
    """depth of cut across the tool, at most its diameter"""
    sense: Literal["down", "up"] = "down"
    """`down` (climb): teeth leave at the finished face; `up` (conventional): they enter there"""
    part_side: Literal["right", "left"] | None = None
    """side of the travel on which the part lies; default: where a clockwise tool mills in this sense"""
    material: Text | None = None
    """workpiece material, in place of measured `forces`: of `[cutting.NAME]`, or of the [catalogue](cutting_coefficients.md)"""
    forces: Text | None = None
    """measured forces in place of computed ones: CSV with the columns `time,fx,fy,fz` in s and N, on the tool, machine frame; each time
    step takes their mean over it"""
    traces: Text | None = None
    """measured positions that the drives follow in place of the computed path: CSV with the columns `time` in s and in m `q1,q2,q3` of the
    legs of a mechanism or the names of the axes; its time starts with the path"""
    traces_knots: PositiveTime = 0.01
    """spacing of the knots of the spline through measured positions; noise between them is left out"""
    lead: NotNegativeLength = 0.02
    """length of the straight path before and after the block"""
    averaging: PositiveTime = 0.01
    """length of each of three moving averages that limit the jerk"""
    model: Literal["linear", "nonlinear"] = "linear"
    """`linear`: matrices along the path; `nonlinear`: the full equations of a lumped mechanism, and on any machine friction at the speeds
    of the motors"""
    steps_per_turn: Annotated[WholeNumber, Between(24, 2000)] = 96
    """time steps per turn of the spindle"""
    point: Text | None = None
    """where the tool is, against the work; default: the scene's first point"""
    modes_to: PositiveFrequency | None = None
    """modes of a machine of components kept in time; those above follow at once; default: twice the frequency at which teeth pass"""
    pose_model: Literal["pose_dependent", "frozen"] = "pose_dependent"
    """`pose_dependent`: matrices of a machine of components change along the way; `frozen`: those of the middle of face 1"""
    tool_modes: Annotated[list[ToolModeTable], Field(max_length=12)] = []
    """lumped modes of spindle and tool as those of `[analyses.lobes]`, across the z axis unless they have a direction"""
    cut_off: PositiveLength = 0.8e-3
    """wavelength between roughness and waviness of the milled faces (Gaussian filter of ISO 16610-21)"""
    estimate: Flag = True
    """± of its numbers, for which machines of components go the contour once or twice more"""

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
    return value


class SpeedsSpan(NamedTuple):
    """Lowest and highest speed of the spindle and the number of speeds."""

    low: PositiveAngularSpeed
    high: PositiveAngularSpeed
    number: Annotated[WholeNumber, Between(2, MOST_SPEEDS)]


def _check_speeds(span: SpeedsSpan) -> SpeedsSpan:
    if span.high <= span.low:
        raise problem("ends at no higher speed than it begins; write the lowest speed first")
    return span


Speeds = Annotated[
    SpeedsSpan,
    BeforeValidator(_read_speeds),
    AfterValidator(_check_speeds),
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
    """lowest and highest speed of the spindle, number of speeds"""
    mill: MillTable
    """the milling tool"""
    radial_depth: PositiveLength
    """depth of cut across the tool, at most its diameter"""
    sense: Literal["down", "up"] = "down"
    """`down` (climb): teeth leave at the finished face; `up` (conventional): they enter there"""
    part_side: Literal["right", "left"] | None = None
    """side of the travel on which the part lies; default: where a clockwise tool mills in this sense"""
    material: Text
    """workpiece material: of `[cutting.NAME]`, or of the [catalogue](cutting_coefficients.md)"""
    feed_per_tooth: PositiveLength | None = None
    """where the tangent to Kienzle's force is taken: at the mean thickness of its chips"""
    directions: Annotated[list[Travel], Field(min_length=1, max_length=12)] = [
        (1.0, 0.0, 0.0),
        (0.0, 1.0, 0.0),
    ]
    """directions of the travel. `feed` is that of a path, see [lobes](lobes.md#over-the-workspace-and-along-a-path)"""
    at: Text | None = None
    """point where the tool is; default: the first one"""
    up: Direction = (0.0, 0.0, 1.0)
    """direction from the tool's tip to its holder"""
    up_to: PositiveFrequency = 1000.0
    """modes of the machine are kept at least up to here; higher ones count where they can chatter, those of `tool_modes` always"""
    deepest: PositiveLength = 0.05
    """depth of cut up to which a limit is looked for"""
    tool_modes: Annotated[list[ToolModeTable], Field(max_length=12)] = []
    """lumped modes of spindle and tool in a row, from the machine to the tip"""
    tool_receptance: Text | None = None
    """measured receptances of the free assembly of spindle, holder and tool in their place: CSV with the columns
    `frequency,tip_re,tip_im,cross_re,cross_im,base_re,base_im` in Hz and m/N, equal in both directions across the tool"""
    checked: NotNegativeShare = 1.0
    """share of the speeds at which the limit is looked for, evenly spread; the others are hatched"""
    poses: Names | None = None
    """poses in which it is computed; default: all of them"""

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
