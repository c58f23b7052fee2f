"""Frequency responses of a file of test data as targets: which sensors they belong to, and few enough
lines.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from headstock.geometry.frames import DIRECTIONS, FloatArray, find_axis
from headstock.reduction.coupling.slopes import ObservedDof
from headstock.scene.reading.files import resolve_file
from headstock.scene.test_data.reading import PARSERS, read_test_data
from headstock.scene.test_data.records import MeasuredResponses, TestChannel
from headstock.solvers.modal_fitting.noise import LEAST_NOISE, noise_from_neighbours

NOISE_LINES = 8  # fewer do not show how they scatter
SAME_LINE = 1e-4  # of the cosine between a measured direction and an axis


@dataclass(frozen=True)
class MeasuredPair:
    """A frequency response between two sensors: displacement over force [m/N] at lines [Hz].

    Attributes:
        deviations: Standard deviations of the real and imaginary parts [m/N]; empty where unknown.
    """

    motion: ObservedDof
    force: ObservedDof
    frequencies_hz: tuple[float, ...]
    values: tuple[complex, ...]
    deviations: tuple[float, ...] = ()


def read_pairs(
    folder: Path, file: str, *, sensors: str, band: tuple[float, float], count: int, noise: bool
) -> list[MeasuredPair]:
    """Read every measured pair of channels of a file.

    Args:
        folder: Where the file lies, or below.
        sensors: Table of sensors that are called by the names of measured points; empty where sensors
            themselves have these names.
        band: Lowest and highest frequency [Hz].
        count: Keep at most so many lines, evenly chosen.
        noise: With deviations of the lines.

    Raises:
        ValueError: There is no such file, it has no responses in the band, a direction lies along no
            axis, or noise is wanted of too few lines.
        MeasurementError: The file cannot be read.
    """
    responses = read_test_data(resolve_file(folder, file, tuple(PARSERS))).responses
    if responses is None:
        raise ValueError(f"{file} has no frequency responses")
    hz = responses.frequencies_hz
    inside = np.flatnonzero((hz > 0.0) & (hz >= band[0]) & (hz <= band[1]))
    if not len(inside):
        raise ValueError(f"{file} has no line between {band[0]:g} and {band[1]:g} Hz")
    chosen = np.unique(inside[np.linspace(0, len(inside) - 1, min(count, len(inside))).astype(int)])
    deviations = _find_noise(file, responses) if noise else None
    pairs = []
    for row, motion in enumerate(responses.motions):
        for column, force in enumerate(responses.forces):
            values = responses.values[chosen, row, column]
            known = np.isfinite(values) & (values != 0.0)
            if known.any():
                (end, sign), (start, other) = (
                    _find_sensor(channel, sensors) for channel in (motion, force)
                )
                pairs.append(
                    MeasuredPair(
                        end,
                        start,
                        tuple(hz[chosen][known].tolist()),
                        tuple((sign * other * values[known]).tolist()),
                        ()
                        if deviations is None
                        else tuple(deviations[chosen, row, column][known].tolist()),
                    )
                )
    return pairs


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
        squares = noise_from_neighbours(responses.values)
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
