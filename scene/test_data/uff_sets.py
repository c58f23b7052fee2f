"""Sets of a universal file (UFF): found by their markers, counted, and written as pyuff reads them.

pyuff passes over what is missing: of a file that was cut short it returns fewer sets, or sets with
fewer points. So every set is first compared with the counts that it announces itself.

Source: I-DEAS Universal File Formats (SDRC), as archived by the University of Cincinnati.
"""

import bisect
import itertools
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import accumulate

import numpy as np

from headstock.geometry.errors import printable
from headstock.scene.test_data.errors import MeasurementError

MOST_SETS = 50_000
MOST_POINTS = 100_000
FREQUENCY_RESPONSE, COHERENCE = 4, 6  # function types of a set 58
# of a set 2414: data at nodes; modes; vectors of 3 or 6 motions, whose numbers are real or complex
AT_NODES, MODES, MOTIONS, REAL, COMPLEX = 1, (2, 3, 7), {2: 3, 3: 6}, (2, 4), (5, 6)
BEAMS = (11, 21, 22, 23, 24)  # elements of a set 2412 with a line of their own for the section
AGAIN = "the file is cut or damaged: export it again"
_MARKER = re.compile(rb"^[ \t]*-1[ \t]*\r?$", re.MULTILINE)
_KIND = re.compile(rb"\n[ \t]*(\d{1,6})[ \t]*([bB][^\r\n]*)?\r?(?=\n|\Z)")
_BINARY_END = re.compile(rb"\r?\n?[ \t]*-1[ \t]*\r?(?=\n|\Z)")
_PADDING = b" \t\r\n\0\x1a"
_FUNCTION_LINES = 11  # of a set 58 before its values
_SHAPE_LINES = 8  # of a set 55 before its points
_ANALYSIS_LINES = 13  # of a set 2414 before its points
# bytes of a number by the type of an ordinate: 2, 4 real, 5, 6 complex
_NUMBER_BYTES = {2: 4, 4: 8, 5: 4, 6: 8}
_COMPLEX = (5, 6)


class _LineError(Exception):
    """Something wrong in a set, with the index of the line behind its number."""

    def __init__(self, index: int, message: str) -> None:
        super().__init__(message)
        self.index = index


@dataclass(frozen=True, eq=False)
class UffSet:
    """A set of a universal file.

    Attributes:
        number: In the file, from 1.
        kind: Number of its format, such as 58.
        line: Of the file, in which that number stands.
        lines: Text below that line: all of it, or the header of a binary set.
        head: Rest of the line of its number, which a binary set has.
        values: Bytes of a binary set.
    """

    number: int
    kind: int
    line: int
    lines: tuple[str, ...]
    head: str = ""
    values: bytes = b""

    def __str__(self) -> str:
        return f"set {self.number} ({self.kind}{self.head[:1]})"

    @property
    def function(self) -> int | None:
        """Function type of a set 58, None for other sets."""
        return _integers(self.lines[5], (5,), 5)[0] if self.kind == 58 else None


def split_sets(name: str, content: bytes) -> list[UffSet]:
    """Find the sets of a file by the lines ``-1`` before and behind each.

    Raises:
        MeasurementError: A marker is missing, text stands between sets, or there are no sets or too
            many; says where.
    """
    line_ends = np.flatnonzero(np.frombuffer(content, np.uint8) == ord("\n"))

    def line_at(position: int) -> int:
        return int(np.searchsorted(line_ends, position)) + 1

    def fail(position: int, message: str) -> MeasurementError:
        return MeasurementError(f"{name}:{line_at(position)}: {message}")

    sets: list[UffSet] = []
    end = 0
    while True:
        opening = _MARKER.search(content, end)
        between = content[end : opening.start() if opening else None]
        if text := between.strip(_PADDING):
            shown = printable(text.splitlines()[0][:40].decode(errors="replace"))
            hint = AGAIN if sets or opening else "is this a universal file (UFF)?"
            raise fail(
                end + between.index(text),
                f"{shown!r} stands outside of all sets, which begin and end with a line -1; {hint}",
            )
        if opening is None:
            break
        if len(sets) == MOST_SETS:
            raise fail(end, f"more than {MOST_SETS} sets; write them into several files")
        number = len(sets) + 1
        kind = _KIND.match(content, opening.end())
        if kind is None:
            raise fail(
                opening.end() + 1,
                f"set {number} does not begin with its number: a line -1 is missing or too much; {AGAIN}",
            )
        head = (kind[2] or b"").decode(errors="replace")
        start = kind.start() + 1
        made = UffSet(number, int(kind[1]), line_at(start), (), head)
        try:
            lines, values, end = _read_body(content, kind.end(), binary=bool(head))
        except _LineError as fault:
            raise _locate(name, made, fault) from None
        sets.append(UffSet(number, made.kind, made.line, lines, head, values))
    if not sets:
        raise fail(0, "holds no set; export it again")
    return sets


def _read_body(content: bytes, start: int, *, binary: bool) -> tuple[tuple[str, ...], bytes, int]:
    """Lines and bytes of a set, and where its last marker ends.

    Args:
        start: End of the line of its number.
    """
    values, stop = b"", start
    if binary:
        for _ in range(1 + _FUNCTION_LINES):
            stop = content.find(b"\n", stop) + 1 or len(content)
        lines = _text_lines(content[start : stop - 1])
        if len(lines) < _FUNCTION_LINES:
            raise _LineError(-1, f"ends within its header; {AGAIN}")
        kind, points, even = _integers(lines[6], (10, 10, 10), 6)
        size = points * _numbers_per_point(kind, even) * _NUMBER_BYTES[kind]
        values = content[stop : stop + size]
        closing = _BINARY_END.match(content, stop + size)
        if closing is None:
            raise _LineError(
                6, f"{points} points ({size} bytes) with -1 behind them were announced; {AGAIN}"
            )
        return lines, values, closing.end()
    closing = _MARKER.search(content, start)
    if closing is None:
        raise _LineError(-1, f"does not end with a line -1; {AGAIN}")
    return _text_lines(content[start : closing.start()]), b"", closing.end()


def _text_lines(text: bytes) -> tuple[str, ...]:
    """Lines below that of the number, without blanks at their ends."""
    lines = [line.decode(errors="replace").rstrip() for line in text.split(b"\n")[1:]]
    while lines and not lines[-1]:
        lines.pop()
    return tuple(lines)


def rewrite_set(name: str, made: UffSet) -> bytes:
    """Check a set and write it as pyuff reads it: numbers apart, columns filled, markers as wide as
    they should be.

    Raises:
        MeasurementError: It does not hold what it announces, or a field is no number; says where.
    """
    try:
        lines = _REWRITERS[made.kind](made)
    except _LineError as fault:
        raise _locate(name, made, fault) from None
    text = "\n".join(["    -1", f"{made.kind:6}{made.head}", *lines, ""])
    return text.encode() + made.values + b"    -1\n"


def convert_analysis(name: str, made: UffSet) -> UffSet | None:
    """Return a mode of a set 2414 as a set 55; None where it holds something else.

    Raises:
        MeasurementError: It does not hold what it announces, or a field is no number; says where.
    """
    try:
        lines = _convert_mode(made)
    except _LineError as fault:
        raise _locate(name, made, fault) from None
    return None if lines is None else UffSet(made.number, 55, made.line, tuple(lines))


def _convert_mode(made: UffSet) -> list[str] | None:
    _require_lines(made, _ANALYSIS_LINES)
    where = _integers(made.lines[2], (10,), 2)[0]
    model, analysis, vector, result, kind, _ = _integers(made.lines[8], (10,) * 6, 8)
    if where != AT_NODES or analysis not in MODES or vector not in MOTIONS:
        return None
    if kind not in REAL + COMPLEX:
        raise _LineError(8, f"data of type {kind}; write 2 or 4 (real), 5 or 6 (complex)")
    parts = 2 if kind in COMPLEX else 1
    mode = _integers(made.lines[9], (10,) * 8, 9)[5]
    reals = [_numbers(made.lines[index], index) for index in (11, 12)]
    if min(map(len, reals)) < 6:
        raise _LineError(11, f"six numbers in two lines are needed; {AGAIN}")
    normal = analysis == MODES[0]
    first, second = reals
    parameters = [first[1], first[3], first[4], first[5]] if normal else second[:6]
    numbers = parts * MOTIONS[vector]
    per_point = 1 + -(-numbers // 6)
    rows: list[str] = []
    for start in range(_ANALYSIS_LINES, len(made.lines), per_point):
        point, *values = made.lines[start : start + per_point]
        filled, count = _fill_columns(values, (13,) * 6, start + 1)
        if count != numbers:
            raise _LineError(
                start, f"{numbers} numbers of a point are needed, not {count}; {AGAIN}"
            )
        rows += [f"{_integers(point, (10,), start)[0]:10}", "".join(filled)[: 13 * 3 * parts]]
    return [
        *made.lines[3:8],
        "".join(f"{n:10}" for n in (model, analysis, 2, result, (2, 5)[parts - 1], 3)),
        "".join(f"{n:10}" for n in (2, len(parameters), 1, mode)),
        "".join(f"{float(text):13.5E}" for text in parameters),
        *rows,
    ]


@dataclass(frozen=True)
class Qualifiers:
    """What a set 1858 says of the set 58 behind it.

    Attributes:
        rotates: The motion is a rotation, or the force a moment.
        octaves: Lines are those of octaves or parts of them.
        window: Damping factor of an exponential window; zero without one.
    """

    rotates: bool = False
    octaves: bool = False
    window: float = 0.0


def read_qualifiers(name: str, sets: Sequence[UffSet]) -> dict[int, Qualifiers]:
    """Return the qualifiers of functions, by number of their set.

    Raises:
        MeasurementError: A set 1858 is cut, or a field is no number; says where.
    """
    found = {}
    for made, following in itertools.pairwise(sets):
        if (made.kind, following.kind) == (1858, 58):
            try:
                found[following.number] = _read_qualifiers(made)
            except _LineError as fault:
                raise _locate(name, made, fault) from None
    return found


def _read_qualifiers(made: UffSet) -> Qualifiers:
    _require_lines(made, 4)
    # writers use columns of several widths
    rows = [[float(field) for field in _numbers(made.lines[row], row)] for row in (0, 1, 3)]
    if [len(row) >= least for row, least in zip(rows, (2, 8, 5), strict=True)] != [True] * 3:
        raise _LineError(0, f"has too few fields; {AGAIN}")
    run, kinds, user = rows
    return Qualifiers(bool(kinds[5] or kinds[6]), bool(run[1]), user[4])


def _require_lines(made: UffSet, count: int) -> None:
    """Refuse a set that ends within its header."""
    if len(made.lines) < count:
        raise _LineError(-1, f"ends within its header; {AGAIN}")


def _locate(name: str, made: UffSet, fault: _LineError) -> MeasurementError:
    return MeasurementError(f"{name}:{made.line + 1 + fault.index}: {made}: {fault}")


def _integers(line: str, widths: Sequence[int], index: int) -> list[int]:
    """Whole numbers in columns of a line; a blank one is 0."""
    ends = list(accumulate(widths))
    fields = [line[end - width : end].strip() for end, width in zip(ends, widths, strict=True)]
    try:
        return [int(field or 0) for field in fields]
    except ValueError:
        raise _LineError(
            index, f"whole numbers in columns {ends} are needed, not {printable(line[:80])!r}"
        ) from None


def _numbers(line: str, index: int, count: int | None = None) -> list[str]:
    """Numbers of a line that are separated by blanks, as text that Python reads.

    Args:
        count: How many there should be; None for any.
    """
    fields = line.replace("D", "E").replace("d", "e").split()
    try:
        finite = all(np.isfinite(float(field)) for field in fields)
    except ValueError:
        finite = False
    if not finite or count not in (None, len(fields)):
        wanted = "numbers" if count is None else f"{count} numbers"
        raise _LineError(index, f"{wanted} are needed, not {printable(line[:80])!r}; {AGAIN}")
    return fields


def _numbers_per_point(kind: int, even: int) -> int:
    if kind not in _NUMBER_BYTES:
        raise _LineError(
            6, f"the ordinate is of type {kind}; write 2 or 4 (real), 5 or 6 (complex)"
        )
    return (2 if kind in _COMPLEX else 1) + (even == 0)


def _rewrite_function(made: UffSet) -> list[str]:
    """Set 58: functions."""
    _require_lines(made, _FUNCTION_LINES)
    header = list(made.lines[:_FUNCTION_LINES])
    kind, points, even = _integers(header[6], (10, 10, 10), 6)
    wanted = points * _numbers_per_point(kind, even)
    if points < 1:
        raise _LineError(6, f"has {points} points; export it again")
    if made.head:
        order, form, lines, _ = (
            _integers(made.head[1:], (6, 6, 12, 12), -1) if made.values else (0, 0, 0, 0)
        )
        if order not in (1, 2) or form != 2 or lines != _FUNCTION_LINES:
            raise _LineError(
                -1,
                f"byte order {order}, format of numbers {form} and {lines} lines of header; 1 or 2, 2 (IEEE 754) and"
                f" {_FUNCTION_LINES} are read: export it as text",
            )
        return header
    widths: tuple[int, ...]
    if kind in (2, 5):
        widths = (13,) * 6
    elif even:
        widths = (20,) * 4
    else:
        widths = (13, 20, 13, 20) if kind == 4 else (13, 20, 20)
    filled, count = _fill_columns(made.lines[_FUNCTION_LINES:], widths, _FUNCTION_LINES)
    if count != wanted:
        raise _LineError(
            6, f"{points} points ({wanted} numbers) are announced, its lines hold {count}; {AGAIN}"
        )
    return [*header, *filled]


def _fill_columns(lines: Sequence[str], widths: Sequence[int], first: int) -> tuple[list[str], int]:
    """Lines of numbers in fixed columns, filled with blanks to whole columns, and how many numbers
    they hold.

    Args:
        first: Index of the first of them in its set.
    """
    ends = list(accumulate(widths))
    starts = [0, *ends]
    filled, count = [], 0
    for index, line in enumerate(lines, first):
        columns = bisect.bisect_left(ends, len(line)) + 1
        text = line.replace("D", "E").replace("d", "e")
        cells = [text[start:end] for start, end in zip(starts, ends, strict=False)][:columns]
        try:
            faulty = columns > len(ends) or not np.isfinite([float(cell) for cell in cells]).all()
        except ValueError:
            faulty = True
        if faulty:
            shown = " + ".join(map(str, widths))
            raise _LineError(
                index,
                f"finite numbers in columns of {shown} characters are needed, not {printable(line[:80])!r}; {AGAIN}",
            )
        filled.append(text.ljust(ends[columns - 1]))
        count += columns
    return filled, count


def _rewrite_shape(made: UffSet) -> list[str]:
    """Set 55: data at points."""
    _require_lines(made, _SHAPE_LINES)
    *_, kind, per_point = _integers(made.lines[5], (10,) * 6, 5)
    reals = _integers(made.lines[6], (10, 10), 6)[1]
    numbers = per_point * (2 if kind == 5 else 1)
    if kind not in (2, 5) or not 1 <= numbers <= 6 or reals > 6:
        raise _LineError(
            5,
            f"data of type {kind} with {per_point} values per point; real or complex displacements in x, y, z are read:"
            " export the shapes without rotations",
        )
    points, values = made.lines[_SHAPE_LINES::2], made.lines[_SHAPE_LINES + 1 :: 2]
    if len(points) != len(values) or len(points) > MOST_POINTS:
        raise _LineError(len(made.lines) - 1, f"a point has no values; {AGAIN}")
    filled = list(made.lines[:_SHAPE_LINES])
    # of a damped mode the second line of parameters may be short
    filled[7] = filled[7].ljust(13 * 6)
    for index, (point, line) in enumerate(zip(points, values, strict=True)):
        at = _SHAPE_LINES + 2 * index
        _integers(point, (10,), at)
        text, count = _fill_columns([line], (13,) * numbers, at + 1)
        if count != numbers:
            raise _LineError(at + 1, f"{numbers} numbers are needed, not {count}; {AGAIN}")
        filled += [f"{point:>10}", *text]
    return filled


def _rewrite_records(made: UffSet) -> list[str]:
    """Sets 15, 18, 2411 and 2420: points and coordinate systems, so many lines of numbers each."""
    above, record = _RECORDS[made.kind]
    lines, size = made.lines[above:], len(record)
    if len(made.lines) < above or len(lines) % size:
        raise _LineError(len(made.lines) - 1, f"each entry has {size} lines; {AGAIN}")
    if len(lines) > size * MOST_POINTS:
        raise _LineError(0, f"more than {MOST_POINTS} entries; export fewer")
    rows = [_numbers(made.lines[0], 0)[0], *made.lines[1:above]] if above else []
    for index, line in enumerate(lines, above):
        wanted = record[(index - above) % size]
        if not wanted:  # a title
            rows.append(line)
        elif isinstance(wanted, int):
            rows.append(f" {' '.join(_numbers(line, index, wanted))}")
        else:
            ends = list(accumulate(wanted))
            cells = [line[end - width : end] for end, width in zip(ends, wanted, strict=True)]
            spaced = " ".join(cells)  # not all writers keep to columns
            spaced = spaced if len(spaced.split()) == len(wanted) else line
            fields = _numbers(spaced, index, len(wanted))
            # pyuff reads a set 18 by columns, a set 15 by blanks
            blank = " " * (made.kind == 15)
            columns = (f"{one:>{w}}" for one, w in zip(fields, wanted, strict=True))
            rows.append(blank + blank.join(columns))
    return rows


def _rewrite_trace(made: UffSet) -> list[str]:
    """Set 82: a line through points."""
    _require_lines(made, 2)
    wanted = _integers(made.lines[0], (10, 10), 0)[1]
    rows = [" " + " ".join(_numbers(line, index)) for index, line in enumerate(made.lines[2:], 2)]
    count = sum(len(row.split()) for row in rows)
    if count < wanted:
        raise _LineError(0, f"{wanted} points are announced, {count} follow; {AGAIN}")
    return [*made.lines[:2], *rows]


def _rewrite_elements(made: UffSet) -> list[str]:
    """Set 2412: elements, the points of each in one line."""
    rows: list[str] = []
    index = 0
    while index < len(made.lines):
        head = _numbers(made.lines[index], index, 6)
        take = [index + 1] if int(head[1]) in BEAMS else []
        points: list[str] = []
        following = index + 1 + len(take)
        while len(points) < int(head[5]) and following < len(made.lines):
            points += _numbers(made.lines[following], following)
            following += 1
        if len(points) != int(head[5]) or not points:
            raise _LineError(
                index, f"{head[5]} points are announced, {len(points)} follow; {AGAIN}"
            )
        rows += [" ".join(head), *(made.lines[line] for line in take), " ".join(points)]
        index = following
    return rows


def _rewrite_units(made: UffSet) -> list[str]:
    """Set 164: factors of units."""
    fields = [
        field for index, line in enumerate(made.lines[1:], 1) for field in _numbers(line, index)
    ]
    if len(fields) < 2 or min(map(float, fields[:2])) <= 0.0:
        raise _LineError(1, f"positive factors of length and force are needed; {AGAIN}")
    return [made.lines[0], " ".join([*fields, "1", "0"][:4] if len(fields) < 4 else fields[:4])]


# lines above records; of each line of a record how many numbers it has, or the widths of those that
# may touch; none of a title
_RECORDS: dict[int, tuple[int, list[int | tuple[int, ...]]]] = {
    15: (0, [(10,) * 4 + (13,) * 3]),
    18: (0, [5, 0, (13,) * 6, (13,) * 3]),
    2411: (0, [4, 3]),
    2420: (2, [3, 0, 3, 3, 3, 3]),
}
# formats that are read; a header (151) is only quoted, with as many lines as it should have
_REWRITERS: dict[int, Callable[[UffSet], list[str]]] = {
    15: _rewrite_records,
    18: _rewrite_records,
    55: _rewrite_shape,
    58: _rewrite_function,
    82: _rewrite_trace,
    151: lambda made: [*made.lines, *[""] * 7][:7],
    164: _rewrite_units,
    2411: _rewrite_records,
    2412: _rewrite_elements,
    2420: _rewrite_records,
}
KINDS = frozenset(_REWRITERS)
