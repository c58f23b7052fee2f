"""Loads over time on a machine under control whose guides evaluate_friction: a driven motion on the steps of a
transient analysis.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.solvers.control.drive_loops import ClosedLoop
from headstock.solvers.control.driven_motion import DrivenMotion, Outset, integrate_motion
from headstock.solvers.control.friction import friction_force, friction_slope
from headstock.solvers.control.friction_loop import FrictionLoop, make_friction_loop
from headstock.solvers.control.loop_track import Given, still_track
from headstock.solvers.linear.load_history import SteppedLoads
from headstock.solvers.linear.transient import EnergyBalance, Motion, Response
from headstock.solvers.second_order import Channel


@dataclass(frozen=True, eq=False)
class FrictionTransient:
    """What a controlled machine with friction did under loads over time.

    Attributes:
        friction: ``(n - 1, k)`` force against the motion at the begin of each step, and at its end
            [N].
    """

    motion: DrivenMotion
    friction: tuple[FloatArray, FloatArray]
    response: Response
    energy: EnergyBalance


def sharpen_friction(loop: ClosedLoop, share: float) -> ClosedLoop:
    """The loop with friction that changes its sign over a share of the speed.

    Args:
        loop: Closed with ``friction_channels`` of its drives.
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
    free: Motion,
    *,
    inputs: Sequence[Channel],
    outputs: Sequence[Channel],
) -> FrictionTransient:
    """Motion under loads with friction, set points at rest.

    Args:
        loop: Closed with the inputs and ``friction_channels`` of its drives.
        free: The same motion without friction, which begins alike and tells how large states get.
        inputs: Where the loads act.

    Raises:
        ConvergenceError: Friction does not settle.
    """
    # several loads may act on one channel
    rows = {channel: np.array([float(other == channel) for other in inputs]) for channel in inputs}
    model = make_friction_loop(loop, rows)
    found = integrate_motion(
        still_track(model),
        _follow_loads(loads),
        loads.times,
        outset=Outset(free.left[0], loads.impulses @ model.b.T, free.right),
    )
    friction_forces = (
        friction_force(model.law, found.right[:-1] @ model.slides.T),
        friction_force(model.law, found.left[1:] @ model.slides.T),
    )
    return FrictionTransient(
        found,
        friction_forces,
        _read_outputs(model, loads, found, friction_forces, outputs),
        _add_energies(model, found),
    )


def _follow_loads(loads: SteppedLoads) -> Given:
    """Loads ``(n, k)`` at times; where one jumps, that after it."""

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
    """Displacements and speeds of the outputs wanted."""
    space = model.loop.space
    wanted = space.rows.of(outputs)
    rows, direct, passed = space.c[wanted], model.d[wanted], model.passed[wanted]
    values, rates = loads.evaluate()
    moved, speeds = [], []
    for end, states in enumerate((motion.right[:-1], motion.left[1:])):
        sliding, friction_forces = states @ model.slides.T, friction[end]
        changes = states @ space.a.T + values[:, end] @ model.b.T - friction_forces @ model.drag.T
        slopes = friction_slope(model.law, sliding)
        moved.append(states @ rows.T + values[:, end] @ direct.T - friction_forces @ passed.T)
        speeds.append(
            changes @ rows.T
            + rates[:, end] @ direct.T
            - (slopes * (changes @ model.slides.T)) @ passed.T
        )
    return Response(loads.times, moved[0], moved[1], speeds[0], speeds[1], loads.sampled)


def _add_energies(model: FrictionLoop, motion: DrivenMotion) -> EnergyBalance:
    """Works of drives and loads beside what dampers and friction take."""
    every, first = motion.energy, model.stored_energy(motion.left[0])
    begun = float(every.stored[0] - first)  # by an impulse at the first time
    return EnergyBalance(
        initial=float(first),
        work=begun + float(every.drives[-1] + every.loads[-1]),
        dissipated=float(every.damping[-1] + every.friction[-1]),
        final=float(every.stored[-1]),
        largest=float(every.stored.max()),
    )
