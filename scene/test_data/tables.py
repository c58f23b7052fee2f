"""Frequency responses in tables: CSV with named columns, arrays of MATLAB, text of three columns."""

import re
from array import array
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from headstock.geometry.errors import printable
from headstock.geometry.frames import DIRECTIONS, FloatArray
from headstock.meshing.scipy_library import scipy
from headstock.scene.reading.csv_files import CsvError, Rows, parse_rows, read_lines
from headstock.scene.test_data.errors import MeasurementError
from headstock.scene.test_data.records import ComplexArray, TestChannel, TestData, as_vector
from headstock.scene.test_data.responses import Response, join_responses, read_force, read_motion

EXAMPLE = "frequency,12:+x/3:-z re,12:+x/3:-z im"
MOST_COLUMNS = 20_000
ONE = TestChannel("1", (1.0, 0.0, 0.0))  # of a file that names no channel
_NAME = r"([^\s:/,]+)\s*:\s*([+-]?)([xyz])"
_CHANNEL = re.compile(_NAME, re.IGNORECASE)
_COLUMN = re.compile(
    rf"{_NAME}\s*/\s*{_NAME}\s+(re|im|mag|phase)\s*(?:\[([^\[\]]*)\])?", re.IGNORECASE
)
_FREQUENCY = re.compile(r"frequency\s*(\[hz\])?", re.IGNORECASE)
# as a table of a tool calls its columns
_TOOL_COLUMNS = {"tip": "tip:+x/tip:+x", "cross": "base:+x/tip:+x", "base": "base:+x/base:+x"}
_TOOL_COLUMN = re.compile(r"(tip|cross|base)_(re|im)", re.IGNORECASE)
type _Pair = tuple[TestChannel, TestChannel]


def parse_csv(path: Path) -> TestData:
    """Read a CSV file: a column of frequencies [Hz], and two of each pair of channels, such as
    ``12:+x/3:-z re [um/N]`` and ``... im``, or ``... mag`` and ``... phase [deg]``.

    Raises:
        MeasurementError: A column has another name or no partner, or an entry is no finite number;
            says where.
    """

    def parse(head: list[str], rows: Rows) -> tuple[list[str], FloatArray]:
        if len(head) > MOST_COLUMNS:
            raise CsvError(f"{path.name}:1: has more than {MOST_COLUMNS} columns; write fewer")
        return head, parse_rows(path, rows, list(range(len(head))), None, "")

    try:
        head, values = read_lines(path, parse)
    except CsvError as error:
        raise MeasurementError(str(error)) from error
    where = f"{path.name}:1"
    hertz: FloatArray | None = None
    pairs: dict[_Pair, dict[str, tuple[FloatArray, str]]] = {}
    for entry, column in zip(head, values.T, strict=True):
        text = _TOOL_COLUMN.sub(
            lambda match: f"{_TOOL_COLUMNS[match[1].lower()]} {match[2]}", entry
        )
        if _FREQUENCY.fullmatch(text.strip()):
            hertz = column
            continue
        match = _COLUMN.fullmatch(text.strip())
        if match is None:
            raise MeasurementError(
                f"{where}: column {printable(entry[:60])!r} names no pair of channels; write point and direction of motion and force, and"
                f" re and im, or mag and phase: {EXAMPLE}"
            )
        pair = _channel(match.groups()[:3]), _channel(match.groups()[3:6])
        parts = pairs.setdefault(pair, {})
        if match[7].lower() in parts:
            raise MeasurementError(
                f"{where}: column {printable(entry[:60])!r} stands twice; keep one"
            )
        parts[match[7].lower()] = column, match[8] or ""
    if hertz is None:
        raise MeasurementError(f"{where}: has no column frequency [Hz]; write it as in {EXAMPLE}")
    _require_rising(path.name, hertz, range(2, len(hertz) + 2))
    responses = []
    for (motion, force), parts in pairs.items():
        name = f"{where}: {motion.point}/{force.point}"
        order, spectrum = _spectrum(name, parts)
        responses.append(Response(name, motion, force, hertz, spectrum, order))
    return _join(where, responses)


def parse_text(path: Path) -> TestData:
    """Read lines of three numbers, as CutPro writes them: frequency [Hz], real and imaginary part of
    one receptance [m/N]. Lines before the first of numbers are a heading.

    Raises:
        MeasurementError: A line does not hold three finite numbers, or frequencies do not rise; says
            where.
    """
    numbers, lines = array("d"), array("q")
    with path.open(encoding="utf-8-sig", errors="replace") as stream:
        for line, text in enumerate(stream, 1):
            fields = re.split(r"[,;\s]+", text.strip())
            try:
                row = [float(field) for field in fields if field]
            except ValueError:
                row = []
            if len(row) == 3 and np.isfinite(row).all():
                numbers.extend(row)
                lines.append(line)
            elif lines and text.strip():
                raise MeasurementError(
                    f"{path.name}:{line}: frequency [Hz], real and imaginary part [m/N] are needed, not {printable(text[:60].strip())!r}"
                )
    if len(lines) < 2:
        raise MeasurementError(
            f"{path.name}:1: holds {len(lines)} lines of three numbers, frequency [Hz], real and imaginary part [m/N]; at least two are needed"
        )
    hertz, real, imaginary = np.array(numbers).reshape(-1, 3).T
    values = np.array(real + 1j * imaginary, dtype=complex)
    _require_rising(path.name, hertz, lines)
    where = f"{path.name}:{lines[0]}"
    return _join(where, [Response(where, ONE, ONE, hertz, values)])


def parse_mat(path: Path) -> TestData:
    """Read a MATLAB file (version 5 to 7) with ``frequency`` ``(l,)`` [Hz], ``H`` ``(l, m, f)``, the names
    of its ``outputs`` and ``inputs`` such as ``12:+x``, and its ``unit``, m/N where there is none.

    Raises:
        MeasurementError: It is damaged, lacks an array, or shapes and names do not fit; says what to
            write.
    """
    where = f"{path.name}:1"
    try:
        content: dict[str, Any] = scipy.io.loadmat(path, squeeze_me=False)
    except NotImplementedError as error:
        raise MeasurementError(
            f"{where}: is a file of version 7.3; save it with -v7 in MATLAB"
        ) from error
    except Exception as error:  # a damaged file raises whatever it hits
        raise MeasurementError(
            f"{where}: cannot be read ({error}); save it again with -v7"
        ) from error
    try:
        hertz = np.asarray(content["frequency"], dtype=float).ravel()
        values = np.asarray(content["H"], dtype=complex)
    except (KeyError, TypeError, ValueError) as error:
        raise MeasurementError(
            f"{where}: needs numbers frequency (n) [Hz] and H (n, outputs, inputs) [m/N]; save them so"
        ) from error
    if values.size == len(hertz):
        values = values.reshape(-1, 1, 1)
    values = values[..., None] if values.ndim == 2 else values
    motions, forces = (
        (
            _channels(where, key, content.get(key), count)
            for key, count in zip(("outputs", "inputs"), values.shape[1:], strict=False)
        )
        if values.ndim == 3
        else ((), ())
    )
    if values.shape != (len(hertz), len(motions), len(forces)):
        raise MeasurementError(
            f"{where}: H has the shape {values.shape}; (frequencies, outputs, inputs) of {len(hertz)} frequencies is read"
        )
    _require_rising(path.name, hertz, [1] * len(hertz))
    order, factor = _unit(where, _texts(content.get("unit", ""))[0])
    values = np.asarray(factor * values, dtype=complex)
    return _join(
        where,
        [
            Response(f"{where}: H", motion, force, hertz, values[:, i, j], order)
            for i, motion in enumerate(motions)
            for j, force in enumerate(forces)
            if not np.isnan(values[:, i, j]).all()
        ],
    )


def _join(where: str, responses: Sequence[Response]) -> TestData:
    joined, remarks = join_responses(responses)
    if joined is None:
        raise MeasurementError(
            f"{where}: holds no frequency response; write columns as in {EXAMPLE}"
        )
    return TestData(responses=joined, remarks=remarks)


def _require_rising(name: str, hertz: FloatArray, lines: Sequence[int]) -> None:
    """Refuse frequencies that fall or repeat; ``lines`` of the file, one for each."""
    falls = np.flatnonzero(np.diff(hertz) <= 0.0)
    if len(falls):
        at = int(falls[0]) + 1
        raise MeasurementError(
            f"{name}:{lines[at]}: frequencies must rise; {hertz[at]:g} Hz follows {hertz[at - 1]:g} Hz"
        )


def _channel(fields: Sequence[str | None]) -> TestChannel:
    """A channel of point, sign and direction."""
    point, sign, axis = (field or "" for field in fields)
    vector = np.eye(3)[DIRECTIONS.index(axis.lower())] * (-1.0 if sign == "-" else 1.0)
    return TestChannel(point, as_vector(vector))


def _spectrum(where: str, parts: dict[str, tuple[FloatArray, str]]) -> tuple[int, ComplexArray]:
    """How often the motion is differentiated, and its values in SI."""
    if set(parts) == {"re", "im"}:
        (real, unit), (imaginary, other) = parts["re"], parts["im"]
        values = real + 1j * imaginary
    elif set(parts) == {"mag", "phase"}:
        (size, unit), (angle, turn) = parts["mag"], parts["phase"]
        if turn not in ("", "deg", "rad"):
            raise MeasurementError(
                f"{where}: a phase in {printable(turn[:20])!r}; write [deg] or [rad]"
            )
        other = unit
        values = size * np.exp(1j * (angle if turn == "rad" else np.deg2rad(angle)))
    else:
        raise MeasurementError(
            f"{where}: has the columns {' and '.join(parts)}; write re and im, or mag and phase"
        )
    if unit != other:
        raise MeasurementError(
            f"{where}: re is in {unit or 'm/N'}, im in {other or 'm/N'}; write both in one"
        )
    order, factor = _unit(where, unit)
    return order, np.asarray(factor * values, dtype=complex)


def _unit(where: str, text: str) -> tuple[int, float]:
    above, _, below = (text or "m/N").rpartition("/")
    motion, newtons = read_motion(above), read_force(below)
    if motion is None or newtons is None:
        raise MeasurementError(
            f"{where}: the unit {printable(text[:20])!r} is not read; write m/N, um/N, m/s/N, m/s^2/N or g/N"
        )
    return motion[0], motion[1] / newtons


def _texts(value: Any) -> list[str]:
    """Texts of MATLAB: a cell array, or a matrix of characters."""
    flat = [np.ravel(item) for item in np.ravel(np.asarray(value))]
    return [str(item[0]).strip() if len(item) else "" for item in flat] or [""]


def _channels(where: str, key: str, value: Any, count: int) -> tuple[TestChannel, ...]:
    if value is None and count == 1:
        return (ONE,)
    names = [] if value is None else _texts(value)
    matches = [_CHANNEL.fullmatch(name) for name in names]
    if len(names) != count or None in matches:
        raise MeasurementError(
            f"{where}: {key} names {len(names)} channels of {count} in H; write a cell array such as {{'12:+x', '12:-y'}}"
        )
    return tuple(_channel(match.groups()) for match in matches if match)
