"""Generalised-α time integration of a linear system whose matrices change along a path.

``M(t) x'' + C(t) x' + K(t) x = f(t) + J(t)^T F``, and the tool moves by ``J(t) x + R(t) F``: the
modes that are left out contribute the residual flexibility ``R`` at the tool. All systems of this
form are integrated alike: a lumped mechanism in its compliant coordinates, a machine of bodies or
finite elements in its modes.

Motors under control are coordinates, and the states of their controllers are rows of first order.
Coordinates are deviations from the rigid machine at its set points, so that a controller reads the
deviation of its motor: with set speed ``v`` and acceleration ``a`` its inputs are
``(0, v, a, x, v + x')``, and the force of the rigid motion is a load on its motor.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.drives import (
    CONTROL_INPUTS,
    MEASURED,
    MOTOR_SPEED,
    SET_ACCELERATION,
    SET_SPEED,
    AxisControl,
    LinearBlock,
)
from headstock.solvers.control.drive_loops import make_controller
from headstock.solvers.control.linear_blocks import stack_blocks
from headstock.solvers.errors import ConvergenceError
from headstock.solvers.motion.friction import CoordinateFriction

INVERSE_TOLERANCE = 1e-10  # of an interpolated inverse: its product with the matrix less identity
MOST_PARTS = 64  # of the trajectory between two nodes
CHUNK = 512  # steps evaluated together: more would not fit into the cache


@dataclass(frozen=True)
class AlphaScheme:
    """Define generalised-α time integration by its spectral radius at infinite frequency: 1 keeps
    high frequencies, 0 eliminates them in one step.

    Source: Chung and Hulbert (1993); Arnold and Brüls (2007).
    """

    rho: float = 0.9

    @property
    def alpha_m(self) -> float:
        """Share of the old auxiliary acceleration."""
        return (2.0 * self.rho - 1.0) / (self.rho + 1.0)

    @property
    def alpha_f(self) -> float:
        """Share of the old acceleration."""
        return self.rho / (self.rho + 1.0)

    @property
    def gamma(self) -> float:
        """Newmark's gamma, for second order."""
        return 0.5 + self.alpha_f - self.alpha_m

    @property
    def beta(self) -> float:
        """Newmark's beta, for the most damping of high frequencies."""
        return 0.25 * (self.gamma + 0.5) ** 2


@dataclass(frozen=True, eq=False)
class LinearMotion:
    """Describe the linear model along a path: matrices at nodes, linear between them.

    Attributes:
        times: ``(n,)`` even steps [s].
        nodes: ``(k,)`` even times at which matrices are given [s].
        mass: ``(k, c, c)``.
        damping: ``(k, c, c)``.
        stiffness: ``(k, c, c)``.
        tool: ``(k, 3, c)`` motion of the tool per coordinate, in the axes that forces are given in.
        gravity_deflection: ``(k, c)`` static deflection under gravity alone.
        load: ``(n, c)`` inertial and gravity load of the rigid motion.
        flexibility: ``(k, 3, 3)`` residual flexibility of the modes left out at the tool; None
            where none is.
        rest: ``(n, 3)`` static motion of the tool by the modes left out under the load.
        friction: Friction on coordinates; None without friction, and where it acts by the set
            speeds only.
    """

    times: FloatArray
    nodes: FloatArray
    mass: FloatArray
    damping: FloatArray
    stiffness: FloatArray
    tool: FloatArray
    gravity_deflection: FloatArray
    load: FloatArray
    flexibility: FloatArray | None = None
    rest: FloatArray | None = None
    friction: CoordinateFriction | None = None

    def between(self, values: FloatArray, part: slice) -> FloatArray:
        """Return values ``(k, ...)`` at the nodes, interpolated to some of the steps."""
        return interpolate_nodes(self.times[part], self.nodes, values)

    def apply(self, values: FloatArray, others: FloatArray) -> FloatArray:
        """Return products ``(n, p)`` of matrices ``(k, p, c)`` at the nodes with vectors ``(n, c)``
        at the steps.
        """
        parts = [
            apply_matrices(self.between(values, part), others[part])
            for part in chunk_slices(len(others))
        ]
        return np.concatenate(parts)

    def deflect(self, part: slice = slice(None)) -> FloatArray:
        """Return the static deflection ``(m, c)`` under gravity alone at some of the steps."""
        return self.between(self.gravity_deflection, part)

    def tool_motion(self, compliant: FloatArray) -> FloatArray:
        """Return the tool motion ``(n, 3)`` at coordinates ``(n, c)``, by the modes kept."""
        return self.apply(self.tool, compliant)

    def tool_load(self, force: FloatArray) -> FloatArray:
        """Return the load ``(n, c)`` of forces ``(n, 3)`` on the tool."""
        parts = [
            (force[part][:, None, :] @ self.between(self.tool, part))[:, 0]
            for part in chunk_slices(len(force))
        ]
        return np.concatenate(parts)

    def tool_rest(self, force: FloatArray) -> FloatArray:
        """Return the motion ``(n, 3)`` of the tool by the modes left out, under forces ``(n, 3)``
        on it and the load.
        """
        rest = np.zeros((len(self.times), 3)) if self.rest is None else self.rest
        if self.flexibility is None:
            return rest
        return rest + self.apply(self.flexibility, force)


@dataclass(frozen=True, eq=False)
class CompliantHistory:
    """Store coordinates over time: ``(n, c)`` values, rates and accelerations."""

    compliant: FloatArray
    rate: FloatArray
    acceleration: FloatArray


@dataclass(frozen=True, eq=False)
class Regeneration:
    """Describe regenerative cutting forces, by the surface that the previous tooth left.

    Attributes:
        stiffness: ``(n, 3, 3)`` force on the tool per motion since the previous tooth [N/m], axes
            of the tool's motion.
        delay: Steps from tooth to tooth.
    """

    stiffness: FloatArray
    delay: int


def integrate_linear(
    motion: LinearMotion,
    load: FloatArray,
    *,
    regeneration: Regeneration | None = None,
) -> CompliantHistory:
    """Integrate the linear model by generalised-α steps, from static equilibrium.

    Args:
        motion: The linear model at ``n`` even steps.
        load: ``(n, c)`` generalised load [N, N m].
        regeneration: Regenerative cutting force; None for a load that depends on time alone.

    Raises:
        ConvergenceError: The motion grows without bound, as regeneration can make it.
    """
    times, size = motion.times, load.shape[1]
    steps = AlphaSteps(motion)
    state = steps.rest(load[0])
    history = np.empty((len(times), 3, size))
    history[0] = state[:3]
    delay = 0 if regeneration is None else regeneration.delay
    for part in chunk_slices(len(times)):
        wave = None if regeneration is None else _wave_stiffness(motion, part, regeneration)
        for number in range(max(part.start, 1), part.stop):
            if wave is None:
                state = steps.advance(number, state, load[number])
            else:
                past = history[max(0, number - delay), 0]
                state = steps.advance(
                    number, state, load[number], wave=wave[number - part.start], past=past
                )
            history[number] = state[:3]
        if not np.isfinite(state).all():
            raise ConvergenceError(
                f"the motion grows without bound before t = {times[part.stop - 1]:.4g} s: the cut is unstable"
            )
    return CompliantHistory(history[:, 0], history[:, 1], history[:, 2])


class AlphaSteps:
    """Take steps of the generalised-α method along a linear motion, one after the other.

    A state ``(4, c)`` is position, velocity, acceleration and the auxiliary acceleration of the
    method. Each step solves for its acceleration with ``S = M + a C + b K``, which is linear
    between two nodes. Its inverse is interpolated there by parabolas through three points, over as
    many parts of the interval as accuracy needs.
    """

    def __init__(self, motion: LinearMotion) -> None:
        """Prepare steps of a motion, with a spectral radius of 0.9."""
        self._motion = motion
        self._ahead, self.reach = _scheme_matrices(
            AlphaScheme(), float(motion.times[1] - motion.times[0])
        )
        location = (motion.times - motion.nodes[0]) / (motion.nodes[1] - motion.nodes[0])
        left = np.clip(location.astype(np.intp), 0, len(motion.nodes) - 2)
        self._left: list[int] = left.tolist()
        self._share: list[float] = (location - left).tolist()
        self._interval = -1
        self._restoring: FloatArray = np.zeros((0, 0))
        self._inverses: list[FloatArray] = []

    def rest(self, load: FloatArray) -> FloatArray:
        """Return the state ``(4, c)`` of static equilibrium under a load at the first instant."""
        state = np.zeros((4, len(load)))
        state[0] = np.linalg.solve(self._motion.stiffness[0], load)
        return state

    def predict(self, state: FloatArray) -> FloatArray:
        """Return predicted positions ``(c,)`` after a step with the acceleration of a state."""
        return self._ahead[0] @ state + self.reach[0] * state[2]

    def advance(
        self,
        number: int,
        state: FloatArray,
        load: FloatArray,
        *,
        wave: FloatArray | None = None,
        past: FloatArray | None = None,
    ) -> FloatArray:
        """Return the state ``(4, c)`` at a step from that at the step before.

        Args:
            load: Load ``(c,)`` at the step.
            wave: Regenerative stiffness ``(c, c)``: load per change of position since an earlier
                step; None for none.
            past: Position ``(c,)`` at that earlier step.
        """
        # M a + C (v + reach_v a) + K (x + reach_x a) = load, where x and v are what the old state
        # alone leads to
        drift, size = self._ahead @ state, len(load)
        share = self._visit(number)
        restoring_force = self._restoring @ drift[:2].ravel()
        left: FloatArray = load - restoring_force[:size] - share * restoring_force[size:]
        if wave is not None:
            left = np.asarray(left + wave @ (drift[0] - (0.0 if past is None else past)))
        accel = self.respond(number, left)
        if wave is not None:
            softer = self.respond(number, self.reach[0] * wave)
            accel = np.asarray(np.linalg.solve(np.eye(size) - softer, accel))
        if self._motion.friction is not None:
            accel = self._add_friction(self._motion.friction, number, drift=drift, accel=accel)
        return drift + self.reach[:, None] * accel

    def _add_friction(
        self, friction: CoordinateFriction, number: int, *, drift: FloatArray, accel: FloatArray
    ) -> FloatArray:
        """Return accelerations ``(c,)`` with friction, from those without."""
        at = friction.coordinates
        units = np.zeros((len(accel), len(at)))
        units[at, np.arange(len(at))] = 1.0
        pushed = self.respond(number, units)
        speeds = drift[1, at] + self.reach[1] * accel[at]
        return accel + pushed @ friction.settle(number, speeds, self.reach[1] * pushed[at])

    def respond(self, number: int, load: FloatArray) -> FloatArray:
        """Return the accelerations ``(c,)`` or ``(c, k)`` at a step by loads of the same shape."""
        location = self._visit(number) * len(self._inverses)
        part = min(int(location), len(self._inverses) - 1)
        share, size = location - part, len(load)
        product = self._inverses[part] @ load
        return product[:size] + share * (product[size : 2 * size] + share * product[2 * size :])

    def _visit(self, number: int) -> float:
        """Return the position of a step between two nodes, with the matrices there cached."""
        if self._left[number] != self._interval:
            self._interval = self._left[number]
            ends = slice(self._interval, self._interval + 2)
            mass, damping, stiffness = (
                values[ends]
                for values in (self._motion.mass, self._motion.damping, self._motion.stiffness)
            )
            restoring = np.concatenate([stiffness, damping], axis=-1)
            self._restoring = np.concatenate([restoring[0], restoring[1] - restoring[0]])
            self._inverses = _tabulate_inverse(
                mass + self.reach[1] * damping + self.reach[0] * stiffness
            )
        return self._share[number]


def _tabulate_inverse(ends: FloatArray) -> list[FloatArray]:
    """Return the inverse of a matrix that is linear from one end to the other: ``(3 c, c)``
    coefficients of a parabola over each of equal parts, the constant above the slope above the
    square.

    Args:
        ends: ``(2, c, c)``.
    """
    first, change, unit = ends[0], ends[1] - ends[0], np.eye(ends.shape[-1])
    parts = 1
    while True:
        exact = np.linalg.inv(first + np.linspace(0.0, 1.0, 2 * parts + 1)[:, None, None] * change)
        low, middle, high = exact[:-2:2], exact[1:-1:2], exact[2::2]
        square = 2.0 * (low - 2.0 * middle + high)
        slope = high - low - square
        # the interpolation error is largest a quarter into the first and into the last part
        places = np.array([0.25, parts - 0.75]) / parts
        missed = [
            unit - (first + at * change) @ (low[part] + 0.25 * (slope[part] + 0.25 * square[part]))
            for at, part in zip(places, (0, -1), strict=True)
        ]
        if np.abs(missed).max() < INVERSE_TOLERANCE or parts >= MOST_PARTS:
            return list(np.concatenate([low, slope, square], axis=1))
        parts *= 2


class _SchemeMatrices(NamedTuple):
    """Store one step of position, velocity, acceleration, auxiliary:
    ``ahead @ old + reach * new acceleration``, ``(4, 4)`` and ``(4,)``.
    """

    ahead: FloatArray
    reach: FloatArray


def _scheme_matrices(scheme: AlphaScheme, h: float) -> _SchemeMatrices:
    """Return the matrices of a scheme for steps of ``h`` seconds."""
    am, af, gamma, beta = scheme.alpha_m, scheme.alpha_f, scheme.gamma, scheme.beta
    share = (1.0 - af) / (1.0 - am)
    rest = np.array([0.0, 0.0, af, -am]) / (1.0 - am)
    unit = np.eye(4)
    position = unit[0] + h * unit[1] + h * h * ((0.5 - beta) * unit[3] + beta * rest)
    velocity = unit[1] + h * ((1.0 - gamma) * unit[3] + gamma * rest)
    reach = np.array([h * h * beta * share, h * gamma * share, 1.0, share])
    return _SchemeMatrices(np.array([position, velocity, np.zeros(4), rest]), reach)


def _wave_stiffness(motion: LinearMotion, part: slice, regeneration: Regeneration) -> FloatArray:
    tool = motion.between(motion.tool, part)
    return np.swapaxes(tool, -1, -2) @ regeneration.stiffness[part] @ tool


def even_nodes(times: FloatArray, spacing: float) -> FloatArray:
    """Return even times from the first to the last one, at about a given spacing [s]."""
    return np.linspace(times[0], times[-1], max(2, round((times[-1] - times[0]) / spacing) + 1))


def interpolate_nodes(times: FloatArray, nodes: FloatArray, values: FloatArray) -> FloatArray:
    """Interpolate linearly between even nodes; the outer segments extend beyond the ends.

    Args:
        times: ``(n,)`` [s].
        nodes: ``(k,)`` even times, ``k >= 2`` [s].
        values: ``(k, ...)`` at the nodes.

    Returns:
        ``(n, ...)``.
    """
    location = (times - nodes[0]) / (nodes[1] - nodes[0])
    left = np.clip(location.astype(np.intp), 0, len(nodes) - 2)
    share = (location - left).reshape(-1, *([1] * (values.ndim - 1)))
    return (1.0 - share) * values[left] + share * values[left + 1]


def apply_matrices(matrices: FloatArray, vectors: FloatArray) -> FloatArray:
    """Return the products ``(n, p)`` of matrices ``(n, p, c)`` with vectors ``(n, c)``."""
    return (matrices @ vectors[..., None])[..., 0]


def chunk_slices(count: int) -> list[slice]:
    """Return slices of steps that are processed together."""
    return [slice(start, min(start + CHUNK, count)) for start in range(0, count, CHUNK)]


@dataclass(frozen=True, eq=False)
class ServoMotion:
    """Describe a machine along its trajectory with the loops of its drives closed.

    Attributes:
        motion: Linear model in coordinates of the machine, then motors, then controllers.
        control: All controllers in one block.
        speeds: ``(n, d)`` set speeds [m/s].
        accelerations: ``(n, d)`` set accelerations [m/s^2].
        reads: ``(k, d, c + d)`` readings of the position controllers per coordinate, at the nodes.
        fixed_readings: ``(n, d)`` readings that do not depend on coordinates.
    """

    motion: LinearMotion
    motors: slice
    control: LinearBlock
    speeds: FloatArray
    accelerations: FloatArray
    reads: FloatArray
    fixed_readings: FloatArray

    def read(self, history: CompliantHistory) -> FloatArray:
        """Return the deviations ``(n, d)`` of readings from set points [m]."""
        states = history.compliant[:, : self.motors.stop]
        reads = self.motion.between(self.reads, slice(None))
        return (reads @ states[..., None])[..., 0] + self.fixed_readings

    def forces(self, history: CompliantHistory) -> FloatArray:
        """Return the forces of the drives ``(n, d)`` [N]."""
        count, states = self.speeds.shape[1], history.compliant
        read = self.read(history)
        given = np.zeros((len(states), count, CONTROL_INPUTS))
        given[:, :, SET_SPEED], given[:, :, SET_ACCELERATION] = self.speeds, self.accelerations
        given[:, :, MEASURED] = read
        given[:, :, MOTOR_SPEED] = self.speeds + history.rate[:, self.motors]
        flat = given.reshape(len(states), -1)
        return states[:, self.motors.stop :] @ self.control.c.T + flat @ self.control.d.T


def close_motors(
    free: LinearMotion,
    controls: Sequence[AxisControl],
    *,
    speeds: FloatArray,
    accelerations: FloatArray,
    gravity: FloatArray,
    scales: FloatArray,
    fixed_readings: FloatArray | None = None,
) -> ServoMotion:
    """Close the loops of drives along a path.

    Args:
        free: The machine with free motors, its last ``d`` coordinates; its load is that of the
            rigid motion, on a motor minus the force that it needs.
        controls: Controllers of the ``d`` drives.
        speeds: ``(n, d)`` set speeds [m/s].
        accelerations: ``(n, d)`` set accelerations [m/s^2].
        gravity: ``(k, c + d)`` generalised weight at the nodes [N].
        scales: ``(k, d, c + d)`` reading of a linear scale per coordinate.
        fixed_readings: ``(n, d)`` readings that do not depend on coordinates; None for none.
    """
    count, size = len(controls), free.mass.shape[-1]
    block = stack_blocks([make_controller(control) for control in controls])
    order = len(block.a)
    motors, states = slice(size - count, size), slice(size, size + order)
    columns = CONTROL_INPUTS * np.arange(count)
    measured, turned = columns + MEASURED, columns + MOTOR_SPEED
    at_motor = np.zeros((count, size))
    at_motor[:, motors] = np.eye(count)
    on_scale = np.array([control.encoder == "scale" for control in controls])
    reads = np.where(on_scale[:, None], scales, at_motor)
    nodes, whole = len(free.nodes), size + order
    mass, damping, stiffness = (np.zeros((nodes, whole, whole)) for _ in range(3))
    mass[:, :size, :size], damping[:, :size, :size] = free.mass, free.damping
    stiffness[:, :size, :size] = free.stiffness
    # force = c z + d (inputs), z' = a z + b (inputs): rows of the motors and of the states
    damping[:, motors, motors] -= block.d[:, turned]
    damping[:, states, motors] = -block.b[:, turned]
    damping[:, states, states] = np.eye(order)
    stiffness[:, motors, :size] -= block.d[:, measured] @ reads
    stiffness[:, motors, states] = -block.c
    stiffness[:, states, :size] = -block.b[:, measured] @ reads
    stiffness[:, states, states] = -block.a
    read: FloatArray = np.zeros((len(free.times), count))
    if fixed_readings is not None:
        read = np.asarray(np.where(on_scale, fixed_readings, read))
    given = np.zeros((len(free.times), count, CONTROL_INPUTS))
    given[:, :, SET_SPEED], given[:, :, MOTOR_SPEED] = speeds, speeds
    given[:, :, SET_ACCELERATION], given[:, :, MEASURED] = accelerations, read
    flat = given.reshape(len(free.times), -1)
    load = np.zeros((len(free.times), whole))
    load[:, :size] = free.load
    load[:, motors] += flat @ block.d.T
    load[:, states] = flat @ block.b.T
    weight = np.zeros((nodes, whole))
    weight[:, :size] = gravity
    motion = dataclasses.replace(
        free,
        mass=mass,
        damping=damping,
        stiffness=stiffness,
        tool=np.concatenate([free.tool, np.zeros((nodes, 3, order))], axis=-1),
        gravity_deflection=np.asarray(np.linalg.solve(stiffness, weight[..., None])[..., 0]),
        load=load,
    )
    return ServoMotion(motion, motors, block, speeds, accelerations, reads, read)
