"""Schema of axes, their positions, and the points at which results are wanted."""

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from headstock.scene.schema.guide_errors import AxisErrorsTable
from headstock.scene.schema.types import (
    AxisPosition,
    Direction,
    End,
    Name,
    Names,
    Position,
    StrictTable,
    Text,
    one_of,
)

PoseTable = dict[Name, AxisPosition]


class AxisTable(StrictTable):
    """A machine axis; by default `moves` is worked out from the joints."""

    model_config = one_of("joints", "joint")

    joints: Names | None = None
    """joints across which the axis moves"""
    joint: Text | None = None
    """the joint across which it moves, where there is only one"""
    direction: Direction | None = None
    """direction of travel; default: the joint's own axis"""
    kind: Literal["linear", "rotary"] = "linear"
    """`linear`: moves along its direction; `rotary`: turns about it"""
    center: Position = Field(default=[0.0, 0.0, 0.0], validate_default=False)
    """a point on the axis of rotation, in the machine frame"""
    limits: Annotated[list[AxisPosition], Field(min_length=2, max_length=2)] | None = None
    """lowest and highest position; default: no limits"""
    moves: Names | None = None
    """components that move with it; default: those that its joints cut off from ground"""
    errors: AxisErrorsTable | None = None
    """error motions of the axis in machine axes, see [geometric errors](geometric_errors.md); used with the effect `guide_errors`"""

    def _faults(self) -> Iterator[str]:
        if (self.joints is None) == (self.joint is None):
            yield 'needs the joints across which it moves; write joints = ["guide", "drive"]'

    def joint_names(self) -> tuple[str, ...]:
        """Joints of the axis, however they were written."""
        return tuple(self.joints) if self.joints is not None else (self.joint or "",)


class PointTable(StrictTable):
    """Where results are wanted: the motion of `tool` relative to `work`."""

    tool: End
    """where the tool is"""
    work: End
    """where the workpiece is; results are tool relative to work"""
    offset: Position = Field(default=[0.0, 0.0, 0.0], validate_default=False)
    """rigid extension from there to the point, in the axes of the tool's component (of the work's where the tool is ground)"""
