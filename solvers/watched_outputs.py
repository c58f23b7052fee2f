"""Outputs of a motion in time whose largest values are wanted: forces of drives and joints, and
what else states and loads say.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.solvers.second_order import Channel, Index


@dataclass(frozen=True)
class Extreme:
    """The value of largest size, with its sign, and when it occurs [s]."""

    value: float
    time: float


@dataclass(frozen=True)
class Watch:
    """Outputs of a system that are watched.

    Attributes:
        channels: ``k`` of them.
        rates: Channel to an output whose rate is added to it, as dampers add to springs.
        accelerations: Channel to an output whose acceleration is added to it.
    """

    channels: tuple[Channel, ...] = ()
    rates: Mapping[Channel, Channel] = field(default_factory=dict)
    accelerations: Mapping[Channel, Channel] = field(default_factory=dict)

    @property
    def outputs(self) -> tuple[Channel, ...]:
        """All outputs that this takes."""
        return (*self.channels, *self.rates.values(), *self.accelerations.values())

    def join(self, other: "Watch") -> "Watch":
        """Return both, one after the other."""
        return Watch(
            (*self.channels, *other.channels),
            {**self.rates, **other.rates},
            {**self.accelerations, **other.accelerations},
        )


@dataclass(frozen=True, eq=False)
class WatchedValues:
    """What watched outputs did.

    Attributes:
        channels: ``k`` of them.
        values: ``(n, k)`` at ``n`` times.
    """

    channels: tuple[Channel, ...] = ()
    values: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))

    def of(self, channels: Iterable[Channel]) -> FloatArray:
        """Return the values ``(n, k')`` of some of them."""
        return self.values[:, Index(self.channels).of(channels)]

    def __add__(self, other: "WatchedValues") -> "WatchedValues":
        """Return these values with what the other adds to them."""
        if not self.channels:
            return self
        return WatchedValues(self.channels, self.values + other.of(self.channels))


@dataclass(frozen=True, eq=False)
class WatchedOutputs:
    """Linear outputs of a state space.

    Attributes:
        states: ``(k, n)`` of its states.
        inputs: ``(k, m)`` of what acts on it.
    """

    states: FloatArray
    inputs: FloatArray

    def evaluate(self, states: FloatArray, acting: FloatArray) -> FloatArray:
        """Return the values ``(..., k)`` at states ``(..., n)`` and inputs ``(..., m)``."""
        return states @ self.states.T + acting @ self.inputs.T


def find_largest(times: FloatArray, values: FloatArray) -> tuple[Extreme, ...]:
    """Find the value of largest size of each column of ``(n, k)`` at times ``(n,)``."""
    rows = np.array(
        [np.abs(column).argmax() for column in values.T], dtype=np.intp
    )  # a column at a time takes little memory
    return tuple(
        Extreme(float(values[row, column]), float(times[row])) for column, row in enumerate(rows)
    )
