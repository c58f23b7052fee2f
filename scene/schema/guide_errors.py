"""Schema of the errors of guides and drives: profiles along rails, screws and axes."""

from collections.abc import Iterator
from itertools import pairwise
from typing import Annotated

from pydantic import Field

from headstock.scene.reading.findings import KeyPath
from headstock.scene.reading.units import Quantity
from headstock.scene.schema import types

RAIL_KEYS = ("axial", "lateral", "normal", "roll", "pitch", "yaw")
MOTION_KEYS = ("EX", "EY", "EZ", "EA", "EB", "EC")
MOST_TERMS = 10_000
Values = Annotated[list[types.AxisPosition], Field(min_length=2, max_length=MOST_TERMS)]


class _ErrorWaveTable(types.StrictTable):
    """A wave along a rail, a screw or an axis."""

    period: types.PositiveAxisPosition
    """length of one wave"""
    amplitude: types.AxisPosition
    """half of the wave's height"""
    phase: types.Angle = 0.0
    """phase at position zero"""


class _ErrorPointsTable(types.StrictTable):
    """Measured values with straight lines between them."""

    at: Values
    """positions, rising"""
    values: Values
    """values of the error, one per position"""

    def _faults(self) -> Iterator[str]:
        if len(self.at) != len(self.values):
            yield f"has {len(self.at)} positions and {len(self.values)} values; write one value per position"
        places = [position.value for position in self.at]
        if any(later <= earlier for earlier, later in pairwise(places)):
            yield "its positions do not rise; sort them, each once"


class ProfileTable(types.StrictTable):
    """An error over the position: the sum of measured points, a polynomial and waves."""

    points: _ErrorPointsTable | None = None
    """measured values with straight lines between them: `{ at = ["0 mm", "100 mm"], values = ["0 um", "2 um"] }`"""
    polynomial: Annotated[list[types.AxisPosition], Field(min_length=1, max_length=12)] | None = (
        None
    )
    """coefficients of the powers 0, 1, 2, ... of the position over `over`: `["0 um", "2 um"]` with `over = "100 mm"` rises by 2 um per 100
    mm"""
    over: types.PositiveAxisPosition | None = None
    """position at which every term of the polynomial is its coefficient; required from the second coefficient on"""
    waves: Annotated[list[_ErrorWaveTable], Field(min_length=1, max_length=100)] | None = None
    """sum of `amplitude sin(2 pi s / period + phase)` over the position s"""

    def _faults(self) -> Iterator[str]:
        if self.points is None and self.polynomial is None and self.waves is None:
            yield 'has no values; write waves = [{ period = "400 mm", amplitude = "1 um" }], or points or polynomial'
        if (self.over is None) != (self.polynomial is None or len(self.polynomial) < 2):
            yield (
                "a polynomial of the position and the length of its terms go together; write"
                ' polynomial = ["0 um", "2 um"] and over = "100 mm": 2 um per 100 mm'
            )

    def positions(self) -> Iterator[tuple[KeyPath, Quantity]]:
        """Yield every position or period, with its key."""
        if self.points is not None:
            yield from ((("points", "at", index), one) for index, one in enumerate(self.points.at))
        if self.over is not None:
            yield ("over",), self.over
        for index, wave in enumerate(self.waves or ()):
            yield ("waves", index, "period"), wave.period

    def amounts(self) -> Iterator[tuple[KeyPath, Quantity]]:
        """Yield every value of the error itself, with its key."""
        values = [] if self.points is None else self.points.values
        yield from ((("points", "values", index), one) for index, one in enumerate(values))
        yield from ((("polynomial", index), one) for index, one in enumerate(self.polynomial or ()))
        for index, wave in enumerate(self.waves or ()):
            yield ("waves", index, "amplitude"), wave.amplitude


class _BallPassingTable(types.StrictTable):
    """Waves that the balls of a carriage or a nut make as they enter and leave the load zone."""

    period: types.PositiveLength
    """travel from one ball to the next"""
    phase: types.Angle = 0.0
    """phase where the carriage is at the origin of what it slides on; `each` gives carriages their own"""
    axial: types.AxisPosition | None = None
    """amplitude along the screw"""
    lateral: types.AxisPosition | None = None
    """amplitude along the joint's y axis"""
    normal: types.AxisPosition | None = None
    """amplitude along the joint's z axis"""
    roll: types.AxisPosition | None = None
    """amplitude about the rail"""
    pitch: types.AxisPosition | None = None
    """amplitude about the joint's y axis"""
    yaw: types.AxisPosition | None = None
    """amplitude about the joint's z axis"""

    def amplitudes(self) -> dict[str, Quantity]:
        """Those given, by direction."""
        return self.given(RAIL_KEYS)


class RailErrorsTable(types.StrictTable):
    """Errors of the rail or the screw that a joint slides along, in joint axes; used with the effect
    `guide_errors`.
    """

    axial: ProfileTable | None = None
    """lead error of a screw, over the position"""
    lateral: ProfileTable | None = None
    """straightness along the joint's y axis; its slope also turns the carriage about the normal"""
    normal: ProfileTable | None = None
    """straightness along the joint's z axis; its slope also tilts the carriage"""
    roll: ProfileTable | None = None
    """angular error about the rail"""
    pitch: ProfileTable | None = None
    """angular error about the joint's y axis"""
    yaw: ProfileTable | None = None
    """angular error about the joint's z axis"""
    length: types.PositiveLength | None = None
    """length over which a carriage averages the profiles; default: its `length` on a rail, else it is a point"""
    ball_passing: _BallPassingTable | None = None
    """waves of the carriage itself, which nothing averages"""

    def profiles(self) -> dict[str, ProfileTable]:
        """Those given, by direction."""
        return self.given(RAIL_KEYS)


class AxisErrorsTable(types.StrictTable):
    """Error motions of an axis by the symbols of ISO 230-1 without its name: `EY` of axis `X` is
    `EYX`; used with the effect `guide_errors`.
    """

    EX: ProfileTable | None = None
    """translation along x of what the axis moves, over its position"""
    EY: ProfileTable | None = None
    """translation along y of what the axis moves, over its position"""
    EZ: ProfileTable | None = None
    """translation along z of what the axis moves, over its position"""
    EA: ProfileTable | None = None
    """rotation about x of what the axis moves, over its position"""
    EB: ProfileTable | None = None
    """rotation about y of what the axis moves, over its position"""
    EC: ProfileTable | None = None
    """rotation about z of what the axis moves, over its position"""
    EA0: types.Angle = 0.0
    """squareness: rotation of the line of motion about x, from position zero; what moves keeps its orientation"""
    EB0: types.Angle = 0.0
    """squareness: rotation of the line of motion about y, as `EA0`"""
    EC0: types.Angle = 0.0
    """squareness: rotation of the line of motion about z, as `EA0`"""
    at: types.Position | None = None
    """functional point on what it moves, all axes at zero, to which EX, EY and EZ belong; default: the middle of its joints"""

    def profiles(self) -> dict[str, ProfileTable]:
        """Those given, by symbol."""
        return self.given(MOTION_KEYS)

    def squareness(self) -> dict[str, float]:
        """Rotations of the line of motion about x, y and z, by symbol [rad]."""
        return {"EA0": self.EA0, "EB0": self.EB0, "EC0": self.EC0}
