"""Mechanisms as data: chains of elementary motions from ground, and the closures that make loops of
them.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

from headstock.geometry.frames import FloatArray

AxisName = Literal["x", "y", "z"]
AXES: tuple[AxisName, ...] = ("x", "y", "z")


@dataclass(frozen=True)
class Step:
    """An elementary motion about or along an axis of the frame it starts from.

    Attributes:
        kind: ``rotation`` about the axis or ``translation`` along it.
        axis: Axis of the frame that the steps before it lead to.
        coordinate: Name of the coordinate that drives it; None for a fixed step.
        amount: Fixed part [rad or m], added to the coordinate.
    """

    kind: Literal["rotation", "translation"]
    axis: AxisName
    coordinate: str | None = None
    amount: float = 0.0


@dataclass(frozen=True)
class Marker:
    """A name for the frame that the steps before it lead to: a body, a joint centre, the tool."""

    name: str


ChainItem = Step | Marker


def revolute(axis: AxisName, by: str | float) -> Step:
    """Return the rotation about an axis by a coordinate or a fixed angle [rad]."""
    return Step("rotation", axis, by) if isinstance(by, str) else Step("rotation", axis, None, by)


def prismatic(axis: AxisName, by: str | float) -> Step:
    """Return the translation along an axis by a coordinate or a fixed length [m]."""
    if isinstance(by, str):
        return Step("translation", axis, by)
    return Step("translation", axis, None, by)


@dataclass(frozen=True)
class PointConstraint:
    """Two markers coincide in some directions: ``axes`` of the frame of a third marker, of ground
    where
    there is none.
    """

    first: str
    second: str
    axes: tuple[AxisName, ...] = AXES
    frame: str | None = None


@dataclass(frozen=True)
class OrientationConstraint:
    """Two markers have the same orientation about some axes of the first: components of ``vee
    skew(R1^T R2)`` vanish.
    """

    first: str
    second: str
    axes: tuple[AxisName, ...] = AXES


@dataclass(frozen=True)
class CoordinateConstraint:
    """A weighted sum of coordinates equals a value, as angles in a plane do."""

    weights: Mapping[str, float]
    value: float = 0.0


Closure = PointConstraint | OrientationConstraint | CoordinateConstraint


@dataclass(frozen=True, eq=False)
class Mechanism:
    """A mechanism: open chains from ground, closed into loops.

    Attributes:
        chains: Each a row of steps and markers, from the ground frame outwards; chains may share
            coordinates.
        closures: What makes loops of the chains.
        driven: Coordinates that drives prescribe, ``u``.
        compliant: Coordinates of lumped compliances, ``delta``, zero on the rigid mechanism; every
            other coordinate is passive, ``v``.

    Raises:
        ValueError: A name means nothing or means two things.
    """

    name: str
    chains: tuple[tuple[ChainItem, ...], ...]
    closures: tuple[Closure, ...]
    driven: tuple[str, ...]
    compliant: tuple[str, ...] = ()
    passive: tuple[str, ...] = field(init=False)

    def __post_init__(self) -> None:
        used = [
            step.coordinate
            for chain in self.chains
            for step in chain
            if isinstance(step, Step) and step.coordinate
        ]
        named = (*self.driven, *self.compliant)
        unknown = sorted(set(named) - set(used))
        if unknown or len(set(named)) < len(named):
            raise ValueError(
                f"{self.name}: driven and compliant coordinates must be different ones of the chains, not {unknown}"
            )
        object.__setattr__(
            self, "passive", tuple(name for name in dict.fromkeys(used) if name not in named)
        )
        if len(set(self.markers)) < len(self.markers):
            raise ValueError(f"{self.name}: a marker is named twice among {[*self.markers]}")
        for closure in self.closures:
            wrong = sorted(
                _names_in(closure)
                - set(used if isinstance(closure, CoordinateConstraint) else self.markers)
            )
            if wrong:
                raise ValueError(
                    f"{self.name}: a loop closure names {', '.join(wrong)}, which the chains do not have"
                )

    @cached_property
    def coordinates(self) -> tuple[str, ...]:
        """Every coordinate: driven, passive, compliant."""
        return (*self.driven, *self.passive, *self.compliant)

    @cached_property
    def markers(self) -> tuple[str, ...]:
        """Every marker, chain by chain."""
        return tuple(
            item.name for chain in self.chains for item in chain if isinstance(item, Marker)
        )

    @cached_property
    def driven_slice(self) -> slice:
        """Return where the driven coordinates stand among all."""
        return slice(0, len(self.driven))

    @cached_property
    def passive_slice(self) -> slice:
        """Return where the passive coordinates stand among all."""
        return slice(len(self.driven), len(self.driven) + len(self.passive))

    @cached_property
    def compliant_slice(self) -> slice:
        """Return where the compliant coordinates stand among all."""
        return slice(len(self.driven) + len(self.passive), len(self.coordinates))

    def index(self, coordinate: str) -> int:
        """Return the place of a coordinate among all."""
        return self.coordinates.index(coordinate)


def wrap_angles(angles: FloatArray) -> FloatArray:
    """Return the angles [rad] brought into -pi .. pi."""
    turn_around = 6.283185307179586
    return angles - turn_around * (angles / turn_around).round()


def _names_in(closure: Closure) -> set[str]:
    if isinstance(closure, CoordinateConstraint):
        return set(closure.weights)
    names = {closure.first, closure.second}
    if isinstance(closure, PointConstraint) and closure.frame is not None:
        return names | {closure.frame}
    return names
