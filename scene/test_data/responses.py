"""Frequency responses of single pairs of channels, joined into one array of receptances."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray, find_axis
from headstock.scene.test_data.errors import MeasurementError
from headstock.scene.test_data.records import ComplexArray, MeasuredResponses, TestChannel
from headstock.solvers.modal_fitting.noise import noise_from_neighbours

MOST_VALUES = 50_000_000
SAME_LINE = 1e-5  # of a frequency: what six digits of an increment leave open
LEAST_COHERENCE = 1e-6
LEAST_NOISE = 1e-9  # noise over signal that rounding makes
LEAST_LINES = 8  # fewer do not show how they scatter
KINDS = ("displacement", "velocity", "acceleration")
# units of motions: how often differentiated, and what one is in SI
_MOTIONS = {
    "m": (0, 1.0), "mm": (0, 1e-3), "um": (0, 1e-6), "m/s": (1, 1.0), "mm/s": (1, 1e-3), "m/s2": (2, 1.0), "mm/s2": (2, 1e-3),
    "g": (2, 9.80665),
}  # fmt: skip
_FORCES = {"N": 1.0, "kN": 1e3, "lbf": 4.4482216152605}
_SIMPLER = str.maketrans({"²": "2", "µ": "u", "μ": "u"} | dict.fromkeys("^*()[] "))


def read_motion(unit: str) -> tuple[int, float] | None:
    """Return how often a motion in a unit such as ``m/s^2`` is differentiated, and what one is in SI;
    None where the unit is not known.
    """
    return _MOTIONS.get(unit.translate(_SIMPLER))


def read_force(unit: str) -> float | None:
    """Return what one of a unit of force is in newtons; None where the unit is not known."""
    return _FORCES.get(unit.translate(_SIMPLER))


@dataclass(frozen=True, eq=False)
class Response:
    """A frequency response as a file has it.

    Attributes:
        where: File, line and what it is, for messages.
        frequencies_hz: ``(l,)``.
        values: ``(l,)`` motion over force, SI.
        order: 0 displacement, 1 velocity, 2 acceleration.
        coherence: ``(l,)`` of motion and force, 0 to 1; None where the file has none.
    """

    where: str
    motion: TestChannel
    force: TestChannel
    frequencies_hz: FloatArray
    values: ComplexArray
    order: int = 0
    coherence: FloatArray | None = None


def join_responses(
    responses: Sequence[Response],
) -> tuple[MeasuredResponses | None, tuple[str, ...]]:
    """Join responses over one axis of frequencies, as displacement over force.

    Returns:
        None without responses, and what was assumed.

    Raises:
        MeasurementError: Frequencies fall or differ, a value is not finite, or there are too many
            pairs; says where.
    """
    if not responses:
        return None, ()
    frequencies = np.asarray(responses[0].frequencies_hz, dtype=float)
    motions = tuple(dict.fromkeys(response.motion for response in responses))
    forces = tuple(dict.fromkeys(response.force for response in responses))
    if len(frequencies) * len(motions) * len(forces) > MOST_VALUES:
        raise MeasurementError(
            f"{responses[0].where}: {len(motions)} responses by {len(forces)} references by {len(frequencies)} frequencies are more than"
            f" {MOST_VALUES} numbers; export fewer"
        )
    orders: defaultdict[int, int] = defaultdict(int)
    repeated = []
    values = np.full((len(frequencies), len(motions), len(forces)), np.nan + 0j)
    filled = np.zeros(values.shape[1:], dtype=bool)
    # without the line at 0 Hz, at which velocity and acceleration say nothing of displacement
    first = int(frequencies[0] == 0.0 and any(response.order for response in responses))
    divisor = 2j * np.pi * frequencies
    divisor[:first] = 1.0
    for response in responses:
        _check(response, responses[0], frequencies)
        place = motions.index(response.motion), forces.index(response.force)
        if filled[place]:
            pair = response.motion, response.force
            repeated.append("/".join(map(label_channel, pair)))
            continue
        filled[place] = True
        orders[response.order] += 1
        values[:, *place] = response.values / divisor**response.order
    remarks = [
        f"{count} frequency responses are {KINDS[order]} over force"
        + (f", divided by (i omega){'^2' * (order - 1)}" if order else "")
        for order, count in sorted(orders.items())
    ]
    if first:
        remarks.append("the line at 0 Hz is left out: it says nothing of displacement")
    if repeated:
        remarks.append(
            f"{len(repeated)} frequency responses repeat a pair of channels and are left out: {', '.join(repeated[:5])}"
        )
    deviations, remark = _find_deviations(responses, motions, forces, values)
    remarks += [remark] if remark else []
    used = None if deviations is None else deviations[first:]
    joined = MeasuredResponses(frequencies[first:], motions, forces, values[first:], used)
    return joined, tuple(remarks)


def _find_deviations(
    responses: Sequence[Response],
    motions: Sequence[TestChannel],
    forces: Sequence[TestChannel],
    values: ComplexArray,
) -> tuple[FloatArray | None, str]:
    """Return standard deviations ``(l, m, f)`` of values by coherence, and how they were found; None
    where it says nothing.

    Coherence says where noise is. How many measurements were averaged is in no set, and is taken from
    how neighbouring lines scatter.

    Source: Bendat and Piersol (2010), random errors of frequency responses.
    """
    known = [response.coherence for response in responses if response.coherence is not None]
    if not known:
        return None, ""
    if len(known) < len(responses):
        return (
            None,
            f"{len(responses) - len(known)} frequency responses have no coherence: not used",
        )
    shares = np.full(values.shape, np.nan)
    for response in reversed(responses):
        place = motions.index(response.motion), forces.index(response.force)
        coherence = np.clip(np.asarray(response.coherence, dtype=float), LEAST_COHERENCE, 1.0)
        shares[:, *place] = 1.0 / coherence - 1.0
    single = shares * np.abs(values) ** 2
    noisy = shares > LEAST_NOISE
    if len(values) < LEAST_LINES or not noisy.any():
        return (
            None,
            "coherence is one throughout, as of one measurement, or has few lines: not used",
        )
    averages = max(1.0, float(np.median((single / noise_from_neighbours(values))[noisy])))
    text = (
        f"± of responses from coherence; lines scatter as {averages:.3g} averages would make them"
    )
    return np.asarray(np.sqrt(single / averages)), text


def _check(response: Response, reference: Response, frequencies: FloatArray) -> None:
    lines = np.asarray(response.frequencies_hz, dtype=float)
    if not (np.isfinite(lines).all() and np.isfinite(response.values).all()):
        raise MeasurementError(
            f"{response.where}: holds a value that is not finite; export it again"
        )
    if len(lines) < 2:
        raise MeasurementError(
            f"{response.where}: has {len(lines)} frequencies; at least two are needed"
        )
    if lines[0] < 0.0 or not (np.diff(lines) > 0.0).all():
        raise MeasurementError(
            f"{response.where}: frequencies must rise from 0 Hz or more; sort them"
        )
    spread = SAME_LINE * np.abs(frequencies).max()
    if len(lines) != len(frequencies) or np.abs(lines - frequencies).max() > spread:
        raise MeasurementError(
            f"{response.where}: its frequencies ({len(lines)} from {lines[0]:g} to {lines[-1]:g} Hz) are not those of {reference.where}"
            f" ({len(frequencies)} from {frequencies[0]:g} to {frequencies[-1]:g} Hz); write them into another file"
        )


def label_channel(channel: TestChannel) -> str:
    """Return ``12:+x`` for a channel along an axis, ``12:(0.6,0,0.8)`` for others."""
    if (axis := find_axis(channel.direction)) is not None:
        return f"{channel.point}:{'+' if axis[1] > 0 else '-'}{axis[0]}"
    return f"{channel.point}:({','.join(f'{part:.4g}' for part in channel.direction)})"
