"""Frequency responses of a file of test data as targets: which sensors they belong to, and few enough
lines.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from headstock.geometry.frames import DIRECTIONS, FloatArray, find_axis
from headstock.reduction.coupling.slopes import ObservedDof
from headstock.scene.reading.files import resolve_file
from headstock.scene.test_data.reading import PARSERS, read_test_data
from headstock.scene.test_data.records import MeasuredResponses, TestChannel
from headstock.solvers.modal_fitting.noise import LEAST_NOISE, noise_from_neighbours
from headstock.studies.identification.targets import ResponseTarget, ResponseTargetTable

NOISE_LINES = 8  # fewer do not show how they scatter
SAME_LINE = 1e-4  # of the cosine between a measured direction and an axis


def read_pairs(entry: ResponseTargetTable, folder: Path) -> Iterator[ResponseTarget]:
    """Yield the response that an entry gives itself, or every measured pair of its file, without name and
    tolerance.

    Args:
        folder: Where its file lies, or below.

    Raises:
        ValueError: There is no such file, it has no responses in the band, a direction lies along no
            axis, or noise is wanted of too few lines.
        MeasurementError: The file cannot be read.
    """
    if entry.file is not None:
        yield from _read_file(entry, entry.file, folder)
    elif entry.point and entry.motion and entry.force and entry.lines:
        hz, real, imaginary = zip(*entry.lines, strict=True)
        yield ResponseTarget(
            "",
            ObservedDof(entry.point, DIRECTIONS.index(entry.motion)),
            ObservedDof(entry.force_at or entry.point, DIRECTIONS.index(entry.force)),
            hz,
            tuple(map(complex, real, imaginary)),
            sigma=1.0,
        )


def _read_file(entry: ResponseTargetTable, file: str, folder: Path) -> Iterator[ResponseTarget]:
    responses = read_test_data(resolve_file(folder, file, tuple(PARSERS))).responses
    if responses is None:
        raise ValueError(f"{file} has no frequency responses")
    hz, (low, high) = responses.frequencies_hz, entry.band or (0.0, np.inf)
    inside = np.flatnonzero((hz > 0.0) & (hz >= low) & (hz <= high))
    if not len(inside):
        raise ValueError(f"{file} has no line between {low:g} and {high:g} Hz")
    count = min(entry.count, len(inside))
    chosen = np.unique(inside[np.linspace(0, len(inside) - 1, count).astype(int)])
    deviations = _find_noise(file, responses) if entry.noise else None
    for row, column in np.ndindex(responses.values.shape[1:]):
        known = chosen[np.nan_to_num(responses.values[chosen, row, column]) != 0.0]
        if len(known):
            (end, sign), (start, other) = (
                _find_sensor(channel, entry.sensors)
                for channel in (responses.motions[row], responses.forces[column])
            )
            yield ResponseTarget(
                "",
                end,
                start,
                tuple(hz[known].tolist()),
                tuple((sign * other * responses.values[known, row, column]).tolist()),
                sigma=1.0,
                deviations=()
                if deviations is None
                else tuple(deviations[known, row, column].tolist()),
            )


def _find_noise(file: str, responses: MeasuredResponses) -> FloatArray:
    """Return standard deviations ``(l, m, f)`` of real and imaginary parts [m/N].

    Raises:
        ValueError: There are too few lines to see how they scatter.
    """
    if responses.deviations is not None:
        squares = responses.deviations**2
    elif len(responses.frequencies_hz) < NOISE_LINES:
        text = f"{file} has {len(responses.frequencies_hz)} lines, and noise shows in {NOISE_LINES}"
        raise ValueError(f"{text}; write a tolerance in place of noise")
    else:
        level = noise_from_neighbours(responses.values)
        # of the two neighbours: a weight that knew the error of its line would bias the fit
        around = np.concatenate([level[1:2], level, level[-2:-1]])
        squares = 0.5 * (around[:-2] + around[2:])
    least = LEAST_NOISE**2 * np.mean(np.abs(np.nan_to_num(responses.values)) ** 2, axis=0)
    return np.asarray(np.sqrt(0.5 * (squares + least)))


def _find_sensor(channel: TestChannel, sensors: str) -> tuple[ObservedDof, float]:
    """Return the sensor and dof of a channel, and the sign of its direction."""
    axis = find_axis(channel.direction, SAME_LINE)
    if axis is None:
        raise ValueError(
            f"point {channel.point} was measured along {channel.direction}, which is no axis of its sensor"
        )
    name = f"{sensors}.{channel.point}" if sensors else channel.point
    return ObservedDof(name, DIRECTIONS.index(axis[0])), axis[1]
