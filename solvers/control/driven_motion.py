"""A machine under control in time, with friction in its guides: a stiff integrator, and where the
energy went.
"""

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy.integrate

from headstock.geometry.frames import BoolArray, FloatArray
from headstock.solvers.control.drive_loops import ClosedLoop
from headstock.solvers.control.friction_loop import LOADS, WORKS, RubbingLoop, make_rubbing_loop
from headstock.solvers.errors import ConvergenceError

TOLERANCE = 1e-8
PROBES = 2000

Given = Callable[[float], FloatArray]
LoopAt = Callable[[float], RubbingLoop]


@dataclass(frozen=True, eq=False)
class EnergyBalance:
    """Energies over time ``(n,)`` [J], counted from the start.

    Attributes:
        stored: Kinetic and strain energy of the machine.
        drives: Work of the drive forces.
        loads: Work of the loads.
        damping: Lost in dampers.
        friction: Lost in the guides.
        pose: Work of a change of pose.
    """

    stored: FloatArray
    drives: FloatArray
    loads: FloatArray
    damping: FloatArray
    friction: FloatArray
    pose: FloatArray

    @property
    def error(self) -> float:
        """Largest energy that is missing, over the largest that is stored, was put in or lost."""
        missing = (
            self.stored
            - self.stored[0]
            - self.drives
            - self.loads
            - self.pose
            + self.damping
            + self.friction
        )
        every = (
            self.stored,
            self.drives,
            self.loads,
            self.damping,
            self.friction,
            self.pose,
        )
        size = max(float(np.abs(part).max()) for part in every)
        return float(np.abs(missing).max()) / size if size > 0.0 else 0.0


@dataclass(frozen=True, eq=False)
class DrivenMotion:
    """What a controlled machine did.

    Attributes:
        times: ``(n,)`` [s].
        left: ``(n, m)`` states just before each time.
        right: ``(n, m)`` and just after it: an impulse is between them.
        outputs: ``(n, n_outputs)`` of the closed loop, just after each time.
        friction: ``(n, k)`` force against the motion there [N].
        energy: Where it went.
        evaluations: How often the rate of change was asked for.
    """

    times: FloatArray
    left: FloatArray
    right: FloatArray
    outputs: FloatArray
    friction: FloatArray
    energy: EnergyBalance
    evaluations: int


@dataclass(frozen=True, eq=False)
class Outset:
    """How a motion begins that does not begin from rest, and what strikes it on its way.

    Attributes:
        state: ``(m,)`` before the first time.
        jumps: ``(n, m)`` of the state at each time, by impulses.
        sizes: ``(p, m)`` states as large as those to be expected.
    """

    state: FloatArray
    jumps: FloatArray
    sizes: FloatArray


def solve_motion(
    loop: ClosedLoop,
    given: Given,
    times: FloatArray,
    *,
    breaks: FloatArray | None = None,
    method: Literal["Radau", "BDF"] = "Radau",
    tolerance: float = TOLERANCE,
) -> DrivenMotion:
    """Motion from rest under set points and loads, with the friction of every drive that has one.

    Args:
        loop: Closed with the given loads, then ``friction_channels`` of its drives, as inputs.
        given: Set points, then loads, at an instant.
        times: ``(n,)`` instants wanted, rising; the first is the start.
        breaks: Instants at which what is given jumps or kinks: no step reaches over one.
        method: Of scipy.
        tolerance: Relative, per step.

    Raises:
        ConvergenceError: The integrator gave up.
    """
    model = make_rubbing_loop(loop)
    return integrate_motion(
        lambda instant: model, given, times, breaks=breaks, method=method, tolerance=tolerance
    )


def integrate_motion(
    loop_at: LoopAt,
    given: Given,
    times: FloatArray,
    *,
    breaks: FloatArray | None = None,
    outset: Outset | None = None,
    longest: float = np.inf,
    method: Literal["Radau", "BDF"] = "Radau",
    tolerance: float = TOLERANCE,
) -> DrivenMotion:
    """The same of a loop that may change with time, and from any state.

    The works are integrated along with the states, so that their balance tells the integrator's
    error.

    Args:
        loop_at: The loop at an instant, with its friction.
        given: Set points, then loads, at an instant.
        times: ``(n,)`` instants wanted, rising; the first is the start.
        breaks: Instants at which what is given jumps or kinks: no step reaches over one.
        outset: How it begins; None for rest.
        longest: Step [s].
        method: Of scipy.
        tolerance: Relative, per step.

    Raises:
        ConvergenceError: The integrator gave up.

    Source: Hairer and Wanner (1996), Solving Ordinary Differential Equations II, section IV.8
    (Radau IIA of order five).
    """
    times = np.asarray(times, dtype=float)
    typical = loop_at(0.5 * float(times[0] + times[-1]))
    size = typical.size
    if outset is None:
        sizes = _coarse_states(typical, given, times)
        outset = Outset(np.zeros(size), np.zeros((len(times), size)), sizes)
    allowed = tolerance * _state_scale(typical, outset.sizes, float(times[-1] - times[0]))
    struck: BoolArray = np.asarray(outset.jumps.any(axis=1))
    left, asked = [np.concatenate([outset.state, np.zeros(WORKS)])[None]], 0
    # works count from just after the first time
    state = left[0][0] + np.concatenate([outset.jumps[0], np.zeros(WORKS)])
    after = {0: state} if struck[0] else {}
    inner = np.zeros(0) if breaks is None else breaks[(breaks > times[0]) & (breaks < times[-1])]
    stops = np.unique(np.concatenate([times[[0, -1]], times[struck], inner]))
    for start, end in itertools.pairwise(stops):
        places = np.flatnonzero((times > start) & (times <= end))
        inside = times[places]
        wanted = inside if len(inside) and inside[-1] == end else np.append(inside, end)
        # a load that jumps at the end of a stretch belongs to the next one
        last = np.nextafter(end, start)
        solved = scipy.integrate.solve_ivp(
            lambda t, x, last=last: loop_at(min(t, last)).rate(x, given(min(t, last))),
            (start, end),
            state,
            method=method,
            t_eval=wanted,
            jac=lambda t, x, last=last: loop_at(min(t, last)).jacobian(x, given(min(t, last))),
            rtol=tolerance,
            atol=allowed,
            max_step=longest,
        )
        if not solved.success:
            raise ConvergenceError(
                f"the motion could not be integrated from t = {start:.4g} s to {end:.4g} s: {solved.message}; "
                "give friction a larger smoothing, or the machine some damping"
            )
        state, asked = solved.y[:, -1], asked + int(solved.nfev)
        left.append(solved.y.T[: len(inside)])
        if len(places) and struck[places[-1]]:
            number = int(places[-1])
            state = after[number] = _strike(loop_at(end), state, outset.jumps[number])
    before = np.concatenate(left)
    right = before.copy() if after else before
    for number, changed in after.items():
        right[number] = changed
    return _collect(loop_at, given, times, left=before, right=right, asked=asked)


def _strike(model: RubbingLoop, full: FloatArray, jump: FloatArray) -> FloatArray:
    """States and works after an impulse; what it adds to the energy is work of the loads."""
    after = full.copy()
    after[: model.size] += jump
    after[model.size + LOADS] += float(
        model.stored_energy(after[: model.size]) - model.stored_energy(full[: model.size])
    )
    return after


def _coarse_states(model: RubbingLoop, given: Given, times: FloatArray) -> FloatArray:
    """States ``(p, m)`` of a coarse linear run from rest without friction."""
    instants = np.linspace(times[0], times[-1], PROBES)
    step = float(instants[1] - instants[0])
    unit = np.eye(model.size)
    # implicit Euler: rough and never unstable; only sizes are wanted
    solve = np.linalg.inv(unit - step * model.loop.space.a)
    state: FloatArray = np.zeros(model.size)
    states = np.zeros((PROBES, model.size))
    for number, instant in enumerate(instants):
        state = solve @ (
            state + step * model.loop.space.b[:, : model.given] @ given(float(instant))
        )
        states[number] = state
    return states


def _state_scale(model: RubbingLoop, states: FloatArray, duration: float) -> FloatArray:
    """How large each kind of state gets ``(m + 5,)``, from states ``(p, m)`` as large."""
    machine = model.loop.plant_size
    dry = sum(max(law.coulomb, law.breakaway) for law in model.laws)
    energy = float(model.stored_energy(states).max(initial=0.0))
    energy = max(
        energy,
        dry * float(np.abs(states @ model.slides.T + model.guides).max(initial=0.0)) * duration,
        1e-12,
    )
    scale: FloatArray = np.full(model.size + WORKS, energy)
    scale[:machine] = np.sqrt(2.0 * energy)
    scale[machine : model.size] = max(
        float(np.abs(states[:, machine:]).max(initial=0.0)), dry, 1e-6
    )
    return scale


def _collect(
    loop_at: LoopAt,
    given: Given,
    times: FloatArray,
    *,
    left: FloatArray,
    right: FloatArray,
    asked: int,
) -> DrivenMotion:
    """The motion of states and works ``(n, m + 5)`` just before and after each time."""
    first, count = loop_at(float(times[0])), len(times)
    outputs = np.empty((count, len(first.loop.space.c)))
    rubbed, stored = np.empty((count, len(first.laws))), np.empty(count)
    for number, instant in enumerate(times):
        model = loop_at(float(instant))
        state = right[number, : model.size]
        inputs, space = given(float(instant)), model.loop.space
        rubbed[number] = model.friction(model.slides @ state + model.guides)
        stored[number] = model.stored_energy(state)
        outputs[number] = (
            space.c @ state
            + space.d[:, : model.given] @ inputs
            - space.d[:, model.given :] @ rubbed[number]
        )
    drives, loads, damping, friction, pose = right[:, -WORKS:].T
    return DrivenMotion(
        times=times,
        left=left[:, :-WORKS],
        right=right[:, :-WORKS],
        outputs=outputs,
        friction=rubbed,
        energy=EnergyBalance(stored, drives, loads, damping, friction, pose),
        evaluations=asked,
    )
