"""Motion of a compliant mechanism whose drives follow a given law: as an ODE in the compliant
coordinates, and as the full DAE.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from headstock.geometry.errors import ClosureError, SingularPoseError
from headstock.geometry.frames import FloatArray
from headstock.geometry.mechanisms.closures import (
    close_chains,
    closure_residual,
    evaluate_kinematics,
)
from headstock.solvers.mechanisms.dynamics import (
    CompliantMechanism,
    MechanismDynamics,
    evaluate_dynamics,
    gravity_energy,
    kinetic_energy,
)
from headstock.solvers.mechanisms.partitioning import (
    Drive,
    PartitionedDynamics,
    compose_state,
    driven_forces,
    partition_dynamics,
)
from headstock.validation.mechanisms.generalized_alpha import Linearisation, MotionState

DriveLaw = Callable[[float], Drive]
ForceLaw = Callable[[float], FloatArray]


@dataclass(eq=False)
class PartitionedMotion:
    """The reduced ODE in the compliant coordinates (eq. 10); also a problem for
    :func:`integrate_motion`.

    Attributes:
        drive: Driven coordinates at a time.
        force: ``(3,)`` force on the tool at a time, ground frame of the chains [N].
        guess: A closed state near the start; kept up to date, so that the passive coordinates stay
            on their branch.
    """

    model: CompliantMechanism
    drive: DriveLaw
    force: ForceLaw
    guess: FloatArray

    def at(self, time: float, compliant: FloatArray, rates: FloatArray) -> PartitionedDynamics:
        """Equations of motion at a time and state.

        Args:
            time: [s].
            compliant: ``(c,)`` compliant coordinates [m, rad].
            rates: ``(c,)`` their velocities [m/s, rad/s].

        Raises:
            SingularPoseError: The passive coordinates are undetermined.
        """
        drive = self.drive(time)
        try:
            self.guess, kinematics = compose_state(
                self.model.mechanism, drive.position, compliant, self.guess
            )
            return partition_dynamics(
                self.model, self.guess, kinematics, drive, rates=rates, force=self.force(time)
            )
        except (ClosureError, np.linalg.LinAlgError) as error:
            raise SingularPoseError(
                f"at t = {time:.6g} s: {error}; the motion ends at a singular pose"
            ) from error

    def accelerations(self, time: float, compliant: FloatArray, rates: FloatArray) -> FloatArray:
        """Accelerations ``(c,)`` of the compliant coordinates [m/s^2, rad/s^2].

        Args:
            time: [s].
            compliant: ``(c,)`` compliant coordinates [m, rad].
            rates: ``(c,)`` their velocities [m/s, rad/s].

        Raises:
            SingularPoseError: The passive coordinates are undetermined.
        """
        motion = self.at(time, compliant, rates)
        return np.asarray(np.linalg.solve(motion.mass, self._balance(motion, compliant, rates)))

    def state_rates(self, time: float, both: FloatArray) -> FloatArray:
        """First-order form for a library integrator: ``(2 c + 1,)`` = compliant coordinates, their
        rates, work put in [J].
        """
        count = (len(both) - 1) // 2
        compliant, rates = both[:count], both[count : 2 * count]
        motion = self.at(time, compliant, rates)
        accelerations: FloatArray = np.asarray(
            np.linalg.solve(motion.mass, self._balance(motion, compliant, rates))
        )
        return np.concatenate(
            [rates, accelerations, [self._power(time, motion, rates, accelerations)]]
        )

    def energy(self, time: float, compliant: FloatArray, rates: FloatArray) -> float:
        """Kinetic, gravity and spring energy [J].

        Args:
            time: [s].
            compliant: ``(c,)`` compliant coordinates [m, rad].
            rates: ``(c,)`` their velocities [m/s, rad/s].

        Raises:
            SingularPoseError: The passive coordinates are undetermined.
        """
        motion = self.at(time, compliant, rates)
        kinetic = kinetic_energy(motion.dynamics, motion.rates)
        springs = 0.5 * (motion.stiffness * compliant**2).sum()
        return float(kinetic + gravity_energy(self.model, motion.dynamics.placement) + springs)

    def drives(self, time: float, state: MotionState) -> FloatArray:
        """Forces ``(u,)`` of the drives [N, N m]."""
        motion = self.at(time, state.position, state.velocity)
        return driven_forces(self.model, motion, state.acceleration, self.force(time))

    def residual(self, state: MotionState) -> tuple[FloatArray, FloatArray]:
        """Unbalanced forces, no constraints."""
        motion = self.at(state.time, state.position, state.velocity)
        return motion.mass @ state.acceleration - self._balance(
            motion, state.position, state.velocity
        ), np.zeros(0)

    def linearise(self, state: MotionState) -> Linearisation:
        """Mass, damping and springs; gyroscopic and geometric terms are small beside them."""
        motion = self.at(state.time, state.position, state.velocity)
        size = len(state.position)
        return Linearisation(
            motion.mass, _damping(self.model, size), np.diag(motion.stiffness), np.zeros((0, size))
        )

    def start(self, time: float, compliant: FloatArray, rates: FloatArray) -> MotionState:
        """A consistent start: accelerations from the equations of motion.

        Args:
            time: [s].
            compliant: ``(c,)`` compliant coordinates [m, rad].
            rates: ``(c,)`` their velocities [m/s, rad/s].

        Raises:
            SingularPoseError: The passive coordinates are undetermined.
        """
        return MotionState(
            time, compliant, rates, self.accelerations(time, compliant, rates), np.zeros(0)
        )

    def _balance(
        self, motion: PartitionedDynamics, compliant: FloatArray, rates: FloatArray
    ) -> FloatArray:
        return np.asarray(
            motion.load
            - motion.stiffness * compliant
            - _damping(self.model, len(compliant)) @ rates
        )

    def _power(
        self, time: float, motion: PartitionedDynamics, rates: FloatArray, accelerations: FloatArray
    ) -> float:
        force, drive = self.force(time), self.drive(time)
        tool = force @ (motion.dynamics.tool @ motion.rates)
        drives = driven_forces(self.model, motion, accelerations, force) @ drive.speed
        return float(drives + tool - rates @ _damping(self.model, len(rates)) @ rates)


class _EvaluatedMotion(NamedTuple):
    """Dynamics at a state of motion, with all coordinates ``(n,)`` [m, rad] and accelerations
    ``(n,)`` [m/s^2, rad/s^2].
    """

    dynamics: MechanismDynamics
    coordinates: FloatArray
    accelerations: FloatArray


@dataclass(eq=False)
class ConstrainedMotion:
    """The full DAE in passive and compliant coordinates with its multipliers (eq. 6), for
    :func:`integrate_motion`.

    Attributes:
        drive: Driven coordinates at a time.
        force: ``(3,)`` force on the tool at a time [N].
    """

    model: CompliantMechanism
    drive: DriveLaw
    force: ForceLaw
    last: tuple[MotionState, MechanismDynamics] | None = field(default=None, init=False)

    @property
    def free(self) -> slice:
        """Passive and compliant coordinates among all."""
        return slice(
            self.model.mechanism.passive_slice.start, len(self.model.mechanism.coordinates)
        )

    def evaluate(self, state: MotionState) -> _EvaluatedMotion:
        """Evaluate the equations of motion at a state of motion."""
        drive = self.drive(state.time)
        coordinates = np.concatenate([drive.position, state.position])
        rates = np.concatenate([drive.speed, state.velocity])
        accelerations = np.concatenate([drive.acceleration, state.acceleration])
        dynamics = evaluate_dynamics(
            self.model, evaluate_kinematics(self.model.mechanism, coordinates), rates
        )
        return _EvaluatedMotion(dynamics, coordinates, accelerations)

    def residual(self, state: MotionState) -> tuple[FloatArray, FloatArray]:
        """Unbalanced forces ``(n - u,)`` and open loops ``(m,)``."""
        dynamics, coordinates, accelerations = self.evaluate(state)
        self.last = state, dynamics
        balance = self._balance(state, dynamics, coordinates, accelerations)
        return balance[self.free], closure_residual(
            self.model.mechanism, coordinates, dynamics.placement
        )

    def linearise(self, state: MotionState) -> Linearisation:
        """Mass, damping and springs, and the closures' Jacobian."""
        dynamics = (
            self.last[1]
            if self.last is not None and self.last[0] is state
            else self.evaluate(state).dynamics
        )
        size, compliant = len(state.position), len(self.model.mechanism.compliant)
        stiffness, damping = np.zeros((size, size)), np.zeros((size, size))
        springs = self.model.springs.stiffness(self.drive(state.time).position)
        last = slice(size - compliant, size)
        stiffness[last, last] = np.diag(springs)
        damping[last, last] = _damping(self.model, compliant)
        return Linearisation(
            dynamics.mass[self.free, self.free],
            damping,
            stiffness,
            dynamics.closure_jacobian[:, self.free],
        )

    def start(self, time: float, position: FloatArray, velocity: FloatArray) -> MotionState:
        """A consistent start: accelerations and multipliers from the equations of motion and the
        closures' second derivative.

        Args:
            time: [s].
            position: ``(n_free,)`` passive and compliant coordinates with the loops closed [m,
                rad].
            velocity: ``(n_free,)`` their velocities, consistent with the closures [m/s, rad/s].

        Raises:
            SingularPoseError: The closures are redundant there, so that multipliers are not unique.
        """
        zero = MotionState(time, position, velocity, np.zeros_like(position), np.zeros(0))
        dynamics, coordinates, accelerations = self.evaluate(zero)
        inner = dynamics.closure_jacobian[:, self.free]
        count, size = inner.shape
        matrix = np.zeros((size + count, size + count))
        matrix[:size, :size] = dynamics.mass[self.free, self.free]
        matrix[:size, size:] = inner.T
        matrix[size:, :size] = inner
        bare = MotionState(time, position, velocity, zero.acceleration, np.zeros(count))
        force = self._balance(bare, dynamics, coordinates, accelerations)[self.free]
        outer = (
            dynamics.closure_jacobian[:, self.model.mechanism.driven_slice]
            @ accelerations[self.model.mechanism.driven_slice]
        )
        if np.linalg.matrix_rank(inner) < count:
            raise SingularPoseError(
                f"at t = {time:.6g} s the loop closures are redundant: joint forces are not unique"
            )
        found = np.linalg.solve(matrix, np.concatenate([-force, -dynamics.closure_bias - outer]))
        return MotionState(time, position, velocity, found[:size], found[size:])

    def drives(self, state: MotionState) -> FloatArray:
        """Forces ``(u,)`` of the drives [N, N m], from the multipliers."""
        dynamics, coordinates, accelerations = self.evaluate(state)
        balance = self._balance(state, dynamics, coordinates, accelerations)[
            self.model.mechanism.driven_slice
        ]
        driven = coordinates[self.model.mechanism.driven_slice]
        compliant = coordinates[self.model.mechanism.compliant_slice]
        np.add.at(
            balance,
            self.model.springs.length,
            0.5 * self.model.springs.stiffness_slope(driven) * compliant**2,
        )
        return balance

    def _balance(
        self,
        state: MotionState,
        dynamics: MechanismDynamics,
        coordinates: FloatArray,
        accelerations: FloatArray,
    ) -> FloatArray:
        compliant = self.model.mechanism.compliant_slice
        balance = (
            dynamics.mass @ accelerations - dynamics.load - dynamics.tool.T @ self.force(state.time)
        )
        if len(state.multipliers):
            balance += dynamics.closure_jacobian.T @ state.multipliers
        springs = self.model.springs.stiffness(coordinates[self.model.mechanism.driven_slice])
        count = len(self.model.mechanism.compliant)
        balance[compliant] += (
            springs * coordinates[compliant]
            + _damping(self.model, count) @ state.velocity[len(state.velocity) - count :]
        )
        return np.asarray(balance)


@dataclass(frozen=True)
class StartReport:
    """How far a start was from the constraints, and what it was moved by.

    Attributes:
        constraint_violation: Largest violation of a closure as given [m, rad].
        open_rates: Largest rate of violation after the positions were corrected.
        moved: Largest change of a position.
        slowed: Largest change of a velocity.
    """

    constraint_violation: float
    open_rates: float
    moved: float
    slowed: float


def project_start(
    problem: ConstrainedMotion, time: float, position: FloatArray, velocity: FloatArray
) -> tuple[MotionState, StartReport]:
    """A consistent start near a given one: passive coordinates by Newton's method, velocities by
    least kinetic energy of the change.

    Args:
        problem: The equations of motion with the law of the drives.
        time: [s].
        position: ``(n_free,)`` passive and compliant coordinates near a closed state [m, rad].
        velocity: ``(n_free,)`` their velocities [m/s, rad/s].

    Returns:
        The start, and by how much the given one missed the closures and was changed.

    Raises:
        ClosureError: The loops cannot be closed from there.
    """
    mechanism, drive = problem.model.mechanism, problem.drive(time)
    given = np.concatenate([drive.position, position])
    closed = close_chains(mechanism, given)
    kinematics = evaluate_kinematics(mechanism, closed)
    inner = kinematics.closure_jacobian[:, problem.free]
    rates = inner @ velocity + kinematics.closure_jacobian[:, mechanism.driven_slice] @ drive.speed
    mass = evaluate_dynamics(problem.model, kinematics).mass[problem.free, problem.free]
    count, size = inner.shape
    matrix = np.block([[mass, inner.T], [inner, np.zeros((count, count))]])
    change = np.linalg.solve(matrix, np.concatenate([np.zeros(size), -rates]))[:size]
    report = StartReport(
        float(np.abs(closure_residual(mechanism, given)).max()),
        float(np.abs(rates).max()),
        float(np.abs(closed - given).max()),
        float(np.abs(change).max()),
    )
    return problem.start(time, closed[problem.free], velocity + change), report


def _damping(model: CompliantMechanism, size: int) -> FloatArray:
    return np.zeros((size, size)) if model.damping is None else model.damping
