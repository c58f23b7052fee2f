"""How curves are drawn, in the report and as figures: units, ranges, ticks, and as many points as
can be seen.
"""

import itertools
import math
from collections.abc import Iterable

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.pipeline.answers.frf import ResponseCurves
from headstock.pipeline.answers.probes import input_unit
from headstock.solvers.second_order import (
    Channel,
    ComplexArray,
    Motion,
    is_rotation,
    name_channel,
)

MOST_FIELDS = 6  # rows and columns of a grid beyond this cannot be read
DECADES_SHOWN = 5.0
LEAST_TICKS = 3
RATES: dict[Motion, str] = {"receptance": "", "mobility": "/s", "accelerance": "/s²"}


def response_unit(motion: Motion, output: Channel, given: Channel) -> tuple[str, float]:
    """Unit in which an entry is shown, and the factor from SI to it; compliances in µm/kN, as
    everywhere but in files in SI.

    Args:
        motion: Which member of the family of frequency responses.
        output: Point and direction of the motion.
        given: Point and direction of the load.
    """
    if motion == "receptance" and not is_rotation(output):
        shown = {"": ("µm", 1e6), "N": ("µm/kN", 1e9)}.get(input_unit(given))
        if shown is not None:
            return shown
    return response_unit_si(motion, output, given), 1.0


def response_unit_si(motion: Motion, output: Channel, given: Channel) -> str:
    """Unit of an entry in SI; that of a load is the motion that the whole load makes."""
    moved, per = f"{'rad' if is_rotation(output) else 'm'}{RATES[motion]}", input_unit(given)
    return f"{moved} per {per}" if per else moved


def name_entry(output: Channel, given: Channel) -> str:
    """``tcp x / tcp y``: motion over load."""
    return f"{name_channel(output)} / {name_channel(given)}"


def magnitude_range(size: FloatArray) -> tuple[float, float]:
    """Lowest and highest magnitude to draw: around the curve, at most five decades below its
    top.
    """
    known = size[np.isfinite(size) & (size > 0.0)]
    if not len(known):
        return 0.1, 1.0
    return float(max(known.min() / 1.5, known.max() / 10.0**DECADES_SHOWN)), float(
        2.0 * known.max()
    )


def round_ticks(low: float, high: float) -> list[float]:
    """Round numbers on a logarithmic axis: decades; where they are few, also their doubles and
    fives, or every whole multiple.
    """
    powers = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    found: list[float] = []
    for factors in ((1,), (1, 2, 5), range(1, 10)):
        found = [
            factor * 10.0**power
            for power in powers
            for factor in factors
            if low <= factor * 10.0**power <= high
        ]
        if len(found) >= LEAST_TICKS:
            break
    return found


def even_ticks(low: float, high: float, count: int) -> list[float]:
    """Round numbers on a linear axis, about so many: multiples of 1, 2 or 5.

    Args:
        low: Where the axis begins.
        count: How many steps there may be.
    """
    rough = (high - low) / count
    unit = 10.0 ** math.floor(math.log10(rough))
    step = next(factor * unit for factor in (1.0, 2.0, 5.0, 10.0) if factor * unit >= rough)
    return [
        step * number
        for number in range(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1)
    ]


def broken_phase(values: ComplexArray) -> FloatArray:
    """Phase [degrees], NaN where it jumps from -180 to 180: a line there would say something that
    is not so.
    """
    phase = np.degrees(np.angle(values))
    return np.where(np.abs(np.diff(phase, prepend=phase[:1])) > 180.0, np.nan, phase)


def overlaid_responses(responses: Iterable[ResponseCurves]) -> list[ResponseCurves]:
    """The responses of all poses, where there are several and they are of the same entries; else
    none.
    """
    found = sorted(responses, key=lambda one: one.pose)  # the order in which files hold them
    same = len({(one.inputs, one.outputs, one.motion) for one in found}) == 1
    return found if len(found) > 1 and same else []


def thin_curve(x: FloatArray, y: FloatArray, bins: int) -> tuple[FloatArray, FloatArray]:
    """Lowest and highest point of each of so many stretches, in order: what a plot of that width
    shows of a curve.

    Args:
        x: From left to right ``(n,)``.
        y: Over it ``(n,)``.
        bins: Stretches, about one per pixel.
    """
    if len(x) <= 2 * bins:
        return x, y
    edges = np.linspace(0, len(x), bins + 1).astype(int)
    kept: list[int] = [0]
    for begin, end in itertools.pairwise(edges):
        kept += sorted({begin + int(np.argmin(y[begin:end])), begin + int(np.argmax(y[begin:end]))})
    kept.append(len(x) - 1)
    places = np.unique(kept)
    return x[places], y[places]
