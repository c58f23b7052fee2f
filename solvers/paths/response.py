"""Deviation from a path while its axes accelerate, in a pose that stays: exact, and split into what follows and what rings."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.damping import equivalent_viscous
from headstock.solvers.linear.modal_coordinates import ModalCoordinates, count_modes, keep_modes, to_modal_coordinates
from headstock.solvers.linear.state_space import modal_state_space
from headstock.solvers.linear.time_response import solve_stepped_response
from headstock.solvers.paths.set_points import SetPoint, list_breaks, sample_move, step_accelerations
from headstock.solvers.second_order import Port, SecondOrderSystem

SAME_INSTANT = 1e-9  # a break so near to a sample, as a share of the step, is the sample


@dataclass(frozen=True, eq=False)
class PathDeviation:
    """Deviation at the outputs, sampled; the three parts add up to the total.

    Attributes:
        times: ``(n,)`` [s].
        total: ``(n, n_outputs)`` [m, rad].
        quasi_static: ``(n, n_outputs)``: every mode that is faster than the ramp follows its load at once.
        sway: ``(n, n_outputs)``: the slower modes, in which the machine sways on soft mounts as a whole.
        dynamic: ``(n, n_outputs)``: the ringing of the faster modes.
    """

    times: FloatArray
    total: FloatArray
    quasi_static: FloatArray
    sway: FloatArray
    dynamic: FloatArray


@dataclass(frozen=True)
class PathModel:
    """What a deviation is computed of.

    Attributes:
        source: Input of the acceleration along the path.
        outputs: Where the deviation is wanted.
        slow_hz: Modes below do not follow a ramp but sway [Hz].
        up_to_hz: Modes kept; those above follow at once. None keeps all.
    """

    source: Port
    outputs: tuple[Port, ...]
    slow_hz: float
    up_to_hz: float | None = None


def sample_times(move: SetPoint, sampling_hz: float, settle: float) -> FloatArray:
    """Instants ``(n,)`` from the beginning of a move to so long after its end [s]."""
    return np.asarray(np.arange(int(np.ceil((move.duration + settle) * sampling_hz - SAME_INSTANT)) + 1) / sampling_hz, dtype=float)


def step_times(move: SetPoint, samples: FloatArray) -> tuple[FloatArray, NDArray[np.intp]]:
    """The samples and the breaks of a move together ``(m,)``, and which of them are samples ``(n,)``."""
    breaks = list_breaks(move)
    tolerance = SAME_INSTANT * float(samples[1] - samples[0])
    nearest = np.abs(samples[np.clip(np.searchsorted(samples, breaks), 1, len(samples) - 1) - np.array([[0], [1]])] - breaks).min(
        axis=0
    )
    times = np.sort(np.concatenate([samples, breaks[(nearest > tolerance) & (breaks < samples[-1])]]))
    return times, np.searchsorted(times, samples)


def solve_path(system: SecondOrderSystem, model: PathModel, move: SetPoint, samples: FloatArray) -> PathDeviation:
    """Deviation of a system over a move; no error but that of the model, whatever the sampling.

    Args:
        system: Symmetric, with the source among its inputs.
        model: What is asked.
        move: Along the path.
        samples: ``(n,)`` evenly spaced, from zero [s].

    Raises:
        ModelError: A port is unknown, or a damper acts on a dof without mass.
    """
    coordinates = to_modal_coordinates(equivalent_viscous(system), [model.source], model.outputs)
    if coordinates is None:
        raise ModelError("a damper acts on a dof without mass, or a matrix is not symmetric; give every body a mass")
    if model.up_to_hz is not None:
        coordinates = keep_modes(coordinates, count_modes(coordinates, model.up_to_hz))
    times, places = step_times(move, samples)
    loads = step_accelerations(move, times)[:, :, None]
    space = modal_state_space(coordinates, (model.source,), model.outputs)
    slow = np.repeat(coordinates.omega < 2.0 * np.pi * model.slow_hz, 2)
    rows = np.vstack([space.c, np.where(slow, space.c, 0.0)])
    stretched = type(space)(space.a, space.b, rows, np.zeros((len(rows), 1)), (), (), space.states, space.pairs)
    moved = solve_stepped_response(stretched, times, loads).outputs[places]
    now = sample_move(move, samples).accelerations[:, None]
    count = len(model.outputs)
    at_once = now * space.d[:, 0]
    sway, follows = moved[:, count:], now * static_share(coordinates, model.slow_hz)
    total = moved[:, :count] + at_once
    return PathDeviation(samples, total, follows, sway, total - follows - sway)


def static_share(coordinates: ModalCoordinates, slow_hz: float) -> FloatArray:
    """Deviation per unit acceleration ``(n_outputs,)`` if all but the slow modes follow at once [m/(m/s^2)]."""
    fast = coordinates.omega >= 2.0 * np.pi * slow_hz
    share = (coordinates.outputs[:, fast] / coordinates.squares[fast]) @ coordinates.inputs[fast, 0]
    return np.asarray(share if coordinates.complete else share + coordinates.residual[:, 0])


def slow_modes(frequencies_hz: Sequence[float] | FloatArray, slow_hz: float) -> int:
    """How many modes sway."""
    return int(np.count_nonzero(np.asarray(frequencies_hz) < slow_hz))
