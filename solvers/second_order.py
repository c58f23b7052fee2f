"""The one type every analysis takes: a linear second-order system with inputs and outputs by
name.
"""

import functools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray
from headstock.solvers.errors import ModelError

ComplexArray = NDArray[np.complexfloating[Any, Any]]
Channel = tuple[str, str]
ANGLES = ("torque", "motor_angle", "scale_angle", "command_angle")  # of drives of rotary axes
Positions = slice | NDArray[np.intp]
Motion = Literal["receptance", "mobility", "accelerance"]


@dataclass(frozen=True, eq=False)
class SecondOrderSystem:
    """``M q'' + C q' + K q = B f``, ``y = B^T q`` for collocated channels and ``y = L q`` in
    general.

    At a frequency above zero the stiffness is ``K + i H``; at rest and in time there is no ``H``
    (``linear.damping.equivalent_viscous`` puts a viscous damping in its place).

    Attributes:
        mass: ``(n, n)`` symmetric, positive semidefinite.
        damping: ``(n, n)`` viscous, or None.
        stiffness: ``(n, n)``; symmetric unless control or gyroscopic terms are in it.
        inputs: Channel such as ``("tcp", "z")`` to generalised load ``(n,)`` of a unit load
            there.
        outputs: Channel to row ``(n,)`` that gives the motion there.
        hysteretic: ``(n, n)`` imaginary part ``H`` of the complex stiffness (loss factor times
            stiffness), or None.
    """

    mass: FloatArray
    damping: FloatArray | None
    stiffness: FloatArray
    inputs: dict[Channel, FloatArray]
    outputs: dict[Channel, FloatArray]
    labels: tuple[str, ...]
    hysteretic: FloatArray | None = None

    def dynamic_stiffness(self, pole: complex) -> ComplexArray:
        """Return ``s^2 M + s C + K + i H`` ``(n, n)`` for ``s`` above the real axis [rad/s]."""
        dynamic = pole**2 * self.mass + self.stiffness
        if self.damping is not None:
            dynamic = dynamic + pole * self.damping
        return dynamic if self.hysteretic is None else dynamic + 1j * self.hysteretic


@dataclass(frozen=True)
class Index:
    """Where channels stand along an axis of arrays.

    Names become positions once, before any loop over time.

    Attributes:
        channels: In the order of the axis. Of a channel that stands there twice the first counts.
    """

    channels: tuple[Channel, ...]

    def __len__(self) -> int:
        """Return the length of the axis."""
        return len(self.channels)

    @functools.cached_property
    def _places(self) -> dict[Channel, int]:
        numbered = enumerate(reversed(self.channels))
        return {channel: len(self) - 1 - number for number, channel in numbered}

    def of(self, channels: Iterable[Channel]) -> Positions:
        """Return the positions of channels in their order: a slice, which copies nothing, where
        they stand side by side.

        Raises:
            ModelError: A channel does not stand there.
        """
        wanted = tuple(channels)
        for channel in wanted:
            if channel not in self._places:
                names = ", ".join(map(name_channel, self.channels))
                raise ModelError(f"there is no channel {name_channel(channel)!r}; known: {names}")
        places = np.array([self._places[channel] for channel in wanted], dtype=np.intp)
        first = int(places[0]) if wanted else 0
        if np.array_equal(places, first + np.arange(len(wanted))):
            return slice(first, first + len(wanted))
        return places


def input_columns(system: SecondOrderSystem, inputs: Sequence[Channel]) -> FloatArray:
    """Return the generalised loads ``(n, n_inputs)`` of unit loads.

    Raises:
        ModelError: There is no such input.
    """
    return (
        np.array([_find(system.inputs, channel, "input") for channel in inputs])
        .reshape(len(inputs), len(system.mass))
        .T
    )


def output_rows(system: SecondOrderSystem, outputs: Sequence[Channel]) -> FloatArray:
    """Return the rows ``(n_outputs, n)`` that give the motions.

    Raises:
        ModelError: There is no such output.
    """
    return np.array([_find(system.outputs, channel, "output") for channel in outputs]).reshape(
        len(outputs), len(system.mass)
    )


def is_rotation(channel: Channel) -> bool:
    """Return whether a channel is an angle or a moment."""
    return channel[1].startswith("r") or channel[1] in ANGLES


def name_channel(channel: Channel) -> str:
    """Return the name of a channel, such as ``tcp x``."""
    return f"{channel[0]} {channel[1]}"


def _find(channels: dict[Channel, FloatArray], channel: Channel, what: str) -> FloatArray:
    if channel not in channels:
        names = sorted({name for name, _ in channels})
        raise ModelError(
            f"there is no {what} {name_channel(channel)!r}; points and interfaces: {names}, directions x y z rx ry rz"
        )
    return channels[channel]
