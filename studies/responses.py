"""Frequency responses of variants of a machine over each other: on common lines, with their peaks,
and how far each is from that of a reference.
"""

from collections.abc import Mapping
from typing import TypedDict

import numpy as np
import scipy  # whose search of peaks, half a second, is loaded where it is used

from headstock.geometry.frames import FloatArray
from headstock.pipeline.answers.frf import PoseResponse, ResponseCurves
from headstock.pipeline.answers.probes import input_unit
from headstock.pipeline.numbers.estimates import Estimate
from headstock.pipeline.stages.frf import peaks_have_tops
from headstock.solvers.linear.frequency_response import FrfModel, evaluate_frf, find_peaks
from headstock.solvers.second_order import Channel, ComplexArray, is_rotation
from headstock.studies.variants import VariantSolution

HOLDS = 0.1  # share of the reference's value up to which another model is said to hold it
PROMINENCE = 1.1  # times the higher of the valleys beside it: less is no peak
# of the drive points' responses: what symmetry makes zero is left with this of an uneven mesh
NEGLIGIBLE = 1e-3
UNBOUNDED = (
    "a mode in the range has no damping, so its peak is unbounded; write [effects] "
    "damping = { modal = 0.02 }, or give joints or materials damping"
)


class _PeakSummary(TypedDict):
    """A maximum of the size of a response: where [Hz], and its size [m/N, rad/N, ...]."""

    frequency_hz: float
    size: float


class _DifferenceSummary(TypedDict):
    """How far a response is from that of a reference.

    Attributes:
        size: Largest size of the difference of any line [m/N, ...].
        at_hz: Frequency of that line [Hz].
        share_of_peak: That size over the largest response of the reference in the band.
        agrees_to_hz: Frequency up to which no line differs by more than ``HOLDS`` of the
            reference's own size [Hz]; None where the first one does.
    """

    size: float
    at_hz: float
    share_of_peak: float
    agrees_to_hz: float | None


class EntrySummary(TypedDict):
    """Numbers of one entry of a response, in SI.

    Attributes:
        output: Point and direction of the motion.
        input: Point and direction of the load.
        peak: Largest dynamic compliance in the band; None where a peak has no top.
        peak_hz: Its frequency [Hz].
        peak_mode: Name of the natural mode nearest to it; empty where output and load differ.
        most_negative_real: Most negative real part; None where output and load differ, or where there is
            none.
        most_negative_real_hz: Its frequency [Hz].
        most_negative_real_error: How far it may be off; None without a bound.
        peaks: The maxima, rising in frequency.
        difference: From the reference; None of the reference itself and of other ports.
        negligible: Output and load differ, and the response is less than ``NEGLIGIBLE`` of those
            of the two drive points.
        reason: Why there are no such numbers, in plain words.
    """

    output: list[str]
    input: list[str]
    peak: float | None
    peak_hz: float | None
    peak_mode: str
    most_negative_real: float | None
    most_negative_real_hz: float | None
    most_negative_real_error: float | None
    peaks: list[_PeakSummary]
    difference: _DifferenceSummary | None
    negligible: bool
    reason: str


def overlay_responses(
    solutions: Mapping[str, VariantSolution], reference: str
) -> dict[str, ResponseCurves]:
    """Response of each variant on the lines of all of them in the band of the reference.

    Args:
        reference: Its ports and its band count; empty where it has no response.
    """
    first = solutions[reference].response
    if first is None:
        return {}
    inputs, outputs = first.curves.inputs, first.curves.outputs
    alike: dict[str, tuple[PoseResponse, FrfModel]] = {
        name: (solution.response, solution.frf)
        for name, solution in solutions.items()
        if solution.response is not None
        and solution.frf is not None
        and (solution.response.curves.inputs, solution.response.curves.outputs) == (inputs, outputs)
    }
    band = first.curves.frequencies_hz
    lines = np.unique(
        np.concatenate([response.curves.frequencies_hz for response, _ in alike.values()])
    )
    lines = lines[(lines >= band[0]) & (lines <= band[-1])]
    return {
        name: ResponseCurves(
            pose=response.curves.pose,
            inputs=inputs,
            outputs=outputs,
            frequencies_hz=lines,
            receptance=evaluate_frf(model, lines).receptance,
            motion=first.curves.motion,
            spacing=first.curves.spacing,
        )
        for name, (response, model) in alike.items()
    }


def compare_entries(
    solution: VariantSolution, lines: Mapping[str, ResponseCurves], reference: str
) -> list[EntrySummary]:
    """Return the numbers of each entry of a variant's response.

    Args:
        lines: Of ``overlay_responses``.
        reference: Variant that the others are compared with.
    """
    response, model, name = solution.response, solution.frf, solution.choice.name
    if response is None or model is None:
        return []
    curves, entries = response.curves, list[EntrySummary]()
    to_hz = float(curves.frequencies_hz[-1])
    bounded = peaks_have_tops(find_peaks(model, to_hz), to_hz)
    mine, other = lines.get(name), lines.get(reference)
    for row, output in enumerate(curves.outputs):
        for column, given in enumerate(curves.inputs):
            if not bounded:
                entries.append(_start_entry(output, given, UNBOUNDED))
                continue
            difference = None
            if mine is not None and other is not None and name != reference:
                difference = _differ(
                    mine.frequencies_hz,
                    mine.receptance[:, row, column],
                    other.receptance[:, row, column],
                )
            entries.append(_describe_entry(response, row, column, difference))
    return entries


def _start_entry(output: Channel, given: Channel, reason: str = "") -> EntrySummary:
    """Return an entry without numbers."""
    return {
        "output": list(output),
        "input": list(given),
        "peak": None,
        "peak_hz": None,
        "peak_mode": "",
        "most_negative_real": None,
        "most_negative_real_hz": None,
        "most_negative_real_error": None,
        "peaks": [],
        "difference": None,
        "negligible": False,
        "reason": reason,
    }


def _describe_entry(
    response: PoseResponse, row: int, column: int, difference: _DifferenceSummary | None
) -> EntrySummary:
    curves = response.curves
    output, given = curves.outputs[row], curves.inputs[column]
    sizes = np.abs(curves.receptance[:, row, column])
    peaks = _list_peaks(curves.frequencies_hz, sizes)
    every = np.abs(curves.receptance)
    tops = np.where(np.isfinite(every), every, 0.0).max(axis=0)
    negligible = output != given and bool(
        tops[row, column] < NEGLIGIBLE * _usual_size(curves, tops, output, given)
    )
    figures = next(
        (figure for figure in response.figures if figure.channel == output == given), None
    )
    entry = _start_entry(output, given)
    if figures is not None and figures.minimum_dynamic_stiffness:
        error = response.errors.get(response.figure_key(figures.channel), Estimate()).total
        entry["peak"] = 1.0 / figures.minimum_dynamic_stiffness
        entry["peak_hz"] = figures.minimum_dynamic_stiffness_hz
        entry["peak_mode"] = figures.minimum_dynamic_stiffness_mode
        entry["most_negative_real"] = figures.most_negative_real
        entry["most_negative_real_hz"] = figures.most_negative_real_hz
        entry["most_negative_real_error"] = error
    elif np.isfinite(sizes).any():
        worst = int(np.nanargmax(sizes))
        entry["peak"] = float(sizes[worst])
        entry["peak_hz"] = float(curves.frequencies_hz[worst])
        entry["negligible"] = negligible
    else:
        return _start_entry(output, given, "nothing moves there, or nothing holds it")
    entry["peaks"], entry["difference"] = peaks, difference
    return entry


def _usual_size(curves: ResponseCurves, tops: FloatArray, output: Channel, given: Channel) -> float:
    """Size that an entry would have if both ports moved together: the geometric mean of those of
    the two drive points; without one, the largest of entries in the same unit.
    """
    drive_points = [
        float(tops[curves.outputs.index(channel), curves.inputs.index(channel)])
        for channel in (output, given)
        if channel in curves.outputs and channel in curves.inputs
    ]
    if len(drive_points) == 2:
        return float(np.sqrt(drive_points[0] * drive_points[1]))
    turns = (is_rotation(output), input_unit(given))
    alike = [
        float(tops[row, column])
        for row, one in enumerate(curves.outputs)
        for column, other in enumerate(curves.inputs)
        if (is_rotation(one), input_unit(other)) == turns
    ]
    return max(alike)


def _list_peaks(frequencies_hz: FloatArray, sizes: FloatArray) -> list[_PeakSummary]:
    positive = np.isfinite(sizes) & (sizes > 0.0)
    lines, logs = frequencies_hz[positive], np.log(sizes[positive])
    places, _ = scipy.signal.find_peaks(logs, prominence=np.log(PROMINENCE))
    return [
        {"frequency_hz": float(lines[index]), "size": float(np.exp(logs[index]))}
        for index in places
    ]


def _differ(
    frequencies_hz: FloatArray, mine: ComplexArray, other: ComplexArray
) -> _DifferenceSummary | None:
    determined = np.isfinite(mine) & np.isfinite(other)
    if not determined.any() or not np.abs(other[determined]).any():
        return None
    lines = frequencies_hz[determined]
    away = np.abs(mine - other)[determined]
    sizes = np.abs(other[determined])
    most, beyond = int(np.argmax(away)), np.flatnonzero(away > HOLDS * sizes)
    if not len(beyond):
        holds_to: float | None = float(lines[-1])
    else:
        holds_to = None if beyond[0] == 0 else float(lines[beyond[0] - 1])
    return {
        "size": float(away[most]),
        "at_hz": float(lines[most]),
        "share_of_peak": float(away[most] / sizes.max()),
        "agrees_to_hz": holds_to,
    }
