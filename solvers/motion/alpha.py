"""A linear system along a path: matrices at times of the motion, integrated in time.

``M(t) x'' + C(t) x' + K(t) x = f(t) + J(t)^T F``, and the tool moves by ``J(t) x + R(t) F``: of the
motions that are left out the static flexibility ``R`` at the tool remains. What has these matrices
is integrated alike: a lumped mechanism in its compliant coordinates, a machine of bodies or finite
elements in its modes.

Motors under control are coordinates of it, and the states of their controllers rows of first order.
Coordinates are deviations from the rigid machine that moves as the set points say, so a controller
sees what its motor lacks: with set speed ``v`` and acceleration ``a`` its inputs are ``(0, v, a, x,
v + x')``, and the force that the rigid motion needs is a load on its motor.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.drives import AxisControl
from headstock.solvers.control.drive_loops import LinearBlock, make_controller, stack_blocks
from headstock.solvers.errors import ConvergenceError
from headstock.solvers.motion.friction import CoordinateFriction

INVERSE_TOLERANCE = 1e-10  # of what an interpolated inverse leaves of the identity
MOST_PARTS = 64  # of the trajectory between two nodes
CHUNK = 512  # states evaluated together: more would leave the cache
INPUTS = 5  # of a controller: set position, speed, acceleration, measured position, motor speed
SPEED, ACCELERATION, POSITION, MOTOR_SPEED = 1, 2, 3, 4


@dataclass(frozen=True)
class AlphaScheme:
    """Parameters of generalised-α time integration for a spectral radius at infinite frequency: 1
    keeps high frequencies, 0 kills them in one step.

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
    """The linear model along a path: matrices at nodes, linear between them.

    Attributes:
        times: ``(n,)`` even steps [s].
        nodes: ``(k,)`` even times of the matrices [s].
        mass: ``(k, c, c)``.
        damping: ``(k, c, c)``.
        stiffness: ``(k, c, c)``.
        tool: ``(k, 3, c)`` motion of the tool per coordinate, in the axes that forces are given in.
        gravity_deflection: ``(k, c)`` static deflection under gravity alone.
        load: ``(n, c)`` inertial and gravity load of the rigid motion.
        flexibility: ``(k, 3, 3)`` static motion of the tool per force on it, of all motions that
            are left out; None where none is.
        rest: ``(n, 3)`` static motion of the tool under the load, of all motions that are left out.
        friction: Friction at the speeds of the motion; None where none depends on it.
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
        """Values ``(k, ...)`` at the nodes, at some of the steps."""
        return interpolate_nodes(self.times[part], self.nodes, values)

    def apply(self, values: FloatArray, others: FloatArray) -> FloatArray:
        """``(n, p)`` products of matrices ``(k, p, c)`` at the nodes with vectors ``(n, c)`` at the
        steps.
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
        """``(n, 3)`` motion of the tool at coordinates ``(n, c)``, of those that are kept."""
        return self.apply(self.tool, compliant)

    def tool_load(self, force: FloatArray) -> FloatArray:
        """``(n, c)`` load of forces ``(n, 3)`` on the tool."""
        parts = [
            (force[part][:, None, :] @ self.between(self.tool, part))[:, 0]
            for part in chunk_slices(len(force))
        ]
        return np.concatenate(parts)

    def tool_rest(self, force: FloatArray) -> FloatArray:
        """``(n, 3)`` motion of the tool by all motions that are left out, under forces ``(n, 3)``
        on it and the load.
        """
        rest = np.zeros((len(self.times), 3)) if self.rest is None else self.rest
        if self.flexibility is None:
            return rest
        return rest + self.apply(self.flexibility, force)


@dataclass(frozen=True, eq=False)
class CompliantHistory:
    """Coordinates over time: ``(n, c)`` values, rates and accelerations."""

    compliant: FloatArray
    rate: FloatArray
    acceleration: FloatArray


@dataclass(frozen=True, eq=False)
class Regeneration:
    """Cutting forces that depend on the wave left by the last tooth.

    Attributes:
        stiffness: ``(n, 3, 3)`` force on the tool per motion since the last tooth [N/m], axes of
            the tool's motion.
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
    """Generalised-α steps of the linear model, from static rest at the first instant.

    Args:
        motion: The linear model at ``n`` even steps.
        load: ``(n, c)`` generalised load [N, N m].
        regeneration: Cutting force by the wave that the last tooth left; None for a load that
            depends on time alone.

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
    """Steps of the generalised-α method along a linear motion, one after the other.

    A state ``(4, c)`` is position, velocity, acceleration and the auxiliary acceleration of the
    method. Each step solves for its acceleration with ``S = M + a C + b K``, which is linear between
    two nodes; the inverse there is a parabola through three of its places, in as many parts of the
    interval as make that exact.
    """

    def __init__(self, motion: LinearMotion) -> None:
        """Steps of a motion, of a spectral radius of 0.9."""
        self._motion = motion
        self._ahead, self.reach = _scheme_matrices(
            AlphaScheme(), float(motion.times[1] - motion.times[0])
        )
        location = (motion.times - motion.nodes[0]) / (motion.nodes[1] - motion.nodes[0])
        left = np.clip(location.astype(np.intp), 0, len(motion.nodes) - 2)
        self._left: list[int] = left.tolist()
        self._share: list[float] = (location - left).tolist()
        self._interval = -1
        self._pull: FloatArray = np.zeros((0, 0))
        self._inverses: list[FloatArray] = []

    def rest(self, load: FloatArray) -> FloatArray:
        """The state ``(4, c)`` of static rest under a load at the first instant."""
        state = np.zeros((4, len(load)))
        state[0] = np.linalg.solve(self._motion.stiffness[0], load)
        return state

    def foresee(self, state: FloatArray) -> FloatArray:
        """Positions ``(c,)`` after a step with the acceleration of a state."""
        return np.asarray(self._ahead[0] @ state + self.reach[0] * state[2])

    def advance(
        self,
        number: int,
        state: FloatArray,
        load: FloatArray,
        *,
        wave: FloatArray | None = None,
        past: FloatArray | None = None,
    ) -> FloatArray:
        """The state ``(4, c)`` at a step from that at the step before.

        Args:
            load: ``(c,)`` at it.
            wave: ``(c, c)`` load per position of the step since an earlier one; None for none.
            past: ``(c,)`` that position.
        """
        # M a + C (v + reach_v a) + K (x + reach_x a) = load, where x and v are what the old state
        # alone leads to
        drift, size = self._ahead @ state, len(load)
        share = self._visit(number)
        pulled = self._pull @ drift[:2].ravel()
        left: FloatArray = load - pulled[:size] - share * pulled[size:]
        if wave is not None:
            left = np.asarray(left + wave @ (drift[0] - (0.0 if past is None else past)))
        accel = self.respond(number, left)
        if wave is not None:
            softer = self.respond(number, self.reach[0] * wave)
            accel = np.asarray(np.linalg.solve(np.eye(size) - softer, accel))
        if self._motion.friction is not None:
            accel = self._add_friction(self._motion.friction, number, drift=drift, accel=accel)
        return np.asarray(drift + self.reach[:, None] * accel)

    def _add_friction(
        self, friction: CoordinateFriction, number: int, *, drift: FloatArray, accel: FloatArray
    ) -> FloatArray:
        """Accelerations ``(c,)`` with friction, from those without."""
        at = friction.coordinates
        units = np.zeros((len(accel), len(at)))
        units[at, np.arange(len(at))] = 1.0
        pushed = self.respond(number, units)
        speeds = drift[1, at] + self.reach[1] * accel[at]
        return np.asarray(
            accel + pushed @ friction.settle(number, speeds, self.reach[1] * pushed[at])
        )

    def respond(self, number: int, load: FloatArray) -> FloatArray:
        """Accelerations ``(c,)`` or ``(c, k)`` that loads of the same shape at a step bring about."""
        location = self._visit(number) * len(self._inverses)
        part = min(int(location), len(self._inverses) - 1)
        share, size = location - part, len(load)
        product = self._inverses[part] @ load
        return np.asarray(
            product[:size] + share * (product[size : 2 * size] + share * product[2 * size :])
        )

    def _visit(self, number: int) -> float:
        """Where a step lies between two nodes, with the matrices there made ready."""
        if self._left[number] != self._interval:
            self._interval = self._left[number]
            ends = slice(self._interval, self._interval + 2)
            mass, damping, stiffness = (
                values[ends]
                for values in (self._motion.mass, self._motion.damping, self._motion.stiffness)
            )
            pull = np.concatenate([stiffness, damping], axis=-1)
            self._pull = np.concatenate([pull[0], pull[1] - pull[0]])
            self._inverses = _tabulate_inverse(
                mass + self.reach[1] * damping + self.reach[0] * stiffness
            )
        return self._share[number]


def _tabulate_inverse(ends: FloatArray) -> list[FloatArray]:
    """The inverse of a matrix that is linear from one end to the other: ``(3 c, c)`` coefficients of
    a parabola over each of equal parts, the constant above the slope above the square.

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
        # a quarter of the trajectory into the first and the last part the parabola misses most
        places = np.array([0.25, parts - 0.75]) / parts
        missed = [
            unit - (first + at * change) @ (low[part] + 0.25 * (slope[part] + 0.25 * square[part]))
            for at, part in zip(places, (0, -1), strict=True)
        ]
        if np.abs(missed).max() < INVERSE_TOLERANCE or parts >= MOST_PARTS:
            return list(np.concatenate([low, slope, square], axis=1))
        parts *= 2


class _SchemeMatrices(NamedTuple):
    """One step of position, velocity, acceleration, auxiliary: ``ahead @ old + reach * new
    acceleration``, ``(4, 4)`` and ``(4,)``.
    """

    ahead: FloatArray
    reach: FloatArray


def _scheme_matrices(scheme: AlphaScheme, h: float) -> _SchemeMatrices:
    """What the steps of a scheme do over ``h`` seconds."""
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
    return np.asarray(np.swapaxes(tool, -1, -2) @ regeneration.stiffness[part] @ tool)


def even_nodes(times: FloatArray, spacing: float) -> FloatArray:
    """Even times from the first to the last one, about so far apart [s]."""
    return np.linspace(times[0], times[-1], max(2, round((times[-1] - times[0]) / spacing) + 1))


def interpolate_nodes(times: FloatArray, nodes: FloatArray, values: FloatArray) -> FloatArray:
    """Linear interpolation between even nodes; beyond the first and last node the outermost line
    goes on.

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
    return np.asarray((1.0 - share) * values[left] + share * values[left + 1])


def apply_matrices(matrices: FloatArray, vectors: FloatArray) -> FloatArray:
    """Return the products ``(n, p)`` of matrices ``(n, p, c)`` with vectors ``(n, c)``."""
    return np.asarray((matrices @ vectors[..., None])[..., 0])


def chunk_slices(count: int) -> list[slice]:
    """Parts of so many steps that are worked on together."""
    return [slice(start, min(start + CHUNK, count)) for start in range(0, count, CHUNK)]


@dataclass(frozen=True, eq=False)
class ServoMotion:
    """A machine along its trajectory with the loops of its drives closed.

    Attributes:
        motion: Its coordinates are those of the machine, then motors, then controllers.
        motors: Where motors stand among them.
        control: All controllers, one below the other.
        speeds: ``(n, d)`` set speeds [m/s].
        accelerations: ``(n, d)`` set accelerations [m/s^2].
        reads: ``(k, d, c + d)`` at the nodes: what the position controllers read per coordinate.
        beside: ``(n, d)`` what they read beside that.
    """

    motion: LinearMotion
    motors: slice
    control: LinearBlock
    speeds: FloatArray
    accelerations: FloatArray
    reads: FloatArray
    beside: FloatArray

    def read(self, history: CompliantHistory) -> FloatArray:
        """Return what the position controllers read beyond their set points ``(n, d)`` [m]."""
        states = history.compliant[:, : self.motors.stop]
        reads = self.motion.between(self.reads, slice(None))
        return np.asarray((reads @ states[..., None])[..., 0] + self.beside)

    def forces(self, history: CompliantHistory) -> FloatArray:
        """Forces of the drives ``(n, d)`` [N]."""
        count, states = self.speeds.shape[1], history.compliant
        read = self.read(history)
        given = np.zeros((len(states), count, INPUTS))
        given[:, :, SPEED], given[:, :, ACCELERATION] = self.speeds, self.accelerations
        given[:, :, POSITION] = read
        given[:, :, MOTOR_SPEED] = self.speeds + history.rate[:, self.motors]
        flat = given.reshape(len(states), -1)
        return np.asarray(
            states[:, self.motors.stop :] @ self.control.c.T + flat @ self.control.d.T
        )


def close_motors(
    free: LinearMotion,
    controls: Sequence[AxisControl],
    *,
    speeds: FloatArray,
    accelerations: FloatArray,
    gravity: FloatArray,
    scales: FloatArray,
    beside: FloatArray | None = None,
) -> ServoMotion:
    """Close the loops of drives along a path.

    Args:
        free: The machine with free motors, its last ``d`` coordinates; its load is that of the rigid
            motion, so on the motors what it takes of their drives, with the sign turned.
        controls: Of the ``d`` drives.
        speeds: ``(n, d)`` set speeds [m/s].
        accelerations: ``(n, d)`` set accelerations [m/s^2].
        gravity: ``(k, c + d)`` generalised weight at the nodes [N].
        scales: ``(k, d, c + d)`` what a linear scale reads per coordinate.
        beside: ``(n, d)`` what it reads beside that; None for nothing.
    """
    count, size = len(controls), free.mass.shape[-1]
    block = stack_blocks([make_controller(control) for control in controls])
    order = len(block.a)
    motors, states = slice(size - count, size), slice(size, size + order)
    columns = INPUTS * np.arange(count)
    measured, turned = columns + POSITION, columns + MOTOR_SPEED
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
    if beside is not None:
        read = np.asarray(np.where(on_scale, beside, read))
    given = np.zeros((len(free.times), count, INPUTS))
    given[:, :, SPEED], given[:, :, MOTOR_SPEED] = speeds, speeds
    given[:, :, ACCELERATION], given[:, :, POSITION] = accelerations, read
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
