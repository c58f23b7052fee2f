"""Peaks of a frequency response: which entries have one near which natural mode, how high, and the
same peaks of another model of the same machine.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import BoolArray, FloatArray
from headstock.solvers.linear.frequency_response import UNDAMPED, FrfModel, evaluate_frf
from headstock.solvers.linear.modal_coordinates import ModalCoordinates
from headstock.solvers.second_order import ComplexArray

# 10 dB below the tallest peak of an entry, and of an entry below those of its two drive points: what
# is lower hardly matters there, and next to a node of a mode its relative error has no limit
COUNTED = 10.0**-0.5
# half-power half-widths around a resonance in which its peak is sought
WINDOW = np.linspace(-2.0, 2.0, 17)
NEAR = 0.05  # half-widths: distance of the lines that locate a peak in the end
OVERDAMPED = 0.3  # damping ratio from which a resonance is no peak
APART = 0.5  # half-widths: maxima that are nearer are one peak
RESTING_SHARE = 0.5  # of the lowest resonance: below, a response is that of statics


@dataclass(frozen=True)
class ResponsePeak:
    """A peak of an entry of a response.

    Attributes:
        mode: Index of the natural mode nearest to it, rigid-body modes counted.
        hz: Where it is [Hz].
        height: Size of the receptance there [m/N, ...].
    """

    output: int
    given: int
    mode: int
    hz: float
    height: float


@dataclass(frozen=True)
class ResponseLevel:
    """The size of an entry of a response [m/N, ...] below all resonances, at rest as a rule."""

    output: int
    given: int
    hz: float
    height: float


def find_response_peaks(model: FrfModel, from_hz: float, to_hz: float) -> list[ResponsePeak]:
    """Find the peaks of every entry within a range of frequencies, that are tall enough to count.

    None of a system without modal coordinates, and of modes that have hardly any damping or so much
    that they have no peak.

    Args:
        from_hz: Lowest frequency [Hz].
        to_hz: Highest frequency [Hz].
    """
    coordinates = model.coordinates
    if coordinates is None:
        return []
    hz, ratios = _resonances(coordinates)
    sharp = (ratios > UNDAMPED) & (ratios < OVERDAMPED) & (hz >= from_hz) & (hz <= to_hz)
    modes = [int(mode) for mode in np.flatnonzero(sharp) if mode >= coordinates.rigid_count]
    if not modes:
        return []
    lines, sizes = _sample(model, hz[modes], ratios[modes])
    tops: list[_Top] = []
    for index, mode in enumerate(modes):
        width = ratios[mode] * hz[mode]
        for output, given in np.ndindex(sizes.shape[2:]):
            at, height, inside = _find_top(lines[index], sizes[index, :, output, given])
            same = any(
                (top.output, top.given) == (output, given) and abs(top.hz - at) < APART * width
                for top in tops
            )
            if inside and not same:
                tops.append(_Top(output, given, at, width, height, inside))
    tops = _sharpen(model, tops)
    tallest = np.zeros(sizes.shape[2:])
    for top in tops:
        tallest[top.output, top.given] = max(tallest[top.output, top.given], top.height)
    least = COUNTED * np.where(_matters(model, tallest), tallest, np.inf)
    return [
        ResponsePeak(
            top.output,
            top.given,
            modes[int(np.argmin(np.abs(hz[modes] - top.hz)))],
            top.hz,
            top.height,
        )
        for top in tops
        if top.height >= least[top.output, top.given]
    ]


def find_levels(model: FrfModel, from_hz: float) -> list[ResponseLevel]:
    """Find the size of every entry at the lowest frequency, where that lies well below all
    resonances and the entry is not small compared with the others; none of what is free at rest.

    Args:
        from_hz: Lowest frequency [Hz].
    """
    coordinates = model.coordinates
    if coordinates is None or coordinates.rigid_count == len(coordinates.eigenvalues):
        return []
    lowest = coordinates.omega[coordinates.rigid_count] / (2.0 * np.pi)
    if from_hz > RESTING_SHARE * lowest:
        return []
    sizes = np.nan_to_num(np.abs(evaluate_frf(model, np.array([from_hz])).receptance[0]))
    return [
        ResponseLevel(int(output), int(given), from_hz, float(sizes[output, given]))
        for output, given in np.argwhere(_matters(model, sizes))
    ]


def follow_peaks(
    model: FrfModel, peaks: Sequence[ResponsePeak], partners: Sequence[int], lines_hz: FloatArray
) -> list[ResponsePeak]:
    """Return the same peaks of another model of the machine; NaN for their height where a mode has
    no partner.

    Each is sought where it lies if it moves along with its mode.

    Args:
        partners: Index of the natural mode of the other model for each peak, -1 without one.
        lines_hz: Frequency of the natural mode of the first model for each peak [Hz].
    """
    coordinates = model.coordinates
    if coordinates is None or not peaks:
        return [ResponsePeak(peak.output, peak.given, -1, np.nan, np.nan) for peak in peaks]
    hz, ratios = _resonances(coordinates)
    paired = [number for number, partner in enumerate(partners) if partner >= 0]
    partner_modes = np.array([partners[number] for number in paired], dtype=int)
    places = (
        np.array([peaks[number].hz / lines_hz[number] for number in paired]) * hz[partner_modes]
    )
    # entries share their windows where their peaks lie at one place
    windows, shared = np.unique(
        np.column_stack([places, ratios[partner_modes]]), axis=0, return_inverse=True
    )
    followed = [ResponsePeak(peak.output, peak.given, -1, np.nan, np.nan) for peak in peaks]
    if not paired:
        return followed
    lines, sizes = _sample(model, windows[:, 0], windows[:, 1])
    tops = []
    for number, window in zip(paired, shared.ravel(), strict=True):
        peak, width = peaks[number], float(np.prod(windows[window]))
        top = _find_top(lines[window], sizes[window, :, peak.output, peak.given])
        tops.append(_Top(peak.output, peak.given, top[0], width, top[1], top[2]))
    for number, sharp in zip(paired, _sharpen(model, tops), strict=True):
        followed[number] = ResponsePeak(
            sharp.output, sharp.given, int(partners[number]), sharp.hz, sharp.height
        )
    return followed


def measure_levels(model: FrfModel, levels: Sequence[ResponseLevel]) -> FloatArray:
    """Return the sizes ``(n,)`` of another model at the same levels [m/N, ...]."""
    if not levels:
        return np.zeros(0)
    response: ComplexArray = evaluate_frf(model, np.array([levels[0].hz])).receptance[0]
    return np.array([abs(response[level.output, level.given]) for level in levels])


def _resonances(coordinates: ModalCoordinates) -> tuple[FloatArray, FloatArray]:
    """Return undamped frequencies ``(m,)`` [Hz], damping ratios ``(m,)``, uncoupled."""
    omega = coordinates.omega
    moving = np.where(omega > 0.0, omega, np.inf)
    ratios = np.zeros(len(omega))
    if coordinates.viscous is not None:
        ratios += np.diag(coordinates.viscous) / (2.0 * moving)
    if coordinates.hysteretic is not None:
        ratios += np.diag(coordinates.hysteretic) / (2.0 * moving**2)
    return np.asarray(omega / (2.0 * np.pi), dtype=np.float64), ratios


def _sample(model: FrfModel, hz: FloatArray, ratios: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return frequencies around resonances ``(n, w)``, sizes ``(n, w, n_outputs, n_inputs)``."""
    lines = hz[:, None] * (1.0 + ratios[:, None] * WINDOW)
    values = evaluate_frf(model, lines.ravel()).receptance
    return lines, np.abs(values).reshape(*lines.shape, *values.shape[1:])


@dataclass(frozen=True)
class _Top:
    """The largest size of an entry in a window, the half-power half-width there [Hz], and whether it is
    a peak.
    """

    output: int
    given: int
    hz: float
    width: float
    height: float
    inside: bool


def _find_top(lines: FloatArray, sizes: FloatArray) -> tuple[float, float, bool]:
    """Find the place and height of the largest size, and whether it is a peak within the window.

    Beside a resonance ``1 / |H|^2`` is a parabola, whose vertex lies between the lines.
    """
    top = int(np.argmax(sizes))
    if not 0 < top < len(sizes) - 1 or not sizes[top] > 0.0:
        return float(lines[top]), float(sizes[top]), False
    left, middle, right = (sizes[top] / sizes[top - 1 : top + 2]) ** 2
    curved, slope = left - 2.0 * middle + right, 0.5 * (right - left)
    offset = -slope / curved if curved > 0.0 else 0.0
    lowest = middle + 0.5 * slope * offset
    step = lines[top + 1] - lines[top]
    return float(lines[top] + offset * step), float(sizes[top] / np.sqrt(lowest)), True


def _sharpen(model: FrfModel, tops: Sequence[_Top]) -> list[_Top]:
    """Return the same with peaks resolved by nearer lines; what is no peak stays."""
    if not tops:
        return []
    places, widths = np.array([(top.hz, top.width) for top in tops]).T
    lines = places[:, None] + NEAR * widths[:, None] * np.array([-1.0, 0.0, 1.0])
    values = np.abs(model.form.evaluate(2.0 * np.pi * lines.ravel()))
    values = values.reshape(*lines.shape, *values.shape[1:])
    sharp = []
    for number, top in enumerate(tops):
        if top.inside:
            at, height, inside = _find_top(lines[number], values[number, :, top.output, top.given])
            top = dataclasses.replace(top, hz=at, height=height) if inside else top
        sharp.append(top)
    return sharp


def _matters(model: FrfModel, sizes: FloatArray) -> BoolArray:
    """Return whether entries ``(n_outputs, n_inputs)`` are not small compared with those of their
    drive points; where one of these was not asked for, with the largest of their row and column.
    """
    rows, columns = sizes.max(axis=1), sizes.max(axis=0)
    for row, channel in enumerate(model.outputs):
        if channel in model.inputs:
            column = model.inputs.index(channel)
            rows[row] = columns[column] = sizes[row, column]
    return (sizes > 0.0) & (sizes >= COUNTED * np.sqrt(np.outer(rows, columns)))
