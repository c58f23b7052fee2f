"""Generalised-α time integration of second-order systems, with position constraints (index 3) or without.

Chung and Hulbert (1993) in the form of Arnold and Brüls (2007): equilibrium and constraints hold at the end of each step, and an
auxiliary acceleration carries the α-averages, so that positions, velocities and multipliers are second-order accurate. Newton's
matrix is scaled by ``h^2`` (Bottasso, Dopico and Trainelli 2008), which keeps its condition number bounded as ``h`` goes to zero.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.solvers.errors import ConvergenceError

MAX_ITERATIONS = 12
DIVERGED = 1e3  # correction over the size of positions from which Newton's method has lost its way
LARGEST_GAIN = 1.5  # of the kinetic energy in a step past a singular pose
SINGULAR_ADVICE = (
    "near a singular pose a step that is smaller meets the same pose nearer: change the step by a few per cent, the start or the motion "
    "asked for; if only the last digits are missing, ask for a larger tolerance; far from one, take a smaller step"
)
UNDETERMINED = 1e-13  # singular value of Newton's matrix over the largest, below which a motion is not determined
MEASURE_EVERY = 16  # steps between two looks at how fast Newton's method converges


@dataclass(frozen=True, eq=False)
class MotionState:
    """A system in motion.

    Attributes:
        time: [s].
        position: ``(n,)``.
        velocity: ``(n,)``.
        acceleration: ``(n,)``.
        multipliers: ``(m,)`` of the constraints.
    """

    time: float
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    multipliers: FloatArray


@dataclass(frozen=True, eq=False)
class Linearisation:
    """Mass, damping and stiffness ``(n, n)`` and constraint Jacobian ``(m, n)``, near enough for Newton's method."""

    mass: FloatArray
    damping: FloatArray
    stiffness: FloatArray
    constraints: FloatArray


class ConstrainedProblem(Protocol):
    """``residual = 0``, ``constraints = 0``."""

    def residual(self, state: MotionState) -> tuple[FloatArray, FloatArray]:
        """Unbalanced forces ``(n,)`` and constraint violations ``(m,)``."""

    def linearise(self, state: MotionState) -> Linearisation:
        """Derivatives of the residual near a state."""


@dataclass(frozen=True)
class AlphaScheme:
    """Parameters of the method for a spectral radius at infinite frequency: 1 keeps high frequencies, 0 kills them in one step."""

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


def integrate_motion(
    problem: ConstrainedProblem,
    start: MotionState,
    step: float,
    count: int,
    *,
    observe: Callable[[MotionState], None],
    scheme: AlphaScheme | None = None,
    tolerance: float = 1e-13,
) -> MotionState:
    """March from a consistent start; every state is shown to an observer.

    Args:
        problem: What is solved.
        start: Consistent in position, velocity and acceleration.
        step: Time step [s].
        count: How many.
        observe: Called after every step.
        scheme: Numerical damping.
        tolerance: Newton's last correction of a position, in the unit of positions.

    Returns:
        The last state.

    Raises:
        ConvergenceError: Newton's method fails in a step; says when.
    """
    chosen = scheme or AlphaScheme()
    state, auxiliary, shrinking = start, start.acceleration, np.inf
    for number in range(count):
        time = start.time + (number + 1) * step
        if number % MEASURE_EVERY == 0:
            shrinking = np.inf
        before, how, when = (state, auxiliary), (chosen, tolerance), (time, step)
        try:
            state, auxiliary, shrinking = _advance(problem, before, when, how, shrinking)
        except ConvergenceError:
            state, auxiliary, shrinking = _pass_singular(problem, before, when, how)
        observe(state)
    return state


def _pass_singular(
    problem: ConstrainedProblem,
    before: tuple[MotionState, FloatArray],
    when: tuple[float, float],
    how: tuple[AlphaScheme, float],
) -> tuple[MotionState, FloatArray, float]:
    """A step that a single matrix does not carry, since the constraints turn within it: a matrix for each correction.

    Raises:
        ConvergenceError: That fails too, or ends in a jump of the velocities, which no force explains.
    """
    after, auxiliary, _ = _advance(problem, before, when, how, np.inf, full=True)
    mass = problem.linearise(after).mass
    old, new = (float(state.velocity @ mass @ state.velocity) for state in (before[0], after))
    if not new <= LARGEST_GAIN * old:
        raise ConvergenceError(f"the velocities jump in the step to t = {when[0]:.6g} s; {SINGULAR_ADVICE}")
    return after, auxiliary, np.inf


def _advance(
    problem: ConstrainedProblem,
    before: tuple[MotionState, FloatArray],
    when: tuple[float, float],
    how: tuple[AlphaScheme, float],
    shrinking: float,
    *,
    full: bool = False,
) -> tuple[MotionState, FloatArray, float]:
    """One step; ``shrinking`` is by how much a correction was smaller than the one before it, when that was last measured.

    With ``full`` each correction has a matrix of its own, and motions that it hardly determines get the smallest correction.
    """
    (old, auxiliary), (time, h), (scheme, tolerance) = before, when, how
    am, af, gamma, beta = scheme.alpha_m, scheme.alpha_f, scheme.gamma, scheme.beta
    # predict with zero change of acceleration
    acceleration = old.acceleration
    rest = (af * old.acceleration - am * auxiliary) / (1.0 - am)
    share = (1.0 - af) / (1.0 - am)
    new_auxiliary = rest + share * acceleration
    position = old.position + h * old.velocity + h * h * ((0.5 - beta) * auxiliary + beta * new_auxiliary)
    velocity = old.velocity + h * ((1.0 - gamma) * auxiliary + gamma * new_auxiliary)
    state = MotionState(time, position, velocity, acceleration, old.multipliers)
    solve: Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]] | None = None
    to_velocity, to_acceleration = gamma / (h * beta), (1.0 - am) / (h * h * beta * (1.0 - af))
    last = np.inf
    for _ in range(MAX_ITERATIONS):
        unbalanced, violation = problem.residual(state)
        if solve is None or full:
            solve = _newton_solver(problem.linearise(state), h, to_velocity, to_acceleration, smallest=full)
        change, force = solve(unbalanced, violation)
        size = float(np.abs(change).max(initial=0.0))
        if not size <= DIVERGED * (1.0 + float(np.abs(state.position).max(initial=0.0))):
            last = size
            break
        state = MotionState(
            time,
            state.position + change,
            state.velocity + to_velocity * change,
            state.acceleration + to_acceleration * change,
            state.multipliers + force,
        )
        # good enough where the next correction would be (Hairer and Wanner 1996, sec. IV.8), or where corrections are roundoff
        measured = size / last if last < np.inf else shrinking
        if min(size, 2.0 * measured * size) <= tolerance or (size <= 100.0 * tolerance and size > 0.5 * last):
            return state, rest + share * state.acceleration, measured
        last = size
    raise ConvergenceError(
        f"the step to t = {time:.6g} s does not converge: the last correction is {last:.2g}, wanted {tolerance:.2g}; {SINGULAR_ADVICE}"
    )


def _newton_solver(
    tangent: Linearisation, h: float, to_velocity: float, to_acceleration: float, *, smallest: bool = False
) -> Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]:
    effective = h * h * (to_acceleration * tangent.mass + to_velocity * tangent.damping + tangent.stiffness)
    size, count = len(effective), len(tangent.constraints)
    matrix = np.zeros((size + count, size + count))
    matrix[:size, :size], matrix[:size, size:], matrix[size:, :size] = effective, tangent.constraints.T, tangent.constraints
    # rows of forces are brought to the size of the constraints
    scale = 1.0 / max(float(np.abs(effective).max()), np.finfo(float).tiny)
    matrix[:size, :size] *= scale

    def solve(unbalanced: FloatArray, violation: FloatArray) -> tuple[FloatArray, FloatArray]:
        right = np.concatenate([-scale * h * h * unbalanced, -violation])
        try:
            found = np.linalg.lstsq(matrix, right, rcond=UNDETERMINED)[0] if smallest else np.linalg.solve(matrix, right)
        except np.linalg.LinAlgError as error:
            raise ConvergenceError("Newton's matrix is singular: the constraints are redundant or the pose is singular") from error
        return found[:size], found[size:] / (scale * h * h)

    return solve
