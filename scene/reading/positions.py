"""Line numbers of every key of a TOML text, which ``tomllib`` does not keep."""

import contextlib
import functools
import re
from dataclasses import dataclass, field

from headstock.scene.reading.findings import KeyPath

_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")
_SPACE = re.compile(r"[ \t]*")
_GAP = re.compile(r"(?:[ \t\r\n]|#[^\n]*)*")
_STRING = re.compile(
    r'"""(?:\\.|[^\\])*?"{3,5}|\'\'\'.*?\'{3,5}|"(?:\\.|[^"\\\n])*"|\'[^\'\n]*\'', re.DOTALL
)
_SCALAR = re.compile(r"[^,\]}\s#]+(?: [0-9][^,\]}\s#]*)?")
_ESCAPE = re.compile(r"\\(u[0-9a-fA-F]{4}|U[0-9a-fA-F]{8}|.)")
_ESCAPES = {"b": "\b", "t": "\t", "n": "\n", "f": "\f", "r": "\r", "e": "\x1b"}


class _ScanError(ValueError):
    """The text is not TOML at a line; ``tomllib`` says why."""


@dataclass
class _Scanner:
    """Walks a text once and records the line of each key; nothing is kept but positions."""

    text: str
    position: int = 0
    line: int = 1
    lines: dict[KeyPath, int] = field(default_factory=dict)
    repeated: list[tuple[KeyPath, int]] = field(default_factory=list)
    arrays: dict[KeyPath, int] = field(default_factory=dict)

    def skip(self, pattern: re.Pattern[str]) -> str:
        match = pattern.match(self.text, self.position)
        if match is None:
            raise _ScanError(f"line {self.line}")
        self.position = match.end()
        self.line += match[0].count("\n")
        return match[0]

    def peek(self, length: int = 1) -> str:
        return self.text[self.position : self.position + length]

    def take(self, token: str) -> None:
        if not self.text.startswith(token, self.position):
            raise _ScanError(f"line {self.line}")
        self.position += len(token)

    def read_key(self) -> KeyPath:
        parts: list[str] = []
        while True:
            self.skip(_SPACE)
            quoted = self.peek() in ('"', "'")
            part = self.skip(_STRING if quoted else _BARE_KEY)
            parts.append(_unquote(part) if quoted else part)
            self.skip(_SPACE)
            if self.peek() != ".":
                return tuple(parts)
            self.take(".")

    def note(self, path: KeyPath, start: int) -> None:
        if path in self.lines:
            self.repeated.append((path, start))
        for length in range(1, len(path) + 1):
            self.lines.setdefault(path[:length], start)

    def read_value(self, path: KeyPath) -> None:
        character = self.peek()
        if character == "[":
            self.read_array(path)
        elif character == "{":
            self.read_inline_table(path)
        elif character in ('"', "'"):
            self.skip(_STRING)
        else:
            self.skip(_SCALAR)

    def read_array(self, path: KeyPath) -> None:
        self.take("[")
        self.skip(_GAP)
        index = 0
        while self.peek() != "]":
            self.lines.setdefault((*path, index), self.line)
            self.read_value((*path, index))
            index += 1
            self.skip(_GAP)
            if self.peek() == ",":
                self.take(",")
                self.skip(_GAP)
        self.take("]")

    def read_inline_table(self, path: KeyPath) -> None:
        self.take("{")
        self.skip(_GAP)
        while self.peek() != "}":
            self.read_pair(path)
            self.skip(_GAP)
            if self.peek() == ",":
                self.take(",")
                self.skip(_GAP)
        self.take("}")

    def read_pair(self, prefix: KeyPath) -> None:
        start = self.line
        path = (*prefix, *self.read_key())
        self.note(path, start)
        self.take("=")
        self.skip(_SPACE)
        self.read_value(path)

    def read_header(self) -> KeyPath:
        start, is_array = self.line, self.peek(2) == "[["
        self.take("[[" if is_array else "[")
        path = self.resolve(self.read_key())
        self.take("]]" if is_array else "]")
        if is_array:
            index = self.arrays.get(path, -1) + 1
            self.arrays[path] = index
            self.lines.setdefault(path, start)
            path = (*path, index)
        self.note(path, start)
        return path

    def resolve(self, path: KeyPath) -> KeyPath:
        """Insert the current index behind every array of tables on the way."""
        resolved: KeyPath = ()
        for depth, part in enumerate(path):
            resolved = (*resolved, part)
            if resolved in self.arrays and depth < len(path) - 1:
                resolved = (*resolved, self.arrays[resolved])
        return resolved

    def scan(self) -> None:
        table: KeyPath = ()
        while True:
            self.skip(_GAP)
            if self.position >= len(self.text):
                return
            if self.peek() == "[":
                table = self.read_header()
            else:
                self.read_pair(table)


def find_lines(text: str) -> tuple[dict[KeyPath, int], list[tuple[KeyPath, int]]]:
    """Line number of every key and array item of a TOML text, as far as it can be read.

    Args:
        text: TOML; what ``tomllib`` refuses is followed up to the first place that is not
            understood.

    Returns:
        First line (from 1) by key path, and the key paths written again with the line of the
        repetition. A table header
        that only completes a table begun implicitly counts as a repetition here: ``tomllib``
            decides.
    """
    lines, repeated = _scan(text)
    return dict(lines), list(repeated)


@functools.lru_cache(maxsize=8)  # a study loads the same text for each of its points
def _scan(text: str) -> tuple[dict[KeyPath, int], list[tuple[KeyPath, int]]]:
    scanner = _Scanner(text)
    # positions up to the first error are right, and tomllib reports the error itself
    with contextlib.suppress(_ScanError, RecursionError):
        scanner.scan()
    return scanner.lines, scanner.repeated


def _unquote(token: str) -> str:
    if token.startswith("'"):
        return token[1:-1]

    def replace(match: re.Match[str]) -> str:
        code = match[1]
        if code[0] in "uU" and len(code) > 1:
            return chr(int(code[1:], 16))
        return _ESCAPES.get(code, code)

    return _ESCAPE.sub(replace, token[1:-1])
