"""Cards of Nastran bulk data, whatever form their lines have.

Source: MSC Nastran Quick Reference Guide, "Format of Bulk Data Entries".
"""

import re
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.meshing.errors import MeshError

# an exponent may follow without its letter
_SHORT_EXPONENT = re.compile(r"(?<=[\d.])([+-]\d+)$")
# a line of = repeats the card before; how often more
_REPEATED = re.compile(r"=(?:\(?(\d{1,7})\)?)?$")
# what is added to a field of the card before
_STEP = re.compile(r"\*\(?([^()]+)\)?$")
FIELDS = 8  # of a line of small fields, and of a pair of lines of large ones


@dataclass
class Card:
    """A card with the lines that continue it.

    Attributes:
        place: Name of the file and number of the line, for messages.
        name: Upper case, without ``*``.
    """

    place: str
    name: str
    fields: list[str]

    def integer(self, index: int, default: int = 0) -> int:
        """Return a field as a whole number; ``default`` where it is blank.

        Raises:
            MeshError: It is none.
        """
        text = self.fields[index] if index < len(self.fields) else ""
        try:
            return int(text) if text else default
        except ValueError:
            raise MeshError(
                f"{self.place}: {self.name}: field {index + 2} is {text!r}, which is no whole number"
            ) from None

    def real(self, index: int) -> float:
        """Return a field as a real number; zero where it is blank.

        Raises:
            MeshError: It is none.
        """
        text = self.fields[index] if index < len(self.fields) else ""
        if not text:
            return 0.0
        try:
            return float(_SHORT_EXPONENT.sub(r"E\1", text.upper().replace("D", "E")))
        except ValueError:
            raise MeshError(
                f"{self.place}: {self.name}: field {index + 2} is {text!r}, which is no number"
            ) from None

    def vector(self, index: int) -> FloatArray:
        """Return three fields as real numbers."""
        return np.array([self.real(index + axis) for axis in range(3)])


@dataclass
class _Line:
    """One line of a card.

    Attributes:
        name: Of the card, upper case; empty for a line that continues one.
        label: Behind the sign of continuation.
        fields: The four or eight fields of the line.
        mark: What names the line that continues this one, without its first letter.
        beyond: Number of fields behind the first where they are more than a line has, or else 0.
    """

    number: int
    name: str
    label: str
    fields: list[str]
    mark: str
    beyond: int


def _find_bulk(path: Path, rows: Sequence[str]) -> int:
    """Find how many lines stand before the bulk data.

    Raises:
        MeshError: There are several sections of it, or a line refers to another file.
    """
    begin = 0
    for number, row in enumerate(rows, 1):
        words = row.partition("$")[0].upper().split()
        if words[:1] == ["INCLUDE"] or row.lstrip()[:8].upper() in ("INCLUDE'", 'INCLUDE"'):
            # the cells in the other file would be missing without a word
            raise MeshError(
                f"{path.name}:{number}: INCLUDE is not supported; write the whole mesh into one file"
            )
        if words[:1] == ["BEGIN"]:
            if begin or words[1:] != ["BULK"]:
                raise MeshError(
                    f"{path.name}:{number}: several bulk data sections are not read; write one part alone"
                )
            begin = number
    return begin


def _bulk_lines(path: Path, text: str) -> Iterator[_Line]:
    """Yield the lines of the bulk data section, or of the whole file where none begins.

    Raises:
        MeshError: A line refers to another file, or is of no known format.
    """
    rows = text.splitlines()
    begin = _find_bulk(path, rows)
    before: _Line | None = None
    steps: list[str] = []
    for number, row in enumerate(rows[begin:], begin + 1):
        text = row.partition("$")[0].rstrip()
        if not text:
            continue
        if text.lstrip().upper().startswith("ENDDATA"):
            return
        line = _split_line(path, number, text)
        if not line.name.startswith("="):
            before, steps = line, []
            yield line
            continue
        repeated = _REPEATED.match(line.name)
        if repeated is None or before is None or not before.name or (repeated[1] and not steps):
            raise MeshError(
                f"{path.name}:{number}: {line.name} repeats no card of one line; write the cards out"
            )
        if not repeated[1]:
            steps = line.fields
        for _ in range(int(repeated[1] or 1)):
            before = replace(before, number=number, fields=_add_steps(path, before, steps))
            yield before


def _add_steps(path: Path, before: _Line, steps: Sequence[str]) -> list[str]:
    """Return the fields of a card that repeats the one before: ``=`` for the same, ``==`` for all
    that follow, ``*(2)`` for two more.

    Raises:
        MeshError: A field to which something is added is no number.
    """
    previous = Card(f"{path.name}:{before.number}", before.name, before.fields)
    fields: list[str] = []
    for column, (text, step) in enumerate(zip(before.fields, steps, strict=True)):
        if step == "==":
            return fields + before.fields[column:]
        match = _STEP.match(step)
        if match is None:
            fields.append(text if step == "=" else step)
            continue
        added = Card(previous.place, before.name, ["", match[1]])
        whole = text.lstrip("+-").isdigit() and match[1].lstrip("+-").isdigit()
        total = (
            previous.integer(column) + added.integer(1)
            if whole
            else previous.real(column) + added.real(1)
        )
        fields.append(repr(total))
    return fields


def _split_line(path: Path, number: int, line: str) -> _Line:
    beyond = 0
    if "," in line:
        head, *rest = (word.strip() for word in line.split(","))
        width = FIELDS // 2 if "*" in head else FIELDS
        beyond = len(rest) if any(rest[width + 1 :]) else 0
        fields, mark = rest[:width], "".join(rest[width : width + 1])
    else:
        line = line.expandtabs(8)
        head = line[:8].strip()
        width = FIELDS // 2 if "*" in head else FIELDS
        size = 64 // width
        fields = [line[at : at + size].strip() for at in range(8, 72, size)]
        mark = line[72:80].strip()
    fields += [""] * (width - len(fields))
    if head.startswith("*("):
        raise MeshError(
            f"{path.name}:{number}: lines that repeat a continuation ({head}) are not read; write them out"
        )
    continued = not head or head[0] in "+*"
    return _Line(
        number,
        "" if continued else head.upper(),
        head[1:] if continued else "",
        fields,
        mark[1:],
        beyond,
    )


def _link_lines(path: Path, lines: Sequence[_Line]) -> dict[int, int]:
    """Return which line continues which.

    Raises:
        MeshError: A line continues none.
    """
    marks: dict[str, int] = {}
    for row, line in enumerate(lines):
        if line.mark:
            marks[line.mark] = -1 if line.mark in marks else row
    following: dict[int, int] = {}
    for row, line in enumerate(lines):
        if line.name:
            continue
        before = row - 1
        if line.label and (before < 0 or lines[before].mark != line.label):
            continued = marks.get(line.label, -1)
            before = before if continued in (-1, row) else continued
        if before < 0 or before in following:
            raise MeshError(f"{path.name}:{line.number}: there is no card that this line continues")
        following[before] = row
    return following


def read_cards(path: Path, text: str, known: Collection[str]) -> Iterator[Card]:
    """Yield the cards of the bulk data section, or of the whole file where none begins, with the
    lines that continue them, which follow, or stand elsewhere and are found by their mark.

    Args:
        known: Names of the cards that are read: they may not have more fields than a line holds.

    Raises:
        MeshError: A line refers to another file, is of no known format, or continues none.
    """
    every = list(_bulk_lines(path, text))
    following = _link_lines(path, every)
    for row, line in enumerate(every):
        if not line.name:
            continue
        fields, line_index, beyond = list(line.fields), row, line.beyond
        while line_index in following:
            line_index = following[line_index]
            if len(every[line_index].fields) == FIELDS and len(fields) % FIELDS:
                fields += [""] * (FIELDS // 2)
            fields += every[line_index].fields
            beyond = max(beyond, every[line_index].beyond)
        # meshio marks cells of second order so
        name = line.name.rstrip("*").rstrip("_ ")
        if name in known and beyond:
            raise MeshError(
                f"{path.name}:{line.number}: {name}: {beyond} fields behind the first; a line has {FIELDS} and a mark of "
                "continuation"
            )
        yield Card(f"{path.name}:{line.number}", name, fields)
