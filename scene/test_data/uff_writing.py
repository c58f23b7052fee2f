"""Modes as a universal file: sets 164, 2411 and 55, SI units, in the axes of the test."""

from collections.abc import Mapping

import numpy as np

from headstock.scene.test_data.records import MeasuredModes, TestPoint

COMPLEX_MODE, THREE_DIRECTIONS, DISPLACEMENT, COMPLEX_DATA = 3, 2, 8, 5
BLANK = "NONE"


def render_modes(modes: MeasuredModes, points: Mapping[str, TestPoint]) -> str:
    """Return modes as the text of a universal file.

    Modal A is ``2 i omega_d`` where the shapes have modal mass one, and zero where they have no scale.
    Points whose names are no numbers are numbered after the others.
    """
    names = list(dict.fromkeys(channel.point for channel in modes.channels))
    numbers = _number(names)
    sets = [_set(164, [f"{1:10}{'SI: m, N':<20}{2:10}", _wide(1.0, 1.0, 1.0), _wide(0.0)])]
    located = [name for name in names if name in points]
    if located:
        lines = []
        for name in located:
            place = "".join(f"{value:25.16E}" for value in points[name].position)
            lines += [f"{numbers[name]:10}{0:10}{0:10}{1:10}", place]
        sets.append(_set(2411, lines))
    for mode, (hz, ratio) in enumerate(zip(modes.frequencies_hz, modes.damping, strict=True)):
        sets.append(_set(55, _mode_lines(modes, mode, float(hz), float(ratio), numbers)))
    return "".join(sets)


def _mode_lines(
    modes: MeasuredModes, mode: int, hz: float, ratio: float, numbers: Mapping[str, int]
) -> list[str]:
    omega, ratio = 2.0 * np.pi * hz, ratio if np.isfinite(ratio) else 0.0
    damped = omega * np.sqrt(1.0 - ratio**2)
    scale = 2.0 * damped if modes.scaled else 0.0
    lines = [f"mode {mode + 1}, {hz:.6g} Hz", *[BLANK] * 4]
    kinds = (1, COMPLEX_MODE, THREE_DIRECTIONS, DISPLACEMENT, COMPLEX_DATA, 3)
    lines += [_integers(*kinds), _integers(2, 6, 1, mode + 1)]
    lines.append(_narrow(-ratio * omega, damped, 0.0, scale, 0.0, 0.0))
    for name, number in numbers.items():
        rows = [place for place, channel in enumerate(modes.channels) if channel.point == name]
        directions = np.array([modes.channels[row].direction for row in rows])
        moved = np.linalg.pinv(directions) @ modes.shapes[rows, mode]
        lines += [_integers(number), _narrow(*moved.astype(np.complex128).view(np.float64))]
    return lines


def _number(names: list[str]) -> dict[str, int]:
    """Return a number for each name: its own where it is one."""
    used = {int(name) for name in names if name.isdecimal()}
    after = iter(range(max(used, default=0) + 1, max(used, default=0) + len(names) + 1))
    return {name: int(name) if name.isdecimal() else next(after) for name in names}


def _set(kind: int, lines: list[str]) -> str:
    return "\n".join(["    -1", f"{kind:6}", *lines, "    -1", ""])


def _integers(*values: int) -> str:
    return "".join(f"{value:10}" for value in values)


def _narrow(*values: float) -> str:
    return "".join(f"{value:13.5E}" for value in values)


def _wide(*values: float) -> str:
    return "".join(f"{value:25.16E}" for value in values).replace("E", "D")
