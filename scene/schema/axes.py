"""Schema of axes, their positions, the points at which results are wanted, and a closed-loop mechanism
that moves them.
"""

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from headstock.scene.schema import types
from headstock.scene.schema.components import Rotations
from headstock.scene.schema.guide_errors import AxisErrorsTable, ProfileTable

PoseTable = dict[types.Name, types.AxisPosition]


class AxisTable(types.StrictTable):
    """A machine axis; by default `moves` is worked out from the joints."""

    model_config = types.one_of("joints", "joint")

    joints: types.Names | None = None
    """joints across which the axis moves"""
    joint: types.Text | None = None
    """the joint across which it moves, where there is only one"""
    direction: types.Direction | None = None
    """direction of travel; default: the joint's own axis"""
    kind: Literal["linear", "rotary"] = "linear"
    """`linear`: moves along its direction; `rotary`: turns about it"""
    center: types.Position = Field(default=[0.0, 0.0, 0.0], validate_default=False)
    """a point on the axis of rotation, in the machine frame"""
    limits: Annotated[list[types.AxisPosition], Field(min_length=2, max_length=2)] | None = None
    """lowest and highest position; default: no limits"""
    moves: types.Names | None = None
    """components that move with it; default: those that its joints cut off from ground"""
    errors: AxisErrorsTable | None = None
    """error motions of the axis in machine axes, see [geometric errors](geometric_errors.md); used with the effect `guide_errors`"""

    def _faults(self) -> Iterator[str]:
        if (self.joints is None) == (self.joint is None):
            yield 'needs the joints across which it moves; write joints = ["guide", "drive"]'

    def joint_names(self) -> tuple[str, ...]:
        """Joints of the axis, however they were written."""
        return tuple(self.joints) if self.joints is not None else (self.joint or "",)


class PointTable(types.StrictTable):
    """Where results are wanted: the motion of `tool` relative to `work`."""

    tool: types.End
    """where the tool is"""
    work: types.End
    """where the workpiece is; results are tool relative to work"""
    offset: types.Position = Field(default=[0.0, 0.0, 0.0], validate_default=False)
    """rigid extension from there to the point, in the axes of the tool's component (of the work's where the tool is ground)"""


LEG_KEYS = ("leg_1", "leg_2", "leg_3")
Pair = Annotated[list[types.Length], Field(min_length=2, max_length=2)]


class _ExechonTable(types.StrictTable):
    """Lengths of an Exechon: two UPR legs whose first axis is common (y), one SPR leg, a two-axis
    wrist.
    """

    base: types.Position
    """positions of the base joints: y of legs 1 and 2, x of leg 3"""
    platform: types.Position
    """positions of the platform joints: y of legs 1 and 2, x of leg 3"""
    universal_offsets: Pair = [0.0, 0.0]
    """distance between the two axes of the universal joints of legs 1 and 2"""
    platform_heights: Pair = [0.0, 0.0]
    """z of the platform joints of legs 1 and 2"""
    wrist: Pair = [0.0, 0.0]
    """x and z of the wrist centre on the platform"""
    tool_length: types.NotNegativeLength = 0.0
    """distance of the tool point from the wrist centre"""


class _SpringsTable(types.StrictTable):
    """Springs of each leg: platform joint, and along the leg in series with it the drive and the
    screw, softer as the leg grows.
    """

    joint: types.PositiveStiffness
    """stiffness of the joint between leg and platform, along and across the leg"""
    drive: types.PositiveStiffness
    """stiffness of nut and bearings, along the leg"""
    screw: types.PositiveForce
    """Young's modulus times cross-section of the screw; divided by its free length it is the stiffness"""
    screw_offset: types.Length = 0.0
    """free length of the screw less the length of the leg"""


class _LegErrorsTable(types.StrictTable):
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
        return self.given(LEG_KEYS)


class MechanismTable(types.StrictTable):
    """A closed-loop mechanism that carries components; the poses of the scene are then tool poses:
    X, Y, Z, A, B.
    """

    kind: Literal["exechon"]
    """`exechon`: two UPR legs on a common first axis, one SPR leg, a two-axis wrist"""
    model: Literal["lumped", "components"] = "lumped"
    """`lumped`: every component is rigid, the legs' springs are the only compliance; `components`: the components and joints of the scene
    are the model"""
    dimensions: _ExechonTable
    """dimensions of its bodies"""
    at: types.Position = Field(default=[0.0, 0.0, 0.0], validate_default=False)
    """position of its base in the machine frame: y along the common axis of legs 1 and 2, x to leg 3, z to the platform"""
    rotate: Rotations = Field(default=[], validate_default=False)
    """rotations of its base, one after the other"""
    tool: types.Direction = (0.0, 0.0, -1.0)
    """direction of the tool from the wrist to its tip, in poses without rotation"""
    carries: dict[types.Name, types.Names]
    """components by the body they are fixed to, in whose frame they are placed: `leg_1` turns with leg 1, `tip_1` is its sliding end, then
    `platform`, `wrist_4`, `wrist_5`"""
    limits: dict[
        types.Name, Annotated[list[types.AxisPosition], Field(min_length=2, max_length=2)]
    ] = {}
    """lowest and highest value of coordinates: lengths `q1 q2 q3`, wrist angles `g4 g5`, passive angles `phi th1 ps1 th2 ps2 a1 a2 a3 ps3`;
    default: no limits"""
    springs: _SpringsTable | None = None
    """stiffness of each leg; required by the lumped model"""
    screw_lead: types.PositiveLength | None = None
    """travel of a leg per turn of its motor; contours then report motor torques"""
    errors: _LegErrorsTable | None = None
    """errors of the legs' screws in the lumped model, see [geometric errors](geometric_errors.md)"""

    def _faults(self) -> Iterator[str]:
        if self.model == "lumped" and self.springs is None:
            yield 'model = "lumped" needs its springs; write springs = { joint = "275 N/um", drive = "375 N/um", screw = "412 MN" }'
