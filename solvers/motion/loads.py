"""Loads that act on a machine while it travels along a straight path, such as those of a cut."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray
from headstock.solvers.motion.set_points import (
    SetPoint,
    sample_move,
    step_accelerations,
    step_times,
)
from headstock.solvers.second_order import Channel


@dataclass(frozen=True, eq=False)
class PathLoads:
    """Loads on a machine along a path.

    Attributes:
        channels: Where they act.
        at: Loads ``(n, n_loads)`` at instants and at the speeds along the path there.
        step: Longest time over which a load may be taken for straight [s].
    """

    channels: tuple[Channel, ...]
    at: Callable[[FloatArray, FloatArray], FloatArray]
    step: float


def cut_times(samples: FloatArray, loads: PathLoads | None) -> tuple[FloatArray, int]:
    """Instants between which loads are straight, and into how many of them a sample is cut.

    Args:
        samples: ``(n,)`` evenly spaced [s].
        loads: None where there are none.
    """
    return refine_times(samples, longest_step(loads))


def refine_times(samples: FloatArray, longest: float) -> tuple[FloatArray, int]:
    """Return instants ``(n,)`` with no step longer than allowed, and how many steps a sample takes."""
    parts = max(1, math.ceil((samples[1] - samples[0]) / longest))
    fine = np.linspace(samples[0], samples[-1], parts * (len(samples) - 1) + 1)
    return np.asarray(fine, dtype=float), parts


def load_channels(loads: PathLoads | None) -> tuple[Channel, ...]:
    """Return the inputs on which loads act."""
    return () if loads is None else loads.channels


def longest_step(loads: PathLoads | None) -> float:
    """Longest time over which loads may be taken for straight [s]."""
    return math.inf if loads is None else loads.step


def loads_at(loads: PathLoads | None, times: FloatArray, speeds: FloatArray) -> FloatArray:
    """Loads ``(n, n_loads)`` at instants and speeds along the path; no column where there are none."""
    return np.zeros((len(times), 0)) if loads is None else loads.at(times, speeds)


def path_inputs(loads: PathLoads | None, move: SetPoint, times: FloatArray) -> FloatArray:
    """Return position, speed and acceleration along the path, then loads ``(n, 3 + k)``, at instants."""
    now = sample_move(move, times)
    motion = [now.positions, now.speeds, now.accelerations]
    return np.column_stack([*motion, loads_at(loads, times, now.speeds)])


@dataclass(frozen=True, eq=False)
class SteppedInputs:
    """Inputs on steps over which they are linear.

    Attributes:
        times: ``(n,)`` samples, and what is needed between them [s].
        wanted: Which of these are samples.
        ends: ``(n - 1, 2, k)`` at the begin and the end of each step.
        now: ``(n_samples, k)`` at the samples.
    """

    times: FloatArray
    wanted: NDArray[np.intp]
    ends: FloatArray
    now: FloatArray


def step_move(loads: PathLoads | None, move: SetPoint, samples: FloatArray) -> SteppedInputs:
    """Return acceleration along the path, then loads, with a step's end at every break of a move.

    Args:
        samples: ``(n,)`` evenly spaced, from zero [s].
    """
    fine, parts = cut_times(samples, loads)
    times, places = step_times(move, fine)
    acting = loads_at(loads, times, sample_move(move, times).speeds)
    ends = np.stack([acting[:-1], acting[1:]], axis=1)
    ends = np.concatenate([step_accelerations(move, times)[:, :, None], ends], axis=2)
    return SteppedInputs(times, places[::parts], ends, path_inputs(loads, move, samples)[:, 2:])
