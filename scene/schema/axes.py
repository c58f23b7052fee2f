"""Schema of axes, their positions, and the points at which results are wanted."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

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
    problem,
)

PoseTable = dict[Name, AxisPosition]


class AxisTable(StrictTable):
    """A machine axis; by default `moves` is worked out from the joints."""

    model_config = one_of("joints", "joint")

    joints: Names | None = None
    joint: Text | None = None
    direction: Direction | None = None
    kind: Literal["linear", "rotary"] = "linear"
    center: Position = Field(default=[0.0, 0.0, 0.0], validate_default=False)
    limits: Annotated[list[AxisPosition], Field(min_length=2, max_length=2)] | None = None
    moves: Names | None = None
    errors: AxisErrorsTable | None = None

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
    offset: Position = Field(default=[0.0, 0.0, 0.0], validate_default=False)
