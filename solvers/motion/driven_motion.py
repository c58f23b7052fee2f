"""A machine under control in time, with friction in its guides, and its energy balance.

Steps are exact but for friction (``friction_loop``). They are as long as inputs and natural modes
allow, and are halved where friction is not represented by a parabola.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.solvers.control.drive_loops import ClosedLoop
from headstock.solvers.motion.friction import friction_force, friction_slope
from headstock.solvers.motion.friction_integrator import (
    CHUNK,
    WORKS,
    FrictionIntegrator,
    cut_steps,
    find_rare_sizes,
)
from headstock.solvers.motion.friction_loop import (
    GIVEN,
    FrictionLoop,
    Given,
    IntArray,
    LoopTrack,
    make_friction_loop,
    still_track,
)
from headstock.solvers.second_order import Channel
from headstock.solvers.state_spaces.load_history import SteppedLoads
from headstock.solvers.state_spaces.transient import EnergyBalance, Response, StateHistory

TOLERANCE = 1e-10  # error of a step by friction, as a share of the size of each kind of state
ANGLE = 8.0  # phase of the fastest natural mode in a step [rad]: works are integrated inside it
PROBES = 2000


@dataclass(frozen=True, eq=False)
class _EnergyHistory:
    """Store energies over time ``(n,)`` [J], counted from the start.

    Attributes:
        stored: Kinetic and strain energy of the machine.
    """

    stored: FloatArray
    drives: FloatArray
    loads: FloatArray
    damping: FloatArray
    friction: FloatArray
    pose: FloatArray

    @property
    def error(self) -> float:
        """Return the largest missing energy, over the largest that is stored, put in or lost."""
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
    """Store the motion of a controlled machine.

    Attributes:
        times: ``(n,)`` [s].
        left: ``(n, m)`` states just before each time.
        right: ``(n, m)`` and just after it: an impulse lies between them.
        outputs: ``(n, p)`` of the closed loop, just after each time.
        friction: ``(n, k)`` force against the motion there [N].
    """

    times: FloatArray
    left: FloatArray
    right: FloatArray
    outputs: FloatArray
    friction: FloatArray
    energy: _EnergyHistory
    steps: int


@dataclass(frozen=True, eq=False)
class _InitialState:
    """Define the initial state of a motion not from rest, and impulses during it.

    Attributes:
        state: ``(m,)`` before the first time.
        jumps: ``(n, m)`` of the state at each time, by impulses.
        sizes: ``(p, m)`` states of the expected size.
    """

    state: FloatArray
    jumps: FloatArray
    sizes: FloatArray


def solve_motion(
    loop: ClosedLoop,
    given: Given,
    times: FloatArray,
    *,
    spread: Mapping[Channel, FloatArray] | None = None,
    breaks: FloatArray | None = None,
    longest: float = np.inf,
) -> DrivenMotion:
    """Integrate the motion from rest under set points and loads, with the friction of every drive
    that has one.

    Args:
        loop: Closed loop with ``friction_channels`` of its drives among its inputs.
        given: Returns inputs ``(n, q)`` at times ``(n,)``.
        times: ``(n,)`` instants wanted, rising; the first is the start.
        spread: Set points and loads to their rows ``(q,)`` of the inputs; None for these
            themselves, in their order.
        breaks: Instants at which inputs or their slopes jump: no step extends over one.
        longest: Longest step in which inputs are polynomials of degree four [s].

    Raises:
        ConvergenceError: Newton's method for friction does not converge.
    """
    track = still_track(make_friction_loop(loop, spread))
    return integrate_track(track, given, times, breaks=breaks, longest=longest)


def integrate_track(
    track: LoopTrack,
    given: Given,
    times: FloatArray,
    *,
    breaks: FloatArray | None = None,
    initial: _InitialState | None = None,
    longest: float = np.inf,
) -> DrivenMotion:
    """Integrate the same of a loop that may change along a path, from any state.

    A step is that of the pose at its middle. Works are integrated inside every step, that of
    friction by its law, so that their balance shows the error of the parabolas.

    Args:
        given: Returns inputs ``(n, q)`` at times ``(n,)``.
        times: ``(n,)`` instants wanted, rising; the first is the start.
        breaks: Instants at which inputs or their slopes jump: no step extends over one.
        initial: Initial state and impulses; None for rest.
        longest: Longest step in which inputs are polynomials of degree four [s].

    Raises:
        ConvergenceError: Newton's method for friction does not converge.
    """
    times = np.asarray(times, dtype=float)
    typical = track.loop(len(track.places) // 2)
    initial = initial or _InitialState(
        np.zeros(typical.size),
        np.zeros((len(times), typical.size)),
        _coarse_states(typical, given, times),
    )
    allowed = TOLERANCE * _state_scale(typical, initial.sizes, float(times[-1] - times[0]))
    grid = cut_steps(times, breaks, given, min(longest, ANGLE / _fastest_mode(typical)))
    wanted = np.searchsorted(grid, times)
    kept = {int(instant): number for number, instant in enumerate(wanted)}
    left = np.empty((len(times), typical.size))
    right = np.empty_like(left) if initial.jumps.any() else left
    works, posed = np.zeros((len(grid), len(WORKS))), np.zeros(len(grid))
    steps, integrator = np.diff(grid), FrictionIntegrator(track, typical, allowed)
    few = find_rare_sizes(steps) & (not track.still)
    state = initial.state
    for start in range(0, len(steps), CHUNK):
        part = slice(start, min(start + CHUNK, len(steps)))
        after = slice(start + 1, part.stop + 1)
        inside = grid[part, None] + steps[part, None] * GIVEN
        forced = given(inside.ravel()).reshape(len(inside), -1)
        middles = track.positions(0.5 * (grid[part] + grid[after]))
        firsts, shares = track.near(middles)
        begun, ended = (np.empty((len(inside), typical.size)) for _ in range(2))
        for number in range(len(inside)):
            if part.start + number in kept:
                instant = kept[part.start + number]
                left[instant] = state
                state = right[instant] = state + initial.jumps[instant]
            begun[number] = state
            state = ended[number] = integrator.advance(
                number,
                state,
                forced[number],
                size=float(steps[part.start + number]),
                near=(int(firsts[number]), shares[number]),
                alone=float(middles[number]) if few[part.start + number] else None,
            )
        works[after] = integrator.collect_works(len(inside))
        if not track.still:
            ends = grid[start : part.stop + 1]
            posed[after] = _posed_work(track, ends, middles, begun, ended)
    left[-1], right[-1] = state, state + initial.jumps[-1]
    positions = track.positions(times)
    friction_forces, outputs = _observe(track, positions, right, given(times))
    return DrivenMotion(
        times=times,
        left=left,
        right=right,
        outputs=outputs,
        friction=friction_forces,
        energy=_add_works(
            _stored(track, positions, left),
            _stored(track, positions, right),
            np.cumsum(works, axis=0)[wanted],
            np.cumsum(posed)[wanted],
        ),
        steps=integrator.steps,
    )


def _add_works(
    before: FloatArray, stored: FloatArray, works: FloatArray, pose: FloatArray
) -> _EnergyHistory:
    """Return the balance of energies ``(n,)`` stored just before and just after each time, and of works
    ``(n, 4)`` until then.
    """
    # what impulses add is work of the loads; works count from just after the first time
    struck = np.cumsum(np.where(np.arange(len(stored)) > 0, stored - before, 0.0))
    drives, loads, damping, friction = works.T
    return _EnergyHistory(stored, drives, loads + struck, damping, friction, pose)


def _posed_work(
    track: LoopTrack, grid: FloatArray, middles: FloatArray, begun: FloatArray, ended: FloatArray
) -> FloatArray:
    """Return the change of stored energy ``(n,)`` by the change of pose in each step, from its
    begin to its middle and on to its end.
    """
    positions = track.positions(grid)
    return (
        _stored(track, middles, begun)
        - _stored(track, positions[:-1], begun)
        + _stored(track, positions[1:], ended)
        - _stored(track, middles, ended)
    )


def _stored(track: LoopTrack, positions: FloatArray, states: FloatArray) -> FloatArray:
    """Return the stored energy ``(n,)`` of states in their poses."""
    return track.blend(positions, lambda model, which: model.stored_energy(states[which]))


def _observe(
    track: LoopTrack, positions: FloatArray, states: FloatArray, given: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return friction ``(n, k)`` and outputs ``(n, p)``."""
    friction_forces = friction_force(
        track.loop(0).law,
        track.blend(
            positions,
            lambda model, which: states[which] @ model.slides.T + given[which] @ model.guides.T,
        ),
    )

    def outputs(model: FrictionLoop, which: slice | IntArray) -> FloatArray:
        space, rows = model.loop.space, slice(None) if track.rows is None else track.rows
        return (
            states[which] @ space.c[rows].T
            + given[which] @ model.d[rows].T
            - friction_forces[which] @ model.feedthrough[rows].T
        )

    return friction_forces, track.blend(positions, outputs)


def _fastest_mode(model: FrictionLoop) -> float:
    """Return the highest natural frequency of the machine with free motors [rad/s]."""
    return float(np.abs(np.linalg.eigvals(model.loop.plant.a).imag).max(initial=1e-9))


def _coarse_states(model: FrictionLoop, given: Given, times: FloatArray) -> FloatArray:
    """Return states ``(p, m)`` of a coarse linear run from rest without friction."""
    instants = np.linspace(times[0], times[-1], PROBES)
    step = float(instants[1] - instants[0])
    # implicit Euler: rough and never unstable; only sizes are wanted
    solve = np.linalg.inv(np.eye(model.size) - step * model.loop.space.a)
    pushes = step * given(instants) @ model.b.T
    state: FloatArray = np.zeros(model.size)
    states = np.zeros((PROBES, model.size))
    for number, push in enumerate(pushes):
        state = solve @ (state + push)
        states[number] = state
    return states


def _state_scale(model: FrictionLoop, states: FloatArray, duration: float) -> FloatArray:
    """Return the size ``(m,)`` of each kind of state, from states ``(p, m)`` as large."""
    machine = model.loop.plant_size
    dry = float(np.maximum(model.law.coulomb, model.law.breakaway).sum())
    energy = float(model.stored_energy(states).max(initial=0.0))
    slid = float(np.abs(states @ model.slides.T).max(initial=0.0))
    energy = max(energy, dry * slid * duration, 1e-12)
    scale: FloatArray = np.full(model.size, np.sqrt(2.0 * energy))
    scale[machine:] = max(float(np.abs(states[:, machine:]).max(initial=0.0)), dry, 1e-6)
    return scale


@dataclass(frozen=True, eq=False)
class FrictionTransient:
    """Store the motion of a controlled machine with friction under loads over time.

    Attributes:
        friction: ``(n - 1, k)`` force against the motion at the begin of each step, and at its end
            [N].
    """

    motion: DrivenMotion
    friction: tuple[FloatArray, FloatArray]
    response: Response
    energy: EnergyBalance


def sharpen_friction(loop: ClosedLoop, share: float) -> ClosedLoop:
    """Return the loop with friction whose sign changes over a share of the present speed range.

    Args:
        loop: Closed loop with ``friction_channels`` of its drives.
    """
    trains = tuple(
        train
        if train.friction is None
        else dataclasses.replace(
            train,
            friction=dataclasses.replace(
                train.friction, smoothing=share * train.friction.smoothing
            ),
        )
        for train in loop.trains
    )
    return dataclasses.replace(loop, trains=trains)


def solve_friction_transient(
    loop: ClosedLoop,
    loads: SteppedLoads,
    free: StateHistory,
    *,
    inputs: Sequence[Channel],
    outputs: Sequence[Channel],
) -> FrictionTransient:
    """Compute the motion under loads with friction, set points at rest.

    Args:
        loop: Closed loop with the inputs and ``friction_channels`` of its drives.
        free: The same motion without friction, for its initial state and the size of states.

    Raises:
        ConvergenceError: Newton's method for friction does not converge.
    """
    # several loads may act on one channel
    rows = {channel: np.array([float(other == channel) for other in inputs]) for channel in inputs}
    model = make_friction_loop(loop, rows)
    motion = integrate_track(
        still_track(model),
        _follow_loads(loads),
        loads.times,
        initial=_InitialState(free.left[0], loads.impulses @ model.b.T, free.right),
    )
    friction_forces = (
        friction_force(model.law, motion.right[:-1] @ model.slides.T),
        friction_force(model.law, motion.left[1:] @ model.slides.T),
    )
    return FrictionTransient(
        motion,
        friction_forces,
        _read_outputs(model, loads, motion, friction_forces, outputs),
        _add_energies(model, motion),
    )


def _follow_loads(loads: SteppedLoads) -> Given:
    """Return a function for loads ``(n, k)`` at times; at jumps, the value after them."""

    def given(times: FloatArray) -> FloatArray:
        numbers = np.searchsorted(loads.times, times, side="right") - 1
        numbers = np.clip(numbers, 0, len(loads.times) - 2)
        since = (times - loads.times[numbers])[:, None]
        share = since / loads.steps[numbers][:, None]
        begins, ends = loads.linear[numbers, 0], loads.linear[numbers, 1]
        now = (1.0 - share) * begins + share * ends
        for sine in loads.sines:
            s, c = np.sin(sine.omega * since), np.cos(sine.omega * since)
            now = now + sine.forward[numbers] * s + sine.quadrature[numbers] * c
        return np.asarray(now)

    return given


def _read_outputs(
    model: FrictionLoop,
    loads: SteppedLoads,
    motion: DrivenMotion,
    friction: tuple[FloatArray, FloatArray],
    outputs: Sequence[Channel],
) -> Response:
    """Return displacements and speeds of the outputs wanted."""
    space = model.loop.space
    wanted = space.rows.of(outputs)
    rows, direct, feedthrough = space.c[wanted], model.d[wanted], model.feedthrough[wanted]
    values, rates = loads.evaluate()
    moved, speeds = [], []
    for end, states in enumerate((motion.right[:-1], motion.left[1:])):
        sliding, friction_forces = states @ model.slides.T, friction[end]
        changes = states @ space.a.T + values[:, end] @ model.b.T - friction_forces @ model.drag.T
        slopes = friction_slope(model.law, sliding)
        moved.append(states @ rows.T + values[:, end] @ direct.T - friction_forces @ feedthrough.T)
        speeds.append(
            changes @ rows.T
            + rates[:, end] @ direct.T
            - (slopes * (changes @ model.slides.T)) @ feedthrough.T
        )
    return Response(loads.times, moved[0], moved[1], speeds[0], speeds[1], loads.sampled)


def _add_energies(model: FrictionLoop, motion: DrivenMotion) -> EnergyBalance:
    """Return the energy balance: works of drives and loads, losses in dampers and friction."""
    every, first = motion.energy, model.stored_energy(motion.left[0])
    begun = float(every.stored[0] - first)  # by an impulse at the first time
    return EnergyBalance(
        initial=float(first),
        work=begun + float(every.drives[-1] + every.loads[-1]),
        dissipated=float(every.damping[-1] + every.friction[-1]),
        final=float(every.stored[-1]),
        largest=float(every.stored.max()),
    )
