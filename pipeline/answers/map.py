"""A lumped mechanism as a result: quantities on a grid of poses, and its positions in a pose."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.mechanisms.exechon import (
    LENGTHS,
    TOOL_POINT,
    ToolMechanism,
    condition_numbers,
)
from headstock.pipeline.answers.answer import Answer, Entry
from headstock.pipeline.numbers.numbers import Number, Series, make_key
from headstock.pipeline.storage.json_texts import check_finite, nest_known

# ending of the name of a quantity: its SI unit, and the factor to it
UNITS = {"_hz": ("Hz", 1.0), "_n_per_um": ("N/m", 1e6), "_m": ("m", 1.0)}


class PoseGrid(Protocol):
    """Quantities over a grid of poses."""

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the two or three axes of the grid."""

    @property
    def positions(self) -> tuple[FloatArray, ...]:
        """Their positions [m, rad]."""

    @property
    def fixed(self) -> dict[str, float]:
        """Positions of the other axes."""

    @property
    def axis_units(self) -> dict[str, str]:
        """Axis to ``m`` or ``rad``."""

    @property
    def quantities(self) -> dict[str, FloatArray]:
        """Name to ``(n0, n1, ...)`` values, NaN where the pose cannot be taken."""


@dataclass(frozen=True, eq=False)
class WorkspaceMap(Answer):
    """Quantities over a grid of poses.

    Attributes:
        axes: Names of the two or three axes of the grid.
        positions: Their positions [m, rad].
        fixed: Positions of the other axes.
        quantities: Name to ``(n0, n1, ...)`` values, NaN where the pose cannot be taken. ``f1_hz``
            is one mode, followed by its shape, the one with the lowest median.
        mac: Least squared cosine between modes of the same number in neighbouring poses; 1 is
            the same shape.
        crossings: Numbers of modes whose order changes somewhere.
        tracking_breaks: How many pairs of neighbours hold a mode in shapes that do not look alike.
        trend: Correlation of the first frequency with the mean leg length.
    """

    axes: tuple[str, ...]
    positions: tuple[FloatArray, ...]
    fixed: dict[str, float]
    quantities: dict[str, FloatArray]
    mac: float
    crossings: tuple[tuple[int, int], ...]
    tracking_breaks: int
    trend: float
    entry: ClassVar[str] = "map"
    keys: ClassVar[
        str
    ] = """map(axes[] units.* positions[][] fixed.* quantities.*.** least_mac crossings[][]
        tracking_breaks f1_and_mean_leg_correlation)"""

    @property
    def axis_units(self) -> dict[str, str]:
        """Axis to ``m`` or ``rad``."""
        return {axis: "m" if axis in TOOL_POINT else "rad" for axis in (*self.axes, *self.fixed)}

    def list_numbers(self) -> Iterator[Number]:
        """Yield the least and the largest value of every quantity that some pose has."""
        for name, values in self.quantities.items():
            unit, factor = _find_unit(name)
            for figure, pick in (("least", np.nanmin), ("most", np.nanmax)):
                if np.isfinite(values).any():
                    key = make_key("map_extreme", quantity=name, figure=figure)
                    yield Number(key, factor * float(pick(values)), unit)

    def list_series(self) -> Iterator[Series]:
        """Yield every quantity over the grid."""
        axes = name_axes(self)
        for name, values in self.quantities.items():
            unit, factor = _find_unit(name)
            yield Series(f"map({name})", axes, factor * values, unit)

    def summarise(self) -> Entry:
        """As it stands in ``summary.json``."""
        return {
            "axes": list(self.axes),
            "units": self.axis_units,
            "positions": [
                check_finite("positions of the map", values) for values in self.positions
            ],
            "fixed": self.fixed,
            "least_mac": self.mac,
            "crossings": list(self.crossings),
            "tracking_breaks": self.tracking_breaks,
            "f1_and_mean_leg_correlation": self.trend,
            "quantities": {name: nest_known(values) for name, values in self.quantities.items()},
        }


def _find_unit(quantity: str) -> tuple[str, float]:
    """Return SI unit of a quantity, and factor to it from the unit that its name ends with."""
    return next((unit for end, unit in UNITS.items() if quantity.endswith(end)), ("1", 1.0))


def name_axes(grid: PoseGrid) -> dict[str, FloatArray]:
    """Return the positions of each axis of a grid by its name and unit, as a series has them."""
    return {
        f"{axis} [{grid.axis_units[axis]}]": values
        for axis, values in zip(grid.axes, grid.positions, strict=True)
    }


@dataclass(frozen=True)
class MechanismPose(Answer):
    """A closed-loop mechanism in a pose.

    Attributes:
        coordinates: Of driven and passive joints [m, rad].
        condition_number: How well its drives command the wrist centre.
    """

    pose: str
    coordinates: dict[str, float]
    condition_number: float
    entry: ClassVar[str] = "mechanism"
    keys: ClassVar[str] = """mechanism.*(coordinates.* condition_number)"""

    def list_numbers(self) -> Iterator[Number]:
        """Yield the coordinates and the condition number."""
        for name, value in self.coordinates.items():
            key = make_key("joint_coordinate", pose=self.pose, joint=name)
            yield Number(key, value, "m" if name in LENGTHS else "rad")
        yield Number(make_key("condition_number", pose=self.pose), self.condition_number, "1")

    def summarise(self) -> Entry:
        """As it stands in ``summary.json``."""
        return {"coordinates": self.coordinates, "condition_number": self.condition_number}


def describe_state(mechanism: ToolMechanism, pose: str, state: FloatArray) -> MechanismPose:
    """Coordinates and condition number of a mechanism in a pose.

    Args:
        state: ``(n,)`` closed state in it.
    """
    known = mechanism.mounted.mechanism
    coordinates = {
        name: float(state[known.index(name)]) for name in (*known.driven, *known.passive)
    }
    return MechanismPose(pose, coordinates, float(condition_numbers(known, state)))
