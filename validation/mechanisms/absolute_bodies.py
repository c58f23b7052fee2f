"""Rigid bodies in absolute coordinates, every joint a few scalar products that keep a value: a
model without chains or angles.

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

Local = Callable[[float], tuple[FloatArray, FloatArray, FloatArray]]


def fixed_local(vector: Sequence[float]) -> Local:
    """Return a vector that does not move in its body."""
    value = np.array(vector, dtype=float)
    return lambda time: (value, np.zeros(3), np.zeros(3))


@dataclass(frozen=True, eq=False)
class Vector:
    """A direction in a body, or in space where the body is None."""

    body: int | None
    local: Local


@dataclass(frozen=True, eq=False)
class PointToPoint:
    """From a point of one body to a point of another; points are given from the centres of mass."""

    start: Vector
    end: Vector


@dataclass(frozen=True, eq=False)
class DotProduct:
    """``x . y = c(t)`` as a constraint; as a spring, its length; ``value`` gives c with its two
    derivatives.
    """

    first: Vector | PointToPoint
    second: Vector
    value: Callable[[float], tuple[float, float, float]] = lambda time: (0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Spring:
    """A linear spring along a product, its stiffness [N/m] a function of time, with a viscous
    damper [N s/m].
    """

    product: DotProduct
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
    constraints: tuple[DotProduct, ...]
    springs: tuple[Spring, ...]
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
    """A vector in motion: value, rate, bias acceleration and Jacobian ``(3, 6 b)`` by all
    velocities.
    """

    value: FloatArray
    rate: FloatArray
    bias: FloatArray
    jacobian: FloatArray


class ScalarMotion(NamedTuple):
    """A number in motion: value, rate, bias acceleration and Jacobian ``(6 b,)`` by all
    velocities.
    """

    value: float
    rate: float
    bias: float
    jacobian: FloatArray


@dataclass(frozen=True, eq=False)
class AbsoluteSolution:
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

    def of(self, item: Vector | PointToPoint) -> Motion:
        if id(item) not in self.known:
            self.known[id(item)] = (
                self._point_to_point(item) if isinstance(item, PointToPoint) else self._vector(item)
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

    def _point_to_point(self, item: PointToPoint) -> Motion:
        end, start = self.point(item.end), self.point(item.start)
        return Motion(
            end.value - start.value,
            end.rate - start.rate,
            end.bias - start.bias,
            end.jacobian - start.jacobian,
        )

    def product(self, item: DotProduct) -> ScalarMotion:
        """Motion of a scalar product."""
        x, y = self.of(item.first), self.of(item.second)
        value, rate = float(x.value @ y.value), float(x.rate @ y.value + x.value @ y.rate)
        bias = float(x.bias @ y.value + 2.0 * x.rate @ y.rate + x.value @ y.bias)
        return ScalarMotion(value, rate, bias, y.value @ x.jacobian + x.value @ y.jacobian)


def solve_instant(
    system: AbsoluteSystem, time: float, state: AbsoluteState, force: FloatArray
) -> AbsoluteSolution:
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
    return AbsoluteSolution(
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
        applied[place[0]], applied[place[1]] = (
            kilograms * system.gravity,
            -_cross(spin, inertia @ spin),
        )
    return mass, applied


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.array(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )
