"""Rigid bodies in absolute coordinates, every joint a few scalar products that keep a value, and the
Tripteor of such bodies: a model without chains or angles.

Each constraint and each spring is ``x . y = c(t)`` of two vectors that are body-fixed, fixed in
space, prescribed in a body, or the difference of two points. Value, rate, Jacobian and bias follow
from those of the vectors (de Jalón and Bayo 1994, ch. 2; Nikravesh 1988). Accelerations and
multipliers solve the index-1 equations ``[M G^T; G 0] [a; lam] = [f; -gamma]``. Written to check
the chain model, so nothing of it is used here.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from headstock.geometry.frames import FloatArray, skew
from headstock.geometry.mechanisms.exechon import ExechonDimensions
from headstock.solvers.mechanisms.dynamics import MechanismBody
from headstock.validation.mechanisms.motion import DriveLaw

Local = Callable[[float], tuple[FloatArray, FloatArray, FloatArray]]

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


def _fixed_local(vector: Sequence[float]) -> Local:
    """Return a vector that does not move in its body."""
    value = np.array(vector, dtype=float)
    return lambda time: (value, np.zeros(3), np.zeros(3))


@dataclass(frozen=True, eq=False)
class Vector:
    """A direction in a body, or in space where the body is None."""

    body: int | None
    local: Local


@dataclass(frozen=True, eq=False)
class _PointToPoint:
    """From a point of one body to a point of another; points are given from the centres of mass."""

    start: Vector
    end: Vector


@dataclass(frozen=True, eq=False)
class _DotProduct:
    """``x . y = c(t)`` as a constraint; as a spring, its length; ``value`` gives c with its two
    derivatives.
    """

    first: Vector | _PointToPoint
    second: Vector
    value: Callable[[float], tuple[float, float, float]] = lambda time: (0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class _Spring:
    """A linear spring along a product, its stiffness [N/m] a function of time, with a viscous
    damper [N s/m].
    """

    product: _DotProduct
    stiffness: Callable[[float], float]
    damping: float = 0.0


@dataclass(frozen=True, eq=False)
class AbsoluteSystem:
    """Bodies, constraints and springs.

    Attributes:
        mass: ``(b,)`` [kg].
        inertia: ``(b, 3, 3)`` about the centres of mass, body axes.
        constraints: In order; multipliers come in the same order.
        gravity: ``(3,)`` [m/s^2].
        load: Point of a body at which an outer force acts.
    """

    mass: FloatArray
    inertia: FloatArray
    constraints: tuple[_DotProduct, ...]
    springs: tuple[_Spring, ...]
    gravity: FloatArray
    load: Vector


@dataclass(frozen=True, eq=False)
class AbsoluteState:
    """Where all bodies are and how they move; ``spin`` is the angular velocity in space axes."""

    place: FloatArray
    rotation: FloatArray
    velocity: FloatArray
    spin: FloatArray


@dataclass(frozen=True, eq=False)
class Motion:
    """A vector in motion: value, rate, bias acceleration, Jacobian ``(3, 6 b)`` by velocities."""

    value: FloatArray
    rate: FloatArray
    bias: FloatArray
    jacobian: FloatArray


class _ScalarMotion(NamedTuple):
    """A number in motion: value, rate, bias acceleration, Jacobian ``(6 b,)`` by velocities."""

    value: float
    rate: float
    bias: float
    jacobian: FloatArray


@dataclass(frozen=True, eq=False)
class _AbsoluteSolution:
    """Accelerations and constraint forces at an instant.

    Attributes:
        acceleration: ``(b, 3)``.
        spin_rate: ``(b, 3)`` in space axes.
        multipliers: ``(m,)``.
        stretch: ``(s,)`` length of each spring.
        stretch_acceleration: ``(s,)``.
    """

    acceleration: FloatArray
    spin_rate: FloatArray
    multipliers: FloatArray
    violation: float
    stretch: FloatArray
    stretch_acceleration: FloatArray


@dataclass(eq=False)
class _Vectors:
    """Vectors of a system in a state of motion, each worked out once."""

    time: float
    state: AbsoluteState
    known: dict[int, Motion] = field(default_factory=dict)

    def of(self, item: Vector | _PointToPoint) -> Motion:
        if id(item) not in self.known:
            self.known[id(item)] = (
                self._point_to_point(item)
                if isinstance(item, _PointToPoint)
                else self._vector(item)
            )
        return self.known[id(item)]

    def _vector(self, item: Vector) -> Motion:
        value, rate, change = item.local(self.time)
        size = 6 * len(self.state.place)
        if item.body is None:
            return Motion(value, rate, change, np.zeros((3, size)))
        rotation, spin = self.state.rotation[item.body], self.state.spin[item.body]
        out, drift = rotation @ value, rotation @ rate
        jacobian = np.zeros((3, size))
        jacobian[:, 6 * item.body + 3 : 6 * item.body + 6] = -skew(out)
        turning = _cross(spin, out)
        bias = _cross(spin, turning) + 2.0 * _cross(spin, drift) + rotation @ change
        return Motion(out, turning + drift, bias, jacobian)

    def point(self, item: Vector) -> Motion:
        arm = self._vector(item)
        if item.body is None:
            return arm
        jacobian = arm.jacobian.copy()
        jacobian[:, 6 * item.body : 6 * item.body + 3] = np.eye(3)
        place, velocity = self.state.place[item.body], self.state.velocity[item.body]
        return Motion(place + arm.value, velocity + arm.rate, arm.bias, jacobian)

    def _point_to_point(self, item: _PointToPoint) -> Motion:
        end, start = self.point(item.end), self.point(item.start)
        return Motion(
            end.value - start.value,
            end.rate - start.rate,
            end.bias - start.bias,
            end.jacobian - start.jacobian,
        )

    def product(self, item: _DotProduct) -> _ScalarMotion:
        """Motion of a scalar product."""
        x, y = self.of(item.first), self.of(item.second)
        value, rate = float(x.value @ y.value), float(x.rate @ y.value + x.value @ y.rate)
        bias = float(x.bias @ y.value + 2.0 * x.rate @ y.rate + x.value @ y.bias)
        return _ScalarMotion(value, rate, bias, y.value @ x.jacobian + x.value @ y.jacobian)


def solve_instant(
    system: AbsoluteSystem, time: float, state: AbsoluteState, force: FloatArray
) -> _AbsoluteSolution:
    """Accelerations and multipliers at an instant.

    Args:
        system: Bodies, constraints and springs.
        time: [s].
        force: ``(3,)`` outer force at the loaded point [N].
    """
    vectors = _Vectors(time, state)
    mass, applied = _masses(system, state)
    applied += vectors.point(system.load).jacobian.T @ force
    lengths = [vectors.product(spring.product) for spring in system.springs]
    for spring, (value, rate, _, jacobian) in zip(system.springs, lengths, strict=True):
        applied -= jacobian * (spring.stiffness(time) * value + spring.damping * rate)
    rows = [vectors.product(item) for item in system.constraints]
    wanted = [item.value(time) for item in system.constraints]
    jacobian = np.array([row.jacobian for row in rows])
    right = np.array([c[2] - row.bias for row, c in zip(rows, wanted, strict=True)])
    count = len(rows)
    matrix = np.block([[mass, jacobian.T], [jacobian, np.zeros((count, count))]])
    found = np.linalg.solve(matrix, np.concatenate([applied, right]))
    motion = found[: len(mass)].reshape(-1, 6)
    return _AbsoluteSolution(
        acceleration=motion[:, :3],
        spin_rate=motion[:, 3:],
        multipliers=found[len(mass) :],
        violation=max(abs(row.value - c[0]) for row, c in zip(rows, wanted, strict=True)),
        stretch=np.array([row.value for row in lengths]),
        stretch_acceleration=np.array(
            [row.bias + row.jacobian @ found[: len(mass)] for row in lengths]
        ),
    )


def linearise_rest(system: AbsoluteSystem, state: AbsoluteState) -> tuple[FloatArray, FloatArray]:
    """Mass and stiffness over the motions that the constraints leave, at a state of rest with
    unloaded springs.

    A basis of those motions is the null space of the constraints' Jacobian.
    """
    vectors = _Vectors(0.0, state)
    mass = _masses(system, state)[0]
    jacobian = np.array([vectors.product(item)[3] for item in system.constraints])
    _, sizes, right = np.linalg.svd(jacobian)
    basis = right[int((sizes > 1e-9 * sizes[0]).sum()) :].T
    springs = np.array([vectors.product(spring.product)[3] for spring in system.springs]) @ basis
    stiffness = np.array([spring.stiffness(0.0) for spring in system.springs])
    return basis.T @ mass @ basis, springs.T @ (stiffness[:, None] * springs)


def _masses(system: AbsoluteSystem, state: AbsoluteState) -> tuple[FloatArray, FloatArray]:
    """Mass matrix in space axes, and gravity less gyroscopic moments."""
    size = 6 * len(system.mass)
    mass, applied = np.zeros((size, size)), np.zeros(size)
    for body, kilograms in enumerate(system.mass):
        rotation, spin = state.rotation[body], state.spin[body]
        inertia = rotation @ system.inertia[body] @ rotation.T
        place = slice(6 * body, 6 * body + 3), slice(6 * body + 3, 6 * body + 6)
        mass[place[0], place[0]], mass[place[1], place[1]] = kilograms * np.eye(3), inertia
        applied[place[0]] = kilograms * system.gravity
        applied[place[1]] = -_cross(spin, inertia @ spin)
    return mass, applied


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.array(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


@dataclass(frozen=True, eq=False)
class LegStiffness:
    """Stiffness across a leg [N/m]; along it compliance = constant + per_length times length."""

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
            _Spring(across, lambda time: legs.across),
            _Spring(along, _axial(legs, drive, leg)),
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
        return Vector(body, _fixed_local(tuple(np.array(place) - self.centers[body])))

    def leg_joints(self) -> list[_DotProduct]:
        """Base joints, telescopes and platform joints; the redundant two of leg 2 are left out."""
        found: list[_DotProduct] = []
        for leg in range(3):
            sleeve, beam = leg, 3 + leg
            center = self.point(sleeve, (0.0, 0.0, -self._offset(leg)))
            base = Vector(None, _fixed_local(self._base(leg)))
            found += [
                _DotProduct(_PointToPoint(base, center), Vector(None, _fixed_local(axis)))
                for axis in (X, Y, Z)
            ]
            if leg < 2:
                # universal joint: the second axis stays square to the common one; the offset turns
                # with the first axis only
                found.append(_DotProduct(vector(sleeve, X), vector(None, Y)))
            found += self._telescope(sleeve, beam, leg)
        found += self._platform_joint(0, X, ("position", "y", "z"))
        found += self._platform_joint(1, X, ("z",))
        found += self._platform_joint(2, Y, ("position", "x", "z"))
        return found

    def leg_springs(self, leg: int) -> tuple[_DotProduct, _DotProduct]:
        """Across the leg in its plane of motion, and along it."""
        reach = _PointToPoint(self.point(3 + leg, (0.0, 0.0, 0.0)), self._platform_point(leg))
        return _DotProduct(reach, vector(3 + leg, Y if leg < 2 else X)), _DotProduct(
            reach, vector(3 + leg, Z)
        )

    def wrist_joints(self) -> list[_DotProduct]:
        """Wrist on the platform, spindle on the wrist, at prescribed angles."""
        x, z = self.dimensions.wrist
        center = self.point(PLATFORM, (x, 0.0, z))
        found = self._weld(center, self.point(WRIST, (0.0, 0.0, 0.0)))
        found += [
            _DotProduct(vector(WRIST, Z), vector(PLATFORM, X)),
            _DotProduct(vector(WRIST, Z), vector(PLATFORM, Y)),
            _DotProduct(vector(WRIST, X), Vector(PLATFORM, self._turning(3, (0, 1)))),
        ]
        found += self._weld(
            self.point(WRIST, (0.0, 0.0, 0.0)), self.point(SPINDLE, (0.0, 0.0, 0.0))
        )
        return [
            *found,
            _DotProduct(vector(SPINDLE, Y), vector(WRIST, X)),
            _DotProduct(vector(SPINDLE, Y), vector(WRIST, Z)),
            _DotProduct(vector(SPINDLE, Z), Vector(WRIST, self._turning(4, (2, 0)))),
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

    def _telescope(self, sleeve: int, beam: int, leg: int) -> list[_DotProduct]:
        reach = _PointToPoint(
            self.point(sleeve, (0.0, 0.0, 0.0)), self.point(beam, (0.0, 0.0, 0.0))
        )

        def length(time: float) -> tuple[float, float, float]:
            drive = self.drive(time)
            return (
                float(drive.position[leg]),
                float(drive.speed[leg]),
                float(drive.acceleration[leg]),
            )

        return [
            _DotProduct(vector(beam, X), vector(sleeve, Y)),
            _DotProduct(vector(beam, X), vector(sleeve, Z)),
            _DotProduct(vector(beam, Y), vector(sleeve, Z)),
            _DotProduct(reach, vector(sleeve, X)),
            _DotProduct(reach, vector(sleeve, Y)),
            # last, so that its multiplier is easily found
            _DotProduct(reach, vector(sleeve, Z), length),
        ]

    def _platform_joint(
        self, leg: int, axis: tuple[float, float, float], fixed: tuple[str, ...]
    ) -> list[_DotProduct]:
        reach = _PointToPoint(self.point(3 + leg, (0.0, 0.0, 0.0)), self._platform_point(leg))
        directions = {"x": X, "y": Y, "z": Z}
        return [
            _DotProduct(reach, vector(3 + leg, axis))
            if name == "position"
            else _DotProduct(vector(PLATFORM, axis), vector(3 + leg, directions[name]))
            for name in fixed
        ]

    def _weld(self, first: Vector, second: Vector) -> list[_DotProduct]:
        return [
            _DotProduct(_PointToPoint(first, second), Vector(None, _fixed_local(axis)))
            for axis in (X, Y, Z)
        ]

    def _turning(self, index: int, plane: tuple[int, int]) -> Local:
        """Square to the turned axis: the second axis of a plane, turned by a driven angle."""
        first, second = (np.eye(3)[axis] for axis in plane)

        def local(time: float) -> tuple[FloatArray, FloatArray, FloatArray]:
            drive = self.drive(time)
            angle, speed, change = (
                float(part[index]) for part in (drive.position, drive.speed, drive.acceleration)
            )
            along = np.cos(angle) * first + np.sin(angle) * second
            square = np.cos(angle) * second - np.sin(angle) * first
            return square, -speed * along, -change * along - speed**2 * square

        return local


def vector(body: int | None, local: tuple[float, float, float]) -> Vector:
    """Return a direction fixed in a body or in space."""
    return Vector(body, _fixed_local(local))
