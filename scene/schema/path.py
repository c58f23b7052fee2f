"""Schema of a path analysis: a straight move of axes, how fast, and how its deviation is
sampled.
"""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from headstock.scene.schema.axes import PoseTable
from headstock.scene.schema.mechanism import MillTable
from headstock.scene.schema.types import (
    ChannelName,
    Direction,
    Flag,
    PathFeed,
    PositiveAngularSpeed,
    PositiveFrequency,
    PositiveLength,
    PositiveTime,
    RequestTable,
    StrictTable,
    Text,
    problem,
)

Channels = Annotated[list[ChannelName], Field(min_length=1, max_length=30)]
Feeds = Annotated[list[PathFeed], Field(min_length=1, max_length=20)]


class PathCutTable(StrictTable):
    """Milling along a path; used with the effect `cutting_force`."""

    mill: MillTable
    spindle: PositiveAngularSpeed
    axial_depth: PositiveLength
    radial_depth: PositiveLength
    sense: Literal["down", "up"] = "down"
    part_side: Literal["right", "left"] | None = None
    material: Text
    at: Text | None = None
    up: Direction = (0.0, 0.0, 1.0)


class PathTable(RequestTable):
    """How far a point leaves the straight line while axes accelerate to a feed and stop again."""

    start: Annotated[PoseTable, Field(alias="from", min_length=1)]
    to: Annotated[PoseTable, Field(min_length=1)]
    pose: Text | None = None
    feeds: Feeds
    time_constant: PositiveTime
    ramp: Literal["linear", "s_curve", "exponential"] = "linear"
    jerk_time: PositiveTime | None = None
    outputs: Channels | None = None
    sampling: PositiveFrequency = 2500.0
    lowpass: PositiveFrequency | None = None
    filter: Literal["zero_phase", "causal"] = "zero_phase"
    residual_time: PositiveTime = 0.3
    cut: PathCutTable | None = None
    pose_model: Literal["pose_dependent", "frozen"] | None = None
    estimate: Flag = True

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.ramp == "s_curve" and self.jerk_time is None:
            raise problem(
                'an S-curve needs the time in which the acceleration is reached; write jerk_time = "30 ms"'
            )
        if self.ramp != "s_curve" and self.jerk_time is not None:
            raise problem('only an S-curve has a jerk_time; remove it, or write ramp = "s_curve"')
        if self.jerk_time is not None and self.jerk_time > self.time_constant:
            raise problem(
                f"jerk_time is {1e3 * self.jerk_time:g} ms and longer than the time_constant of {1e3 * self.time_constant:g} ms;"
                " shorten it"
            )
        if self.lowpass is not None and self.sampling <= 2.0 * self.lowpass:
            raise problem(
                f"a low-pass at {self.lowpass:g} Hz needs more than {2.0 * self.lowpass:g} samples a second, and sampling is"
                f' {self.sampling:g} Hz; write for example sampling = "{5.0 * self.lowpass:g} Hz"'
            )
        return self
