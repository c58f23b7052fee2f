"""Generalised-α time integration of second-order systems, with position constraints (index 3) or
without.

Chung and Hulbert (1993) in the form of Arnold and Brüls (2007): equilibrium and constraints hold at
the end of each step, and an auxiliary acceleration carries the α-averages, so that positions,
velocities and multipliers are second-order accurate. Newton's matrix is scaled by ``h^2``
(Bottasso, Dopico and Trainelli 2008), which keeps its condition number bounded as ``h`` goes to
zero.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.solvers.errors import ConvergenceError
from headstock.solvers.motion.alpha import AlphaScheme

MAX_ITERATIONS = 12
DIVERGED = 1e3  # correction over the size of positions from which Newton's method has lost its way
WHOLE = 2**14  # smallest sub-steps in a step
LOCAL_ERROR = 1e-3  # of a position over its size, from which a step is halved
# the error goes with the cube of the step: twice the step where its error will be half of what is
# allowed
GROW = 16.0
LARGEST_JUMP = (
    0.2  # of velocities in a step near a singular pose, beside what accelerations explain
)
NEAR_SINGULAR = (
    1e-2  # smallest over largest singular value of the constraints near which motions may branch
)
BRANCH_ADVICE = "pass it with more speed, start or drive it a little beside it, or add a spring or a constraint that chooses one of the motions"
# singular value of Newton's matrix over the largest, below which a motion is not determined
UNDETERMINED = 1e-13
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
    """Mass, damping and stiffness ``(n, n)`` and constraint Jacobian ``(m, n)``, near enough for
    Newton's method.
    """

    mass: FloatArray
    damping: FloatArray
    stiffness: FloatArray
    constraints: FloatArray


class _ConstrainedProblem(Protocol):
    """``residual = 0``, ``constraints = 0``."""

    def residual(self, state: MotionState) -> tuple[FloatArray, FloatArray]:
        """Unbalanced forces ``(n,)`` and constraint violations ``(m,)``."""

    def linearise(self, state: MotionState) -> Linearisation:
        """Derivatives of the residual near a state."""


@dataclass(frozen=True, eq=False)
class _Progress:
    """Where an integration stands: what the next step starts from, and how it is cut.

    Attributes:
        auxiliary: ``(n,)`` averaged acceleration.
        step: Length of the last sub-step, to which ``auxiliary`` belongs [s].
        share: Of a whole step that the next sub-step takes, in units of its smallest share.
        shrinking: By how much a correction of Newton's method was smaller than the one before, when
            that was last measured.
    """

    state: MotionState
    auxiliary: FloatArray
    step: float
    share: int
    shrinking: float


@dataclass(frozen=True)
class _Rules:
    """Settings of an integration: scheme, Newton's tolerance, and the local error allowed."""

    scheme: AlphaScheme
    tolerance: float
    accuracy: float


def integrate_constrained(
    problem: _ConstrainedProblem,
    start: MotionState,
    step: float,
    count: int,
    *,
    observe: Callable[[MotionState], None] = lambda state: None,
    scheme: AlphaScheme | None = None,
    tolerance: float = 1e-13,
    accuracy: float = LOCAL_ERROR,
) -> MotionState:
    """Integrate from a consistent start; the state at the end of every step is shown to an observer.

    A step is halved, and its halves again, where Newton's method does not converge, where the local
    error is larger than allowed, or where velocities jump near a singular pose; sub-steps grow
    again after that.

    Args:
        start: Consistent in position, velocity and acceleration.
        step: Time step [s].
        observe: Called after every step, not after its sub-steps.
        tolerance: Newton's last correction of a position, in the unit of positions.
        accuracy: Largest local error of a position over ``1 + `` the largest position. The default
            only catches steps that lose their way; a smaller one makes the steps adaptive.

    Returns:
        The last state.

    Raises:
        ConvergenceError: The smallest sub-step fails; says when, and whether the motion branches
            there.

    Source: Zienkiewicz and Xie (1991) (local error from the change of accelerations).
    """
    rules = _Rules(scheme or AlphaScheme(), tolerance, accuracy)
    progress = _Progress(start, start.acceleration, step, WHOLE, np.inf)
    for number in range(count):
        if number % MEASURE_EVERY == 0:
            progress = replace(progress, shrinking=np.inf)
        progress = _take_step(
            problem,
            progress,
            rules,
            begin=start.time + number * step,
            end=start.time + (number + 1) * step,
        )
        observe(progress.state)
    return progress.state


def _take_step(
    problem: _ConstrainedProblem, progress: _Progress, rules: _Rules, *, begin: float, end: float
) -> _Progress:
    """One whole step, in one or in as many sub-steps as it takes."""
    done = 0
    while done < WHOLE:
        share = progress.share
        time = end if done + share == WHOLE else begin + (done + share) / WHOLE * (end - begin)
        length = share / WHOLE * (end - begin)
        try:
            tried, error = _try_step(problem, progress, rules, time=time, length=length)
        except ConvergenceError as failure:
            if share == 1:
                raise ConvergenceError(_explain(problem, progress.state, failure)) from failure
            progress = replace(progress, share=share // 2, shrinking=np.inf)
            continue
        done += share
        grows = share < WHOLE and error < rules.accuracy / GROW and done % (2 * share) == 0
        progress = replace(tried, share=2 * share, shrinking=np.inf) if grows else tried
    return progress


def _try_step(
    problem: _ConstrainedProblem, progress: _Progress, rules: _Rules, *, time: float, length: float
) -> tuple[_Progress, float]:
    """A sub-step of a length [s] that ends at a time [s], and its local error over the size of
    positions.

    Raises:
        ConvergenceError: Newton's method fails with a matrix for each correction too, or the step
            is too coarse.
    """
    old = progress.state
    # the auxiliary acceleration lies a share of the last step beside the state
    auxiliary = old.acceleration + length / progress.step * (progress.auxiliary - old.acceleration)
    known = progress.shrinking
    try:
        new, averaged, shrinking = _advance(
            problem, old, auxiliary, rules, time=time, length=length, shrinking=known
        )
    except ConvergenceError:
        new, averaged, _ = _advance(
            problem, old, auxiliary, rules, time=time, length=length, shrinking=np.inf, full=True
        )
        shrinking = np.inf
    change = float(np.abs(new.acceleration - old.acceleration).max(initial=0.0))
    error = (
        abs(rules.scheme.beta - 1.0 / 6.0)
        * length**2
        * change
        / (1.0 + float(np.abs(new.position).max(initial=0.0)))
    )
    if not error <= rules.accuracy:
        raise ConvergenceError(
            f"the local error of the step to t = {time:.6g} s is {error:.2g}, wanted {rules.accuracy:.2g}"
        )
    fastest = max(float(np.abs(state.velocity).max(initial=0.0)) for state in (old, new))
    if length * change > LARGEST_JUMP * fastest and _dependence(problem, new) < NEAR_SINGULAR:
        raise ConvergenceError(f"the velocities jump in the step to t = {time:.6g} s")
    return _Progress(new, averaged, length, progress.share, shrinking), error


def _dependence(problem: _ConstrainedProblem, state: MotionState) -> float:
    """Smallest over largest singular value of the constraints' Jacobian: zero where one follows
    from others; inf without any.
    """
    values = np.linalg.svd(problem.linearise(state).constraints, compute_uv=False)
    return float(values[-1] / values[0]) if len(values) else np.inf


def _explain(problem: _ConstrainedProblem, state: MotionState, failure: ConvergenceError) -> str:
    """Why an integration ends, by what the constraints are like where it does."""
    ratio = _dependence(problem, state)
    parts = f"{failure}; steps were halved down to 1/{WHOLE} of the step asked for"
    if ratio < NEAR_SINGULAR:
        return (
            f"{parts}. After t = {state.time:.6g} s the mechanism is in a singular pose, or very near one (smallest over largest singular "
            f"value of the constraints: {ratio:.1g}), and more than one motion can go on from there: {BRANCH_ADVICE}"
        )
    return f"{parts}. The pose is not singular: look for forces that jump or a start that violates the constraints, or take a smaller step"


class _Advanced(NamedTuple):
    """State and averaged acceleration ``(n,)`` after a sub-step, and by how much corrections got
    smaller; see :class:`_Progress`.
    """

    state: MotionState
    auxiliary: FloatArray
    shrinking: float


def _advance(
    problem: _ConstrainedProblem,
    old: MotionState,
    auxiliary: FloatArray,
    rules: _Rules,
    *,
    time: float,
    length: float,
    shrinking: float,
    full: bool = False,
) -> _Advanced:
    """One sub-step.

    Args:
        auxiliary: ``(n,)`` averaged acceleration before.
        time: At the end [s].
        length: Of the sub-step [s].
        shrinking: By how much a correction was smaller than the one before it, when that was last
            measured.
        full: Each correction has a matrix of its own, and motions that it hardly determines get the
            smallest correction.
    """
    scheme, tolerance, h = rules.scheme, rules.tolerance, length
    am, af, gamma, beta = scheme.alpha_m, scheme.alpha_f, scheme.gamma, scheme.beta
    # predict with zero change of acceleration
    acceleration = old.acceleration
    rest = (af * old.acceleration - am * auxiliary) / (1.0 - am)
    share = (1.0 - af) / (1.0 - am)
    new_auxiliary = rest + share * acceleration
    position = (
        old.position + h * old.velocity + h * h * ((0.5 - beta) * auxiliary + beta * new_auxiliary)
    )
    velocity = old.velocity + h * ((1.0 - gamma) * auxiliary + gamma * new_auxiliary)
    state = MotionState(time, position, velocity, acceleration, old.multipliers)
    solve: Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]] | None = None
    to_velocity, to_acceleration = gamma / (h * beta), (1.0 - am) / (h * h * beta * (1.0 - af))
    last = np.inf
    for _ in range(MAX_ITERATIONS):
        unbalanced, violation = problem.residual(state)
        if solve is None or full:
            solve = _newton_solver(
                problem.linearise(state), h, to_velocity, to_acceleration, smallest=full
            )
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
        # good enough where the next correction would be (Hairer and Wanner 1996, sec. IV.8), or
        # where corrections are roundoff
        measured = size / last if last < np.inf else shrinking
        if min(size, 2.0 * measured * size) <= tolerance or (
            size <= 100.0 * tolerance and size > 0.5 * last
        ):
            return _Advanced(state, rest + share * state.acceleration, measured)
        last = size
    raise ConvergenceError(
        f"the step to t = {time:.6g} s does not converge: the last correction is {last:.2g}, wanted {tolerance:.2g}"
    )


def _newton_solver(
    tangent: Linearisation,
    h: float,
    to_velocity: float,
    to_acceleration: float,
    *,
    smallest: bool = False,
) -> Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]:
    effective = (
        h * h * (to_acceleration * tangent.mass + to_velocity * tangent.damping + tangent.stiffness)
    )
    size, count = len(effective), len(tangent.constraints)
    matrix = np.zeros((size + count, size + count))
    matrix[:size, :size] = effective
    matrix[:size, size:] = tangent.constraints.T
    matrix[size:, :size] = tangent.constraints
    # rows of forces are brought to the size of the constraints
    scale = 1.0 / max(float(np.abs(effective).max()), np.finfo(float).tiny)
    matrix[:size, :size] *= scale

    def solve(unbalanced: FloatArray, violation: FloatArray) -> tuple[FloatArray, FloatArray]:
        right = np.concatenate([-scale * h * h * unbalanced, -violation])
        try:
            found = (
                np.linalg.lstsq(matrix, right, rcond=UNDETERMINED)[0]
                if smallest
                else np.linalg.solve(matrix, right)
            )
        except np.linalg.LinAlgError as error:
            raise ConvergenceError(
                "Newton's matrix is singular: the constraints are redundant or the pose is singular"
            ) from error
        return found[:size], found[size:] / (scale * h * h)

    return solve
