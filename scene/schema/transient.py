"""Schema of a transient analysis: loads over time, what moves beforehand, and how long the response
is looked at.
"""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from headstock.scene.requests import Motors
from headstock.scene.schema.types import (
    ChannelName,
    Name,
    Names,
    NotNegativeShare,
    NotNegativeTime,
    Number,
    PositiveFrequency,
    PositiveNumber,
    PositiveTime,
    RequestTable,
    Speed,
    StrictTable,
    Text,
    TimedLoadSize,
    not_both,
    problem,
)

Channels = Annotated[list[ChannelName], Field(min_length=1, max_length=100)]
SAMPLES_PER_PERIOD = 20
MOST_SAMPLES = 500_000
# shape: keys it needs, and keys it may have
SHAPE_KEYS: dict[str, tuple[frozenset[str], frozenset[str]]] = {
    "step": (frozenset(), frozenset({"time"})),
    "ramp": (frozenset({"time"}), frozenset()),
    "half_sine": (frozenset({"time"}), frozenset()),
    "sine": (frozenset({"frequency"}), frozenset({"cycles"})),
    "impulse": (frozenset(), frozenset()),
    "release": (frozenset(), frozenset()),
    "file": (frozenset({"file"}), frozenset()),
}
EXAMPLES = {"time": '"5 ms"', "frequency": '"80 Hz"', "file": '"hammer.csv"', "cycles": "5"}


class TimedLoadTable(StrictTable):
    """A force, a moment or a load of `[loads]` that changes with time."""

    model_config = not_both("at", "load")

    shape: Literal["step", "ramp", "half_sine", "sine", "impulse", "release", "file"]
    """`step` (with `time`: a pulse), `ramp` to its size in `time`, `half_sine` of the length `time`, `sine` of `frequency`, or for some
    `cycles`, `impulse`, `release` (has acted for long and is gone), `file`"""
    at: ChannelName | None = None
    """point or interface and direction: `["tcp", "x"]`"""
    size: TimedLoadSize | None = None
    """force, moment, or impulse; values of a `file` are multiplied by it; default: `1 N` of a `file`, else required beside `at`"""
    load: Text | None = None
    """a load of `[loads]`, or `gravity`, in place of `at`"""
    factor: Number | None = None
    """factor of that load; default: 1"""
    start: NotNegativeTime = 0.0
    """when it begins to act, is released, or strikes"""
    time: PositiveTime | None = None
    """how long it rises or acts; required by `ramp` and `half_sine`; default: a `step` acts on"""
    frequency: PositiveFrequency | None = None
    """frequency of a `sine`, which needs it"""
    cycles: PositiveNumber | None = None
    """how many cycles a `sine` has; default: it goes on"""
    file: Text | None = None
    """CSV file with the columns `time` [s] and `value`, linear between its samples and zero outside"""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if (self.at is None) == (self.load is None):
            raise problem('needs either at = ["tcp", "x"] or the name of a load of [loads]')
        if self.at is not None:
            if not self.at[1]:
                raise problem(
                    f'a load acts in one direction; write at = ["{self.at[0]}", "x"] and its size'
                )
            if self.factor is not None:
                raise problem("`factor` goes with `load`; write the size of this one as `size`")
            if self.size is None and self.shape != "file":
                raise problem('has no size; write for example size = "100 N"')
        elif self.size is not None:
            raise problem("a load of [loads] has its size there; write a `factor` of it")
        elif self.shape == "impulse":
            raise problem(
                'an impulse acts in a direction of a point; write at = ["tcp", "x"] and size = "2 N s"'
            )
        needed, allowed = SHAPE_KEYS[self.shape]
        for key, example in EXAMPLES.items():
            given = getattr(self, key) is not None
            if key in needed and not given:
                raise problem(
                    f"shape {self.shape} needs {key}; write for example {key} = {example}"
                )
            if given and key not in needed | allowed:
                raise problem(f"shape {self.shape} has no {key}; remove it")
        return self


class TransientTable(RequestTable):
    """Motion of points under loads that change with time."""

    loads: Annotated[dict[Name, TimedLoadTable], Field(max_length=100)] = {}
    """forces, moments and loads of `[loads]` over time, by name"""
    velocity: Annotated[
        dict[Text, Annotated[list[Speed], Field(min_length=3, max_length=3)]],
        Field(max_length=1000),
    ] = {}
    """velocity of components before the time zero, machine axes: `{ table = ["100 mm/s", "0 m/s", "0 m/s"] }`; joints turn it into the
    motion with the same momentum"""
    duration: PositiveTime
    """how long the motion is computed, from the time zero"""
    up_to: PositiveFrequency = 1000.0
    """modes up to this frequency vibrate; those above follow the loads at once"""
    sampling: PositiveFrequency | None = None
    """samples per second, more than twice `up_to`; default: 20 times `up_to`"""
    settled: NotNegativeShare = 0.02
    """share of the way to the rest position (of the peak, where there is no way) within which an output has settled"""
    outputs: Channels | None = None
    """where the motion is computed: `[["tcp", "z"], "fillet"]`, with a probe; default: all points in x, y, z and all probes"""
    motors: Motors = "locked"
    """as in `[analyses.frf]`; with the effect `friction` guides rub"""
    poses: Names | None = None
    """poses in which it is computed; default: all of them"""

    @property
    def samples_per_second(self) -> float:
        """As written, or enough for the highest mode kept [Hz]."""
        return self.sampling or SAMPLES_PER_PERIOD * self.up_to

    @model_validator(mode="after")
    def _check(self) -> Self:
        if not self.loads and not self.velocity:
            raise problem(
                'nothing moves the machine; write loads.hit = { at = ["tcp", "x"], shape = "impulse", size = "1 N s" }'
            )
        if self.sampling is not None and self.sampling < 2.0 * self.up_to:
            raise problem(
                f"sampling is {self.sampling:g} Hz, and modes up to {self.up_to:g} Hz need more than"
                f' {2.0 * self.up_to:g}; write sampling = "{SAMPLES_PER_PERIOD * self.up_to:g} Hz", or a lower up_to'
            )
        samples = self.duration * self.samples_per_second
        if not 1.0 <= samples <= MOST_SAMPLES:
            raise problem(
                f"{self.duration:g} s at {self.samples_per_second:g} Hz are {samples:.3g} samples, and from 1 to"
                f" {MOST_SAMPLES} are possible; change duration, sampling or up_to"
            )
        return self
