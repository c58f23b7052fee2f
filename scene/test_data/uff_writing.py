"""Universal files (UFF) of points, modes and frequency responses, in SI; binary where that keeps digits."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from headstock.geometry.errors import printable
from headstock.geometry.frames import DIRECTIONS, FloatArray, find_axis
from headstock.scene.test_data.records import (
    ComplexArray,
    MeasuredModes,
    MeasuredResponses,
    TestChannel,
    TestData,
)
from headstock.scene.test_data.responses import label_channel

MOTION, FORCE, HEADER_LINES = 8, 13, 11
FREQUENCY_RESPONSE, FREQUENCY = 4, 18
NORMAL, COMPLEX = 2, 3


def encode_uff(data: TestData, title: str) -> bytes:
    """A universal file: sets 151, 164 (SI), 2411, 82, then 55 per mode and 58b per pair of channels.

    Points whose names are no numbers get numbers of their own, and the title of each set names them.

    Args:
        data: Responses along x, y or z of the test.
        title: What it is of, in the first line of every set.

    Raises:
        ValueError: A channel of a response lies between axes.
    """
    channels = [*(data.modes.channels if data.modes else ())]
    if data.responses is not None:
        channels += [*data.responses.motions, *data.responses.forces]
    numbers = _number_points([*data.points, *(channel.point for channel in channels)])
    sets = [
        _text_set(151, [title, *["NONE"] * 2, "", "", "Headstock", ""]),
        _text_set(
            164, [f"{1:10}{'SI: Meter (newton)':<20}{2:10}", _long(1.0, 1.0, 1.0), _long(0.0)]
        ),
    ]
    if data.points:
        rows = (
            line
            for name, point in data.points.items()
            for line in (f"{numbers[name]:10}{0:10}{0:10}{11:10}", _long(*point.position))
        )
        sets.append(_text_set(2411, rows))
    for index, line in enumerate(data.lines, 1):
        nodes = [f"{numbers[name]:10}" for name in line]
        rows82 = ("".join(nodes[start : start + 8]) for start in range(0, len(nodes), 8))
        sets.append(_text_set(82, [f"{index:10}{len(nodes):10}{0:10}", "NONE", *rows82]))
    if data.modes is not None:
        sets += _mode_sets(data.modes, numbers, title)
    if data.responses is not None:
        sets += _response_sets(data.responses, numbers, title)
    return b"".join(sets)


def _number_points(names: Sequence[str]) -> dict[str, int]:
    """Numbers of points: a name that is one keeps it, others get those that are free."""
    names = list(dict.fromkeys(names))
    numbers = {name: int(name) for name in names if name.isdecimal() and 0 < int(name) < 10**9}
    taken = set(numbers.values())
    free = (number for number in range(1, len(names) + len(taken) + 2) if number not in taken)
    return numbers | {name: next(free) for name in names if name not in numbers}


def _text_set(kind: int, lines: Sequence[str] | Iterator[str]) -> bytes:
    text = "\n".join(["    -1", f"{kind:6}", *lines, "    -1", ""])
    return text.encode(errors="replace")


def _long(*values: float) -> str:
    return "".join(f"{value:25.16E}" for value in values).replace("E", "D")


def _short(*values: float) -> str:
    return "".join(f"{value:13.5E}" for value in values)


def _label(text: str) -> str:
    return printable(text)[:80] or "NONE"


def _direction(channel: TestChannel) -> int:
    """Direction of a channel, 1 to 3 or against it."""
    axis = find_axis(channel.direction)
    if axis is None:
        raise ValueError(f"the channel at {channel.point} lies between axes: {channel.direction}")
    return int(axis[1]) * (DIRECTIONS.index(axis[0]) + 1)


def _mode_sets(modes: MeasuredModes, numbers: Mapping[str, int], title: str) -> Iterator[bytes]:
    rows: dict[str, list[int]] = {}
    for row, channel in enumerate(modes.channels):
        rows.setdefault(channel.point, []).append(row)
    # motions along x, y and z of what channels of any directions say; nothing across them
    turns = {
        name: np.linalg.pinv([modes.channels[row].direction for row in which])
        for name, which in rows.items()
    }
    for mode, (hz, damping) in enumerate(zip(modes.frequencies_hz, modes.damping, strict=True)):
        shape = np.array(
            [turns[name] @ modes.shapes[which, mode] for name, which in rows.items()], dtype=complex
        )
        ratio = 0.0 if np.isnan(damping) else float(damping)
        omega = 2.0 * np.pi * float(hz)
        real = not shape.imag.any()
        if real:
            parameters, values = _short(hz, float(modes.scaled), ratio, 0.0), shape.real
        else:
            damped = omega * np.sqrt(max(0.0, 1.0 - ratio**2))
            scale = 2.0 * damped if modes.scaled else 0.0
            parameters = _short(-ratio * omega, damped, 0.0, scale, 0.0, 0.0)
            values = shape.view(float)
        kind = NORMAL if real else COMPLEX
        lines = [
            _label(title),
            *["NONE"] * 3,
            _label(f"Mode {mode + 1:10} Frequency {hz:13.5E}"),
            "".join(f"{number:10}" for number in (1, kind, 2, MOTION, 2 if real else 5, 3)),
            "".join(f"{number:10}" for number in (2, 4 if real else 6, 1, mode + 1)),
            parameters,
        ]
        for name, row in zip(rows, values, strict=True):
            lines += [f"{numbers[name]:10}", _short(*row)]
        yield _text_set(55, lines)


def _response_sets(
    responses: MeasuredResponses, numbers: Mapping[str, int], title: str
) -> Iterator[bytes]:
    hertz = responses.frequencies_hz
    for row, motion in enumerate(responses.motions):
        for column, force in enumerate(responses.forces):
            values = responses.values[:, row, column]
            if np.isfinite(values).all():
                yield _response_set(hertz, values, (motion, force), numbers, title)


def _response_set(
    hertz: FloatArray,
    values: ComplexArray,
    channels: tuple[TestChannel, TestChannel],
    numbers: Mapping[str, int],
    title: str,
) -> bytes:
    # even steps only where six digits say them exactly
    step = float(hertz[1] - hertz[0]) if len(hertz) > 1 else 0.0
    steps = float(f"{hertz[0]:.5E}") + float(f"{step:.5E}") * np.arange(len(hertz))
    even = step > 0.0 and bool((steps == hertz).all())
    columns = [values.real, values.imag] if even else [hertz, values.real, values.imag]
    content = np.stack(columns, axis=1).astype("<f8").tobytes()
    named = [
        f"{'NONE':>10}{numbers[channel.point]:10}{_direction(channel):4}" for channel in channels
    ]
    title_channels = " over ".join(label_channel(one).replace(":", " ") for one in channels)
    header = [
        _label(title),
        _label(title_channels),
        *["NONE"] * 3,
        f"{FREQUENCY_RESPONSE:5}{0:10}{0:5}{0:10} {named[0]} {named[1]}",
        f"{6:10}{len(hertz):10}{int(even):10}"
        + _short(*((hertz[0], step) if even else (0.0, 0.0)), 0.0),
        *(
            f"{kind:10}{0:5}{0:5}{0:5} {label:<20} {unit:<20}"
            for kind, label, unit in (
                (FREQUENCY, "Frequency", "Hz"),
                (MOTION, "Displacement", "m"),
                (FORCE, "Force", "N"),
                (0, "NONE", "NONE"),
            )
        ),
    ]
    first = f"{58:6}b{1:6}{2:6}{HEADER_LINES:12}{len(content):12}{0:6}{0:6}{0:12}{0:12}"
    head = "\n".join(["    -1", first, *header, ""]).encode(errors="replace")
    return head + content + b"\n    -1\n"
