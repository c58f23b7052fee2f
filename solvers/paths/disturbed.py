"""Deviation from a path by loads along it that do not come from its acceleration: errors of guides
as they are passed.
"""

import math
from collections.abc import Callable, Sequence

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.damping import equivalent_viscous
from headstock.solvers.linear.modal_coordinates import to_modal_coordinates
from headstock.solvers.linear.state_space import StateSpace, modal_state_space
from headstock.solvers.linear.time_response import solve_stepped_response
from headstock.solvers.paths.response import PathDeviation
from headstock.solvers.second_order import Channel, SecondOrderSystem
from headstock.solvers.watched_outputs import Watch


def solve_disturbed_path(
    system: SecondOrderSystem,
    outputs: Sequence[Channel],
    loads: Callable[[FloatArray], FloatArray],
    *,
    channels: Sequence[Channel],
    feedthrough: FloatArray,
    samples: FloatArray,
    load_step: float,
    low_frequency_limit_hz: float,
    watch: Watch,
) -> PathDeviation:
    """Deviation of a system at rest under loads that begin at zero, exact for loads that are
    straight between fine steps.

    Args:
        system: Symmetric, with the channels among its inputs.
        outputs: Where the deviation is wanted.
        loads: ``(n, k)`` at instants ``(n,)``.
        channels: Where they act.
        feedthrough: ``(n_outputs + r, j)`` what the outputs, and the first of what is watched, have of
            the first loads at once, whatever moves.
        samples: ``(n,)`` evenly spaced, from zero [s].
        load_step: Longest time over which a load may be taken for straight [s].
        low_frequency_limit_hz: Modes below count as low-frequency response [Hz].
        watch: What else is wanted of it.

    Raises:
        ModelError: A channel is unknown, or a damper acts on a dof without mass.
    """
    wanted = (*outputs, *watch.outputs)
    coordinates = to_modal_coordinates(equivalent_viscous(system), channels, wanted)
    if coordinates is None:
        raise ModelError(
            "a damper acts on a dof without mass, or a matrix is not symmetric; give every body a mass"
        )
    fine, parts = _refine(samples, load_step)
    given = loads(fine)
    space = modal_state_space(coordinates, tuple(channels), wanted)
    count, watched = len(outputs), space.watch(watch)
    below = np.repeat(coordinates.omega < 2.0 * np.pi * low_frequency_limit_hz, 2)
    shown, passed = space.c[:count], space.d[:count]
    rows = np.vstack([shown, np.where(below, shown, 0.0), watched.states])
    direct = np.vstack([passed, np.zeros_like(passed), watched.inputs])
    stretched = StateSpace(
        space.a, space.b, rows, direct, space.inputs, (), space.states, space.pairs
    )
    steps = np.stack([given[:-1], given[1:]], axis=1)
    moved = solve_stepped_response(stretched, fine, steps).outputs[::parts]
    fast = coordinates.omega >= 2.0 * np.pi * low_frequency_limit_hz
    share = (
        coordinates.outputs[:count, fast] / coordinates.eigenvalues[fast]
    ) @ coordinates.inputs[fast]
    if not coordinates.complete:
        share = share + coordinates.residual[:count]
    at_once, beside = _pass_through(given[::parts], feedthrough, count)
    total, low_frequency = moved[:, :count] + at_once, moved[:, count : 2 * count]
    seen = moved[:, 2 * count :]
    seen[:, : beside.shape[1]] += beside
    quasi_static = given[::parts] @ share.T + at_once
    return PathDeviation(
        samples, total, quasi_static, low_frequency, total - quasi_static - low_frequency, seen
    )


def _pass_through(
    given: FloatArray, feedthrough: FloatArray, outputs: int
) -> tuple[FloatArray, FloatArray]:
    """What loads ``(n, k)`` do at once to outputs ``(n, n_outputs)`` and to what is watched ``(n, r)``."""
    found = given[:, : feedthrough.shape[1]] @ feedthrough.T
    return found[:, :outputs], found[:, outputs:]


def solve_disturbed_loop(
    loop: StateSpace,
    outputs: int,
    loads: Callable[[FloatArray], FloatArray],
    *,
    channels: Sequence[Channel],
    feedthrough: FloatArray,
    samples: FloatArray,
    load_step: float,
    watch: Watch,
) -> PathDeviation:
    """The same of a closed loop that holds its set points; its quasi-static part is what it holds
    under constant loads.

    Args:
        loop: Stable, with the channels among its inputs.
        outputs: How many of its first outputs are wanted.
        loads: ``(n, k)`` at instants ``(n,)``.
        channels: Where they act.
        feedthrough: ``(n_outputs + r, j)`` what the outputs, and the first of what is watched, have of
            the first loads at once, whatever moves.
        samples: ``(n,)`` evenly spaced, from zero [s].
        load_step: Longest time over which a load may be taken for straight [s].
        watch: What else is wanted of it.
    """
    columns, watched = [loop.inputs.index(channel) for channel in channels], loop.watch(watch)
    b = loop.b[:, columns]
    c = np.vstack([loop.c[:outputs], watched.states])
    d = np.vstack([loop.d[:outputs, columns], watched.inputs[:, columns]])
    fine, parts = _refine(samples, load_step)
    given = loads(fine)
    steps = np.stack([given[:-1], given[1:]], axis=1)
    alone = StateSpace(loop.a, b, c, d, tuple(channels), (), loop.states)
    found = solve_stepped_response(alone, fine, steps).outputs[::parts]
    at_once, beside = _pass_through(given[::parts], feedthrough, outputs)
    total, seen = found[:, :outputs] + at_once, found[:, outputs:]
    seen[:, : beside.shape[1]] += beside
    held = given[::parts] @ (d - c @ np.linalg.solve(loop.a, b))[:outputs].T + at_once
    return PathDeviation(samples, total, held, np.zeros_like(total), total - held, seen)


def _refine(samples: FloatArray, load_step: float) -> tuple[FloatArray, int]:
    """Instants ``(n,)`` with no step longer than allowed, and how many steps per sample."""
    parts = max(1, math.ceil((samples[1] - samples[0]) / load_step))
    return np.asarray(
        np.linspace(samples[0], samples[-1], parts * (len(samples) - 1) + 1), dtype=float
    ), parts
