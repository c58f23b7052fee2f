"""A machine under control in time, with friction in its guides: a stiff integrator, and where the
energy went.
"""

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy.integrate

from headstock.geometry.frames import FloatArray
from headstock.solvers.control.drive_loops import ClosedLoop
from headstock.solvers.control.friction_loop import WORKS, RubbingLoop, make_rubbing_loop
from headstock.solvers.errors import ConvergenceError

TOLERANCE = 1e-8
PROBES = 2000

Given = Callable[[float], FloatArray]


@dataclass(frozen=True, eq=False)
class EnergyBalance:
    """Energies over time ``(n,)`` [J], counted from the start.

    Attributes:
        stored: Kinetic and strain energy of the machine.
        drives: Work of the drive forces.
        loads: Work of the loads.
        damping: Lost in dampers.
        friction: Lost in the guides.
    """

    stored: FloatArray
    drives: FloatArray
    loads: FloatArray
    damping: FloatArray
    friction: FloatArray

    @property
    def error(self) -> float:
        """Largest energy that is missing, over the largest that is stored, was put in or lost."""
        missing = (
            self.stored - self.stored[0] - self.drives - self.loads + self.damping + self.friction
        )
        every = (self.stored, self.drives, self.loads, self.damping, self.friction)
        size = max(float(np.abs(part).max()) for part in every)
        return float(np.abs(missing).max()) / size if size > 0.0 else 0.0


@dataclass(frozen=True, eq=False)
class DrivenMotion:
    """What a controlled machine did.

    Attributes:
        times: ``(n,)`` [s].
        outputs: ``(n, n_outputs)`` of the closed loop.
        friction: ``(n, k)`` force against the motion there [N].
        energy: Where it went.
        evaluations: How often the rate of change was asked for.
    """

    times: FloatArray
    outputs: FloatArray
    friction: FloatArray
    energy: EnergyBalance
    evaluations: int


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

    The works are integrated along with the states, so that their balance tells the integrator's
    error.

    Args:
        loop: Closed with the given loads, then ``friction_channels`` of its drives, as inputs.
        given: Set points, then loads, at an instant.
        times: ``(n,)`` instants wanted, rising; the first is the start.
        breaks: Instants at which what is given jumps or kinks: no step reaches over one.
        method: Of scipy.
        tolerance: Relative, per step.

    Raises:
        ConvergenceError: The integrator gave up.

    Source: Hairer and Wanner (1996), Solving Ordinary Differential Equations II, section IV.8
    (Radau IIA of order five).
    """
    times = np.asarray(times, dtype=float)
    model = make_rubbing_loop(loop)
    allowed = tolerance * _state_scale(model, given, times)
    state: FloatArray = np.zeros(model.size + WORKS)
    parts, asked = [np.zeros((1, model.size + WORKS))], 0
    inner = np.zeros(0) if breaks is None else breaks[(breaks > times[0]) & (breaks < times[-1])]
    stops = np.unique(np.concatenate([times[[0, -1]], inner]))
    for start, end in itertools.pairwise(stops):
        inside = times[(times > start) & (times <= end)]
        wanted = inside if len(inside) and inside[-1] == end else np.append(inside, end)
        # a load that jumps at the end of a stretch belongs to the next one
        last = np.nextafter(end, start)
        solved = scipy.integrate.solve_ivp(
            lambda t, x, last=last: model.rate(x, given(min(t, last))),
            (start, end),
            state,
            method=method,
            t_eval=wanted,
            jac=lambda t, x, last=last: model.jacobian(x, given(min(t, last))),
            rtol=tolerance,
            atol=allowed,
        )
        if not solved.success:
            raise ConvergenceError(
                f"the motion could not be integrated from t = {start:.4g} s to {end:.4g} s: {solved.message}; "
                "give friction a larger smoothing, or the machine some damping"
            )
        state, asked = solved.y[:, -1], asked + int(solved.nfev)
        parts.append(solved.y.T[: len(inside)])
    return _collect(model, given, times, np.concatenate(parts), asked)


def _state_scale(model: RubbingLoop, given: Given, times: FloatArray) -> FloatArray:
    """How large each kind of state gets ``(n + 4,)``, from a coarse linear run without friction."""
    machine = model.loop.plant_size
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
    dry = sum(max(law.coulomb, law.breakaway) for law in model.laws)
    energy = float(model.stored_energy(states).max(initial=0.0))
    energy = max(
        energy,
        dry * float(np.abs(states @ model.slides.T).max(initial=0.0)) * (times[-1] - times[0]),
        1e-12,
    )
    scale: FloatArray = np.full(model.size + WORKS, energy)
    scale[:machine] = np.sqrt(2.0 * energy)
    scale[machine : model.size] = max(
        float(np.abs(states[:, machine:]).max(initial=0.0)), dry, 1e-6
    )
    return scale


def _collect(
    model: RubbingLoop, given: Given, times: FloatArray, full: FloatArray, asked: int
) -> DrivenMotion:
    states, works = full[:, : model.size], full[:, model.size :]
    inputs = np.array([given(float(instant)) for instant in times])
    drives, loads, damping, friction = works.T
    speeds = np.asarray(states @ model.slides.T)
    space = model.loop.space
    rubbed = model.friction(speeds)
    return DrivenMotion(
        times=times,
        outputs=states @ space.c.T
        + inputs @ space.d[:, : model.given].T
        - rubbed @ space.d[:, model.given :].T,
        friction=rubbed,
        energy=EnergyBalance(model.stored_energy(states), drives, loads, damping, friction),
        evaluations=asked,
    )
