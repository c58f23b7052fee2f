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
    """the milling tool"""
    spindle: PositiveAngularSpeed
    """speed of the spindle"""
    axial_depth: PositiveLength
    """depth of cut along the tool"""
    radial_depth: PositiveLength
    """depth of cut across the tool, at most its diameter"""
    sense: Literal["down", "up"] = "down"
    """`down` (climb): teeth leave at the finished face; `up` (conventional): they enter there"""
    part_side: Literal["right", "left"] | None = None
    """side of the travel on which the part lies; default: where a clockwise tool mills in this sense"""
    material: Text
    """workpiece material: of `[cutting.NAME]`, or of the [catalogue](cutting_coefficients.md)"""
    at: Text | None = None
    """point where the tool is; default: the first one"""
    up: Direction = (0.0, 0.0, 1.0)
    """direction from the tool's tip to its holder"""


class PathTable(RequestTable):
    """How far a point leaves the straight line while axes accelerate to a feed and stop again."""

    start: Annotated[PoseTable, Field(alias="from", min_length=1)]
    """start position of the axes: `{ X = "-40 mm" }`"""
    to: Annotated[PoseTable, Field(min_length=1)]
    """end position; every axis, linear or rotary, has a constant share of the way"""
    pose: Text | None = None
    """pose that gives the position of all other axes; default: zero"""
    feeds: Feeds
    """feed rates; the path is computed once for each; of the linear travel where a linear axis moves, else an angular speed such as `"3600
    deg/min"`"""
    time_constant: PositiveTime
    """feed divided by acceleration; for exponential ramps the time constant of the lag"""
    ramp: Literal["linear", "s_curve", "exponential"] = "linear"
    """`linear`: constant acceleration; `s_curve`: its jerk limited too; `exponential`: a first-order lag"""
    jerk_time: PositiveTime | None = None
    """acceleration divided by jerk; required by an S-curve, and at most `time_constant`"""
    outputs: Channels | None = None
    """where the deviation is computed: `[["tcp", "z"]]`; default: all points in x, y and z"""
    sampling: PositiveFrequency = 2500.0
    """samples per second, more than twice `lowpass`"""
    lowpass: PositiveFrequency | None = None
    """cut-off frequency of a fourth-order Butterworth low-pass filter applied to the deviation; default: none"""
    filter: Literal["zero_phase", "causal"] = "zero_phase"
    """`zero_phase`: forwards and backwards, without delay; `causal`: once, as a measuring instrument does"""
    residual_time: PositiveTime = 0.3
    """time after a ramp over which residual vibration is evaluated, also recorded after the end"""
    cut: PathCutTable | None = None
    """milling along the path; used with the effect `cutting_force`"""
    pose_model: Literal["pose_dependent", "frozen"] | None = None
    """`pose_dependent`: the machine's matrices change along the path; `frozen`: those at mid-path are used throughout; default:
    `pose_dependent`, but `frozen` for axes under control"""
    estimate: Flag = True
    """± of its numbers, for which machines of components make the moves once more per mesh and for modes left out"""

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
