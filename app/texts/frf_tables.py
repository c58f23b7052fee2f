"""Frequency responses as plain rows, and the units in which they are shown."""

import math
from collections.abc import Mapping

import numpy as np

from headstock.app.texts.tables import PlainTable
from headstock.geometry.frames import FloatArray
from headstock.pipeline.results.frf import ResponseCurves
from headstock.pipeline.results.mode_files import file_stem
from headstock.solvers.second_order import ComplexArray, Motion, Port
from headstock.solvers.system_ports import name_port

MOST_FIELDS = 6  # rows and columns of a grid beyond this cannot be read
DECADES_SHOWN = 5.0
LEAST_TICKS = 3
RATES: dict[Motion, str] = {"receptance": "", "mobility": "/s", "accelerance": "/s²"}


def response_unit(motion: Motion, output: Port, given: Port) -> tuple[str, float]:
    """Unit in which an entry is shown, and the factor from SI to it; compliances in µm/kN, as everywhere but in files in SI."""
    turns, moment = output[1].startswith("r"), given[1].startswith("r")
    if motion == "receptance" and not turns and not moment:
        return "µm/kN", 1e9
    return f"{'rad' if turns else 'm'}{RATES[motion]} per {'N m' if moment else 'N'}", 1.0


def name_entry(output: Port, given: Port) -> str:
    """``tcp x / tcp y``: motion over load."""
    return f"{name_port(output)} / {name_port(given)}"


def magnitude_range(size: FloatArray) -> tuple[float, float]:
    """Lowest and highest magnitude to draw: around the curve, at most five decades below its top."""
    known = size[np.isfinite(size) & (size > 0.0)]
    if not len(known):
        return 0.1, 1.0
    return float(max(known.min() / 1.5, known.max() / 10.0**DECADES_SHOWN)), float(2.0 * known.max())


def round_ticks(low: float, high: float) -> list[float]:
    """Round numbers on a logarithmic axis: decades; where they are few, also their doubles and fives, or every whole multiple."""
    powers = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    found: list[float] = []
    for factors in ((1,), (1, 2, 5), range(1, 10)):
        found = [factor * 10.0**power for power in powers for factor in factors if low <= factor * 10.0**power <= high]
        if len(found) >= LEAST_TICKS:
            break
    return found


def broken_phase(values: ComplexArray) -> FloatArray:
    """Phase [degrees], NaN where it jumps from -180 to 180: a line there would say something that is not so."""
    phase = np.degrees(np.angle(values))
    return np.where(np.abs(np.diff(phase, prepend=phase[:1])) > 180.0, np.nan, phase)


def overlaid_responses(responses: Mapping[str, ResponseCurves]) -> list[ResponseCurves]:
    """The responses of all poses, where there are several and they are of the same entries; else none."""
    found = [responses[pose] for pose in sorted(responses)]  # the order in which files hold them
    first = found[0] if found else None
    same = all((one.inputs, one.outputs, one.motion) == (first.inputs, first.outputs, first.motion) for one in found if first)
    return found if len(found) > 1 and same else []


def tabulate_response(curves: ResponseCurves) -> PlainTable:
    """A row per frequency: real and imaginary part of every entry in SI, its error and the part of each source; empty where there is none."""
    values, errors, shares = curves.values, curves.value_errors, curves.value_error_share
    headings, columns = ["frequency [Hz]"], [curves.frequencies_hz]
    for row, output in enumerate(curves.outputs):
        for column, given in enumerate(curves.inputs):
            unit = f"{'rad' if output[1].startswith('r') else 'm'}{RATES[curves.motion]} per {'N m' if given[1].startswith('r') else 'N'}"
            headings += [f"{part} {name_entry(output, given)} [{unit}]" for part in ("Re", "Im")]
            columns += [np.array(part, dtype=float) for part in (values[:, row, column].real, values[:, row, column].imag)]
            if errors is not None:
                headings.append(f"± {name_entry(output, given)} [{unit}]")
                columns.append(np.array(errors[:, row, column], dtype=float))
            for source, share in shares.items():
                headings.append(f"± {source} {name_entry(output, given)} [{unit}]")
                columns.append(np.array(share[:, row, column], dtype=float))
    cells = tuple(tuple(None if math.isnan(value) else float(value) for value in row) for row in np.column_stack(columns))
    return PlainTable(f"frf_{file_stem(curves.pose)}", tuple(headings), cells)
