"""The Tripteor as bodies in absolute coordinates: sleeves, beams, platform, wrist and spindle on
joints, springs at the leg tips.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.mechanisms.exechon import ExechonDimensions
from headstock.solvers.mechanisms.dynamics import MechanismBody
from headstock.validation.mechanisms.absolute_bodies import (
    AbsoluteSystem,
    DotProduct,
    Local,
    PointToPoint,
    Spring,
    Vector,
    fixed_local,
)
from headstock.validation.mechanisms.motion import DriveLaw

X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
BODY_NAMES = (
    "sleeve_1",
    "sleeve_2",
    "sleeve_3",
    "beam_1",
    "beam_2",
    "beam_3",
    "platform",
    "wrist",
    "spindle",
)
PLATFORM, WRIST, SPINDLE = 6, 7, 8


@dataclass(frozen=True, eq=False)
class LegStiffness:
    """Stiffness across a leg [N/m], and along it as compliance = constant + per_length times its
    length.
    """

    across: float
    constant: float
    per_length: float


def absolute_exechon(
    dimensions: ExechonDimensions,
    bodies: dict[str, MechanismBody],
    legs: LegStiffness,
    drive: DriveLaw,
    gravity: FloatArray,
) -> AbsoluteSystem:
    """Nine bodies with 54 velocities and 48 independent constraints: six motions are left, those of
    the springs.

    Args:
        bodies: By the names above; a leg's sleeve is given about its base joint, its beam about its
            tip, the platform about its origin, wrist and spindle about the wrist centre.
        drive: Three lengths and two wrist angles at a time.
        gravity: ``(3,)`` in the base frame [m/s^2].
    """
    ordered = [bodies[name] for name in BODY_NAMES]
    builder = _Builder(dimensions, [body.center for body in ordered], drive)
    constraints = [*builder.leg_joints(), *builder.wrist_joints()]
    springs = []
    for leg in range(3):
        across, along = builder.leg_springs(leg)
        springs += [
            Spring(across, lambda time: legs.across),
            Spring(along, _axial(legs, drive, leg)),
        ]
    return AbsoluteSystem(
        mass=np.array([body.mass for body in ordered]),
        inertia=np.array([body.inertia for body in ordered]),
        constraints=tuple(constraints),
        springs=tuple(springs),
        gravity=gravity,
        load=builder.point(SPINDLE, (0.0, 0.0, dimensions.tool_length)),
    )


def _axial(legs: LegStiffness, drive: DriveLaw, leg: int) -> Callable[[float], float]:
    return lambda time: 1.0 / (legs.constant + legs.per_length * float(drive(time).position[leg]))


@dataclass(frozen=True, eq=False)
class _Builder:
    dimensions: ExechonDimensions
    centers: list[FloatArray]
    drive: DriveLaw

    def point(self, body: int, place: tuple[float, float, float]) -> Vector:
        """Return a point of a body, given in its own frame."""
        return Vector(body, fixed_local(tuple(np.array(place) - self.centers[body])))

    def leg_joints(self) -> list[DotProduct]:
        """Base joints, telescopes and platform joints; the redundant two of leg 2 are left out."""
        found: list[DotProduct] = []
        for leg in range(3):
            sleeve, beam = leg, 3 + leg
            center = self.point(sleeve, (0.0, 0.0, -self._offset(leg)))
            base = Vector(None, fixed_local(self._base(leg)))
            found += [
                DotProduct(PointToPoint(base, center), Vector(None, fixed_local(axis)))
                for axis in (X, Y, Z)
            ]
            if leg < 2:
                # universal joint: the second axis stays square to the common one; the offset turns
                # with the first axis only
                found.append(DotProduct(vector(sleeve, X), vector(None, Y)))
            found += self._telescope(sleeve, beam, leg)
        found += self._platform_joint(0, X, ("position", "y", "z"))
        found += self._platform_joint(1, X, ("z",))
        found += self._platform_joint(2, Y, ("position", "x", "z"))
        return found

    def leg_springs(self, leg: int) -> tuple[DotProduct, DotProduct]:
        """Across the leg in its plane of motion, and along it."""
        reach = PointToPoint(self.point(3 + leg, (0.0, 0.0, 0.0)), self._platform_point(leg))
        return DotProduct(reach, vector(3 + leg, Y if leg < 2 else X)), DotProduct(
            reach, vector(3 + leg, Z)
        )

    def wrist_joints(self) -> list[DotProduct]:
        """Wrist on the platform, spindle on the wrist, at prescribed angles."""
        x, z = self.dimensions.wrist
        center = self.point(PLATFORM, (x, 0.0, z))
        found = self._weld(center, self.point(WRIST, (0.0, 0.0, 0.0)))
        found += [
            DotProduct(vector(WRIST, Z), vector(PLATFORM, X)),
            DotProduct(vector(WRIST, Z), vector(PLATFORM, Y)),
            DotProduct(vector(WRIST, X), Vector(PLATFORM, self._turning(3, (0, 1)))),
        ]
        found += self._weld(
            self.point(WRIST, (0.0, 0.0, 0.0)), self.point(SPINDLE, (0.0, 0.0, 0.0))
        )
        return [
            *found,
            DotProduct(vector(SPINDLE, Y), vector(WRIST, X)),
            DotProduct(vector(SPINDLE, Y), vector(WRIST, Z)),
            DotProduct(vector(SPINDLE, Z), Vector(WRIST, self._turning(4, (2, 0)))),
        ]

    def _offset(self, leg: int) -> float:
        if leg < 2 and self.dimensions.universal_offsets[leg]:
            raise ValueError("this model has universal joints with axes that meet")
        return 0.0

    def _base(self, leg: int) -> tuple[float, float, float]:
        place = self.dimensions.base[leg]
        return (0.0, place, 0.0) if leg < 2 else (place, 0.0, 0.0)

    def _platform_point(self, leg: int) -> Vector:
        place = self.dimensions.platform[leg]
        height = self.dimensions.platform_heights[leg] if leg < 2 else 0.0
        return self.point(PLATFORM, (0.0, place, height) if leg < 2 else (place, 0.0, 0.0))

    def _telescope(self, sleeve: int, beam: int, leg: int) -> list[DotProduct]:
        reach = PointToPoint(self.point(sleeve, (0.0, 0.0, 0.0)), self.point(beam, (0.0, 0.0, 0.0)))

        def length(time: float) -> tuple[float, float, float]:
            drive = self.drive(time)
            return (
                float(drive.position[leg]),
                float(drive.speed[leg]),
                float(drive.acceleration[leg]),
            )

        return [
            DotProduct(vector(beam, X), vector(sleeve, Y)),
            DotProduct(vector(beam, X), vector(sleeve, Z)),
            DotProduct(vector(beam, Y), vector(sleeve, Z)),
            DotProduct(reach, vector(sleeve, X)),
            DotProduct(reach, vector(sleeve, Y)),
            # last, so that its multiplier is easily found
            DotProduct(reach, vector(sleeve, Z), length),
        ]

    def _platform_joint(
        self, leg: int, axis: tuple[float, float, float], fixed: tuple[str, ...]
    ) -> list[DotProduct]:
        reach = PointToPoint(self.point(3 + leg, (0.0, 0.0, 0.0)), self._platform_point(leg))
        directions = {"x": X, "y": Y, "z": Z}
        return [
            DotProduct(reach, vector(3 + leg, axis))
            if name == "position"
            else DotProduct(vector(PLATFORM, axis), vector(3 + leg, directions[name]))
            for name in fixed
        ]

    def _weld(self, first: Vector, second: Vector) -> list[DotProduct]:
        return [
            DotProduct(PointToPoint(first, second), Vector(None, fixed_local(axis)))
            for axis in (X, Y, Z)
        ]

    def _turning(self, index: int, plane: tuple[int, int]) -> Local:
        """Square to where the turned axis points: the second axis of a plane, turned by a driven
        angle.
        """
        first, second = (np.eye(3)[axis] for axis in plane)

        def local(time: float) -> tuple[FloatArray, FloatArray, FloatArray]:
            drive = self.drive(time)
            angle, speed, change = (
                float(part[index]) for part in (drive.position, drive.speed, drive.acceleration)
            )
            along, square = (
                np.cos(angle) * first + np.sin(angle) * second,
                np.cos(angle) * second - np.sin(angle) * first,
            )
            return square, -speed * along, -change * along - speed**2 * square

        return local


def vector(body: int | None, local: tuple[float, float, float]) -> Vector:
    """Return a direction fixed in a body or in space."""
    return Vector(body, fixed_local(local))
