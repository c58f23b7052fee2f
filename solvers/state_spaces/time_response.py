"""Linear response in time by exact discretisation: right at every step for loads that vary linearly
between steps.
"""

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray
from headstock.solvers.errors import ModelError
from headstock.solvers.state_spaces.state_space import StateSpace, UncoupledModes

# below this angle per step the integrals of a mode would cancel, and come from the exponential of a
# larger matrix
LOW_FREQUENCY = 0.5
CHUNK = 4096  # steps worked on together
# steps of a block that a dense transition is followed in, entries of what its outputs are found from,
# and steps per state from which the powers of the transition pay
STEPS_OF_BLOCK, LARGEST_BLOCK, WORTH_BLOCKS = 32, 4_000_000, 8
SAME_STEP = 9  # decimals of a step's length that distinguish steps


@dataclass(frozen=True, eq=False)
class TimeResponse:
    """Motions at the outputs.

    Attributes:
        times: ``(n_steps,)`` [s], from zero.
        outputs: ``(n_steps, n_outputs)``.
        final_state: ``(n,)``.
    """

    times: FloatArray
    outputs: FloatArray
    final_state: FloatArray


@dataclass(frozen=True, eq=False)
class _Propagator:
    """One step: ``x_new = Phi x + start u + end u_new``.

    Attributes:
        transition: Phi ``(n, n)``, or ``(m, 2, 2)`` of modes that nothing couples.
        start: ``(n, n_inputs)`` effect of the load at the beginning of the step.
        step: [s].
    """

    transition: FloatArray
    start: FloatArray
    end: FloatArray
    step: float

    def advance(self, state: FloatArray) -> FloatArray:
        """Return the free motion after one step."""
        if self.transition.ndim == 2:
            return self.transition @ state
        pairs = state.reshape(-1, 2)
        return (
            self.transition[:, :, 0] * pairs[:, :1] + self.transition[:, :, 1] * pairs[:, 1:]
        ).ravel()


def solve_time_response(space: StateSpace, loads: FloatArray, step: float) -> TimeResponse:
    """Return the response from rest to sampled loads, linear between samples.

    There is no error of integration, whatever the step: modes far faster than it neither blow up
    nor ring beyond what they physically do. Energy is kept to roundoff where nothing is damped.

    Args:
        space: From ``to_state_space``.
        loads: ``(n_steps, n_inputs)`` at times 0, step, 2 step...
        step: [s].

    Raises:
        ModelError: The step is not positive, or a load is not finite.
    """
    loads = np.asarray(loads, dtype=float)
    if not (np.isfinite(step) and step > 0.0):
        raise ModelError(f"the time step is {step:g} s; it must be above zero")
    ends, times = np.stack([loads[:-1], loads[1:]], axis=1), step * np.arange(len(loads))
    return solve_stepped_response(space, np.asarray(times, dtype=float), ends)


def solve_stepped_response(space: StateSpace, times: FloatArray, loads: FloatArray) -> TimeResponse:
    """Return the response from rest to loads that are linear within each step and may jump between
    steps.

    Args:
        space: From ``to_state_space``.
        times: ``(n,)`` rising, of any spacing [s].
        loads: ``(n - 1, 2, n_inputs)`` at the beginning and the end of each step.

    Returns:
        Motions at the times; where a load jumps and acts on an output at once, that after the jump.

    Raises:
        ModelError: The times do not rise, or a load is not finite.
    """
    if not np.isfinite(loads).all():
        raise ModelError("a load is not finite")
    lengths, which = group_steps(np.diff(times))
    propagators = [make_propagator(space, length) for length in lengths]
    state: FloatArray = np.zeros(len(space.a))
    outputs: FloatArray = np.empty((len(times), len(space.c)))
    outputs[0] = space.c @ state
    borders = np.flatnonzero(np.diff(which)) + 1
    for run in np.split(np.arange(len(which)), borders) if len(which) else ():
        outputs[run + 1], state = _follow(propagators[which[run[0]]], space.c, state, loads[run])
    add_direct(outputs, np.concatenate([loads[:, 0], loads[-1:, 1]]), space.d)
    return TimeResponse(np.asarray(times, dtype=float), outputs, state)


def _follow(
    propagator: _Propagator, rows: FloatArray, state: FloatArray, loads: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the outputs ``(m, p)`` after each of some equal steps, and the state after the last.

    Args:
        rows: ``(p, n)`` outputs per state.
        loads: ``(m, 2, k)`` at the beginning and the end of each step.
    """
    given = loads.reshape(len(loads), -1)
    push = np.hstack([propagator.start, propagator.end])
    outputs: FloatArray = np.empty((len(loads), len(rows)))
    done = 0
    if propagator.transition.ndim == 2 and len(loads) > WORTH_BLOCKS * len(state):
        longest = LARGEST_BLOCK // max(1, rows.size)
        outputs, done, state = _follow_blocks(
            propagator.transition, push, rows, state, given, min(STEPS_OF_BLOCK, max(2, longest))
        )
    for number in range(done, len(loads)):
        state = propagator.advance(state) + push @ given[number]
        outputs[number] = rows @ state
    return outputs, state


def _follow_blocks(
    transition: FloatArray,
    push: FloatArray,
    rows: FloatArray,
    state: FloatArray,
    given: FloatArray,
    steps: int,
) -> tuple[FloatArray, int, FloatArray]:
    """Return outputs ``(m, p)``, set for the steps that fill whole blocks; their number; and the state
    after them.

    A large transition is read from memory in every step, its power once a block: the states between
    are never needed, as outputs follow from the state at the beginning of a block and its loads.

    Args:
        transition: Phi ``(n, n)``.
        push: ``(n, q)`` what the loads of a step add to the state.
        rows: ``(p, n)`` outputs per state.
        state: ``(n,)`` before the first step.
        given: ``(m, q)`` loads of each step.
        steps: Number of time steps that a block joins.
    """
    count, loaded, seen = len(given) // steps, push.shape[1], len(rows)
    loads = given[: count * steps].reshape(count, -1).T  # (steps q, blocks)
    pushed, observed = [push], [rows]
    for _ in range(steps):
        pushed.append(transition @ pushed[-1])
        observed.append(observed[-1] @ transition)
    states = np.empty((len(state), count + 1))
    states[:, 0] = state
    states[:, 1:] = np.hstack(pushed[steps - 1 :: -1]) @ loads
    power = np.linalg.matrix_power(transition, steps)
    for block in range(count):
        states[:, block + 1] += power @ states[:, block]
    # what a load adds to an output depends on how many steps lie between
    answers = np.zeros((steps, seen, steps, loaded))
    for later in range(steps):
        answer = observed[later] @ push
        for step in range(steps - later):
            answers[step + later, :, step] = answer
    found = np.vstack(observed[1:]) @ states[:, :-1]
    found += answers.reshape(steps * seen, -1) @ loads
    outputs = np.empty((len(given), seen))
    outputs[: count * steps] = found.T.reshape(-1, seen)
    return outputs, count * steps, states[:, -1]


def group_steps(steps: FloatArray) -> tuple[list[float], NDArray[np.intp]]:
    """Return the lengths of steps ``(n,)``, and which each has; steps that differ by roundoff of the times
    are one.
    """
    sizes, kinds = np.unique(
        np.round(steps / steps.max(), SAME_STEP) if len(steps) else steps, return_inverse=True
    )
    return [float(steps[kinds == kind].mean()) for kind in range(len(sizes))], kinds


def add_direct(outputs: FloatArray, loads: FloatArray, direct: FloatArray) -> None:
    """Add what loads ``(n, m)`` do to outputs directly ``(n, k)``, some steps after the other: no
    second array as large.
    """
    for start in range(0, len(loads), CHUNK):
        part = slice(start, start + CHUNK)
        outputs[part] += loads[part] @ direct.T


def make_propagator(space: StateSpace, step: float) -> _Propagator:
    """Return the exact step of a system.

    Raises:
        ModelError: The step is not positive.

    Source: Van Loan (1978), Computing integrals involving the matrix exponential; Franklin, Powell
    and Workman (1998), section
        6.3.2 (triangle hold).
    """
    if not (np.isfinite(step) and step > 0.0):
        raise ModelError(f"the time step is {step:g} s; it must be above zero")
    if space.pairs is None:
        # as long as unit states, so that the exponential resolves them as well
        sizes = np.linalg.norm(space.b, axis=0)
        sizes[sizes == 0.0] = 1.0
        transition, level, rise = exact_step(space.a, space.b / sizes, step)
        return _Propagator(transition, (level - rise) * sizes, rise * sizes, step)
    transition, total, rising = _pair_integrals(space.pairs, step)
    count = len(transition)
    force = space.b.reshape(count, 2, space.b.shape[1])
    start, end = (
        np.einsum("mij,mjk->mik", part, force).reshape(space.b.shape)
        for part in (total - rising, rising)
    )
    return _Propagator(transition, start, end, step)


def sine_gains(space: StateSpace, step: float, omega: float) -> tuple[FloatArray, FloatArray]:
    """Return what loads ``sin(omega s)`` and ``cos(omega s)`` while a step lasts add to the state
    at its end, ``(n, n_inputs)`` each; also in resonance without damping.

    Args:
        step: [s].
        omega: [rad/s].
    """
    if space.pairs is None:
        cosine, sine = _sine_integrals(space.a, step, omega)
        return sine @ space.b, cosine @ space.b
    blocks = _pair_matrices(space.pairs)
    cosine, sine = _sine_integrals(blocks, step, omega)
    force = space.b.reshape(len(blocks), 2, -1)
    forward, quadrature = ((part @ force).reshape(space.b.shape) for part in (sine, cosine))
    return forward, quadrature


def _sine_integrals(a: FloatArray, step: float, omega: float) -> tuple[FloatArray, FloatArray]:
    """Return ``int exp(A (h - s)) cos(omega s) ds`` and the same of the sine, of matrices
    ``(..., n, n)``: an oscillator drives the system.
    """
    size = a.shape[-1]
    big = np.zeros((*a.shape[:-2], 3 * size, 3 * size))
    first, second, third = (slice(size * part, size * (part + 1)) for part in range(3))
    unit = np.eye(size)
    big[..., first, first] = a * step
    big[..., first, second] = unit * step
    big[..., second, third] = unit * (omega * step)
    big[..., third, second] = -unit * (omega * step)
    exponential = scipy.linalg.expm(big)
    return exponential[..., first, second], exponential[..., first, third]


def exact_step(a: FloatArray, b: FloatArray, step: float) -> tuple[FloatArray, ...]:
    """Return ``exp(A h)``, ``int exp(A (h - s)) ds B`` and ``int exp(A (h - s)) s / h ds B``.

    A linear load is an integral of two more states, the load at the start and its rise per step: one
    exponential holds the step and both integrals, also where frequencies are zero and no closed form
    would do.

    Args:
        a: ``(n, n)``.
        b: ``(n, k)``.
        step: [s].

    Source: Van Loan (1978), Computing integrals involving the matrix exponential.
    """
    size, acting = b.shape
    big = np.zeros((size + 2 * acting, size + 2 * acting))
    big[:size, :size], big[:size, size : size + acting] = a * step, b * step
    big[size : size + acting, size + acting :] = np.eye(acting)
    exponential = scipy.linalg.expm(big)[:size]
    return tuple(np.split(exponential, [size, size + acting], axis=1))


def _pair_integrals(
    pairs: UncoupledModes, step: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the same for every mode ``(m, 2, 2)``: closed forms, but for low-frequency modes,
    where these would cancel.
    """
    a = _pair_matrices(pairs)
    transition, total, rising = np.empty_like(a), np.empty_like(a), np.empty_like(a)
    low_frequency = np.maximum(np.sqrt(pairs.eigenvalues), pairs.viscous) * step < LOW_FREQUENCY
    for mode in np.flatnonzero(low_frequency):
        transition[mode], total[mode], rising[mode] = exact_step(a[mode], np.eye(2), step)
    fast = np.flatnonzero(~low_frequency)
    if len(fast):
        transition[fast] = _pair_exponentials(
            a[fast], pairs.eigenvalues[fast], pairs.viscous[fast], step
        )
        inverse = np.linalg.inv(a[fast])
        total[fast] = inverse @ (transition[fast] - np.eye(2))
        rising[fast] = inverse @ (total[fast] / step - np.eye(2))
    return transition, total, rising


def _pair_matrices(pairs: UncoupledModes) -> FloatArray:
    """Return the state matrix ``(m, 2, 2)`` of every mode."""
    a = np.zeros((len(pairs.eigenvalues), 2, 2))
    a[:, 0, 1] = pairs.scales
    a[:, 1, 0] = -pairs.eigenvalues / pairs.scales
    a[:, 1, 1] = -pairs.viscous
    return a


def _pair_exponentials(
    a: FloatArray, eigenvalues: FloatArray, viscous: FloatArray, step: float
) -> FloatArray:
    """Return ``exp(A h)`` of single modes: ``e^{-c h / 2} (cos(w h) + sin(w h) / w (A + c / 2))``,
    and its overdamped form.
    """
    mean, rest = -0.5 * viscous, 0.25 * viscous**2 - eigenvalues
    rate = np.sqrt(np.abs(rest))
    swings = rest < 0.0
    # exp((mean + rate) h) and exp((mean - rate) h) never overflow, cosh and sinh would
    grow = np.exp((mean + np.where(swings, 0.0, rate)) * step)
    fall = np.exp((mean - np.where(swings, 0.0, rate)) * step)
    angle = rate * step
    safe = np.where(rate > 0.0, rate, 1.0)
    even = np.where(swings, grow * np.cos(angle), 0.5 * (grow + fall))
    odd = np.where(
        swings,
        grow * np.sin(angle) / safe,
        np.where(angle > 1e-8, 0.5 * (grow - fall) / safe, grow * step),
    )
    return even[:, None, None] * np.eye(2) + odd[:, None, None] * (
        a - mean[:, None, None] * np.eye(2)
    )
