"""Sets of universal files (UFF), as programs of testers write them: text and binary, in columns of
several widths.
"""

import itertools
import struct
from collections.abc import Sequence
from typing import Any

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.scene.test_data.records import ComplexArray

HZ = np.array([10.0, 12.5, 15.0, 17.5, 20.0])
SPECTRUM = np.array([1 + 2j, 3 - 4j, -5 + 6j, 7.125 + 0.1j, 1e-9 - 1e3j])
NEWTON, ACCELERATION = 13, 12


def columns(form: str, *values: float) -> str:
    return "".join(format(value, form) for value in values)


def uff_set(kind: str, *lines: str) -> bytes:
    return "\n".join(["    -1", f"{kind:>6}", *lines, "    -1", ""]).encode()


def units(code: int, length: float, force: float) -> bytes:
    factors = f"{length:25.16e}{force:25.16e}{1.0:25.16e}".replace("e", "D")
    return uff_set("164", f"{code:10}{'units':<20}{1:10}", factors, f"{0.0:25.16e}")


def points_15(*rows: Sequence[float]) -> bytes:
    return uff_set("15", *(columns("10d", *row[:4]) + columns("13.5E", *row[4:]) for row in rows))


def points_2411(*rows: Sequence[float]) -> bytes:
    lines = [columns("10d", *row[:4]) + "\n" + columns("25.16e", *row[4:]) for row in rows]
    return uff_set("2411", *lines)


def header_58(
    ordinate: int,
    *,
    motion: tuple[int, int] = (12, 1),
    force: tuple[int, int] = (3, -3),
    kinds: tuple[int, int] = (ACCELERATION, NEWTON),
    labels: tuple[str, str] = ("NONE", "NONE"),
    function: int = 4,
    even: int = 1,
    hz: FloatArray = HZ,
) -> list[str]:
    begin, step = (hz[0], hz[1] - hz[0]) if even else (0.0, 0.0)
    axes = [(18, "Hz"), (kinds[0], labels[0]), (kinds[1], labels[1]), (0, "NONE")]
    return [
        *["NONE"] * 5,
        f"{function:5}{1:10}{1:5}{0:10} {'NONE':>10}{motion[0]:10}{motion[1]:4} {'NONE':>10}{force[0]:10}{force[1]:4}",
        columns("10d", ordinate, len(hz), even) + columns("13.5e", begin, step, 0.0),
        *(f"{kind:10}{0:5}{0:5}{0:5} {'NONE':<20} {label:<20}" for kind, label in axes),
    ]


def flat(values: ComplexArray | FloatArray, *, even: int, hz: FloatArray = HZ) -> list[float]:
    parts = [values.real, values.imag] if np.iscomplexobj(values) else [values]
    return np.stack(parts if even else [hz, *parts], axis=1).ravel().tolist()


def text_58(
    values: ComplexArray | FloatArray = SPECTRUM,
    *,
    ordinate: int = 6,
    even: int = 1,
    hz: FloatArray = HZ,
    **header: Any,
) -> bytes:
    wide = ["20.12e"] * 4 if even else ["13.5e", "20.12e", "20.12e"]
    forms = ["13.5e"] * 6 if ordinate == 5 else wide
    rows = itertools.batched(flat(values, even=even, hz=hz), len(forms), strict=False)
    lines = ["".join(map(format, row, forms)) for row in rows]
    return uff_set("58", *header_58(ordinate, even=even, hz=hz, **header), *lines)


def binary_58(
    values: ComplexArray | FloatArray = SPECTRUM,
    *,
    ordinate: int = 6,
    even: int = 1,
    order: str = "<",
    end: str = "",
    **header: Any,
) -> bytes:
    numbers = flat(values, even=even)
    content = struct.pack(f"{order}{len(numbers)}{'d' if ordinate in (4, 6) else 'f'}", *numbers)
    sizes = f"    58b{1 if order == '<' else 2:6}{2:6}{11:12}{len(content):12}" + "     0" * 6
    head = "\r\n".join(["    -1", sizes, *header_58(ordinate, even=even, **header), ""])
    return head.encode() + content + end.encode() + b"    -1\r\n"


def shape_55(
    hz: float,
    rows: dict[int, Sequence[complex]],
    *,
    mass: float = 0.0,
    damping: float = 0.0,
    pole: complex | None = None,
    a: complex = 0,
) -> bytes:
    kind, form, parameters = 2, 2, [hz, mass, damping, 0.0]
    if pole is not None:
        kind, form, parameters = 3, 5, [pole.real, pole.imag, a.real, a.imag, 0.0, 0.0]
    lines = []
    for point, values in rows.items():
        parts = np.array(values, dtype=float if pole is None else complex).view(float)
        lines += [f"{point:10}", columns("13.5e", *parts)]
    return uff_set(
        "55",
        *["NONE"] * 5,
        columns("10d", 1, kind, 2, 8, form, 3),
        columns("10d", 2, 4 if pole is None else 6, 1, 1),
        columns("13.5e", *parameters),
        *lines,
    )


def mode_2414(
    rows: dict[int, Sequence[complex]],
    *,
    hz: float = 0.0,
    pole: complex | None = None,
    a: complex = 0,
    where: int = 1,
) -> bytes:
    """A mode at points, with three rotations that are zero."""
    is_complex = pole is not None
    second = [0.0] * 6 if pole is None else [pole.real, pole.imag, a.real, a.imag, 0.0, 0.0]
    lines = []
    for point, values in rows.items():
        whole = np.array([*values, 0, 0, 0], dtype=complex if is_complex else float).view(float)
        lines.append(f"{point:10}")
        lines += [
            columns("13.5e", *part) for part in itertools.batched(whole.tolist(), 6, strict=False)
        ]
    return uff_set(
        "2414",
        columns("10d", 1),
        "mode",
        columns("10d", where),
        *["NONE"] * 5,
        columns("10d", 1, 3 if is_complex else 2, 3, 8, 5 if is_complex else 2, 6),
        columns("10d", 0, 0, 0, 0, 0, 1, 0, 0),
        columns("10d", 0, 0),
        columns("13.5e", 0.0, hz, 0.0, 4.0, 0.01, 0.0),
        columns("13.5e", *second),
        *lines,
    )


def qualifiers_1858(*, window: float = 0.0, rotates: int = 0) -> bytes:
    kinds = (0, 4 if window else 0, 0, 0, 0, rotates, 0, 0, 0, 0, 0, 0)
    return uff_set(
        "1858",
        columns("12d", 1, 0, 1, 0, 0, 0),
        columns("6d", *kinds),
        columns("15.7e", 0.0, 0.0, 0.0, 0.0, 0.0),
        columns("15.7e", 0.0, 0.0, 0.0, 0.0, window),
        columns("15.7e", 0.0, 0.0, 0.0, 0.0, 0.0),
        "X+    Z-",
        "NONE",
    )
