"""What is wrong with a scene: every problem at once, each with its place, its line and what to
write.
"""

import difflib
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NoReturn

KeyPath = tuple[str | int, ...]  # of a value of a scene, with places in lists

MAX_SHOWN = 60
MAX_PROBLEMS = 200  # then it is raised without looking on
LARGEST_CHOICE = 500  # names that are all compared with a wrong one
_LINE = re.compile(r":(\d+)(?: \(.*\))?$", re.DOTALL)


@dataclass(frozen=True)
class Problem:
    """One thing that is wrong.

    Attributes:
        place: ``file:line``, or the override (``--set key=value``) it comes from.
        key: Dotted key path, empty for the file as a whole.
        source: The source line, empty where there is none.
        message: What is wrong and what to write.
    """

    place: str
    key: str
    source: str
    message: str

    @property
    def file(self) -> str:
        """File it was found in; an override where there is none."""
        return _LINE.sub("", self.place)

    @property
    def line(self) -> int | None:
        """Line of the file, from 1; None for the file as a whole."""
        match = _LINE.search(self.place)
        return None if match is None else int(match[1])

    @property
    def remedy(self) -> str:
        """Return what to write instead, as the message says it behind its first semicolon."""
        return self.message.partition("; ")[2]

    def __str__(self) -> str:
        head = f"{self.place}: {self.key}" if self.key else self.place
        source = f"\n    | {self.source}" if self.source else ""
        return f"{head}{source}\n    {self.message}"


class SceneError(Exception):
    """A scene that cannot be used; the command line prints every problem and exits with 2."""

    def __init__(self, problems: Iterable[Problem]) -> None:
        """Keep every problem; the text of the error shows them all."""
        self.problems = tuple(problems)
        count = len(self.problems)
        shown = "\n".join(str(problem) for problem in self.problems[:MAX_SHOWN])
        more = f"\n... and {count - MAX_SHOWN} more" if count > MAX_SHOWN else ""
        super().__init__(
            f"{shown}{more}\n{count} problem{'s' if count != 1 else ''}; nothing was computed"
        )


@dataclass(frozen=True)
class Origin:
    """Where the value at a key path came from: a line of the scene file or of one that it includes,
    and the override that put it there, if any.

    Attributes:
        line: From 1; None where it is in no file.
        order: How many overrides came before; where a table was replaced, what was known of its
            entries no longer counts.
    """

    line: int | None
    override: str | None = None
    file: str | None = None
    order: int = 0


@dataclass
class Findings:
    """Collects problems and warnings by key path while a scene is checked.

    Attributes:
        path: Scene file as the user wrote it.
        origins: Where each key path came from.
        written_at: Key path that an expanded one was written at: of an entry with several places.
        problems: Found so far, with the line they sort by.
        warnings: Found so far.
        assumptions: Values that the scene leaves to the catalogue, by the key that is written.
        on_request: Analyses that run only when they are named.
        deferred: What keeps such an analysis from running as the scene stands, by its name.
        included: Lines of the files that the scene includes, by their paths.
        overrides: How many keys were overridden.
    """

    path: str
    lines: tuple[str, ...] = ()
    origins: dict[KeyPath, Origin] = field(default_factory=dict)
    written_at: dict[KeyPath, KeyPath] = field(default_factory=dict)
    problems: list[tuple[int, Problem]] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    assumptions: dict[str, str] = field(default_factory=dict)
    on_request: frozenset[str] = frozenset()
    deferred: dict[str, list[Problem]] = field(default_factory=dict)
    included: dict[str, tuple[str, ...]] = field(default_factory=dict)
    overrides: int = 0
    _told: set[tuple[KeyPath, str]] = field(default_factory=set)

    def add(self, key: KeyPath, message: str) -> None:
        """Report a problem at a key path (or at the closest enclosing one that is written down);
        once for all places of a repeated entry.

        Raises:
            SceneError: There are so many that no more are looked for.
        """
        problem, written = self.describe(key, message), (self._written_key(key), message)
        if problem not in [other for _, other in self.problems[-MAX_SHOWN:]] and (
            written not in self._told
        ):
            self.problems.append((self.origin_of(key).line or 0, problem))
        if written[0] != key:
            self._told.add(written)
        if len(self.problems) >= MAX_PROBLEMS:
            self.raise_if_any()

    def _written_key(self, key: KeyPath) -> KeyPath:
        """The key that an expanded one was written at."""
        for length in range(len(key), 0, -1):
            if key[:length] in self.origins:
                break
            if key[:length] in self.written_at:
                return self._written_key(self.written_at[key[:length]] + key[length:])
        return key

    def add_for(self, analysis: str, key: KeyPath, message: str) -> None:
        """Report what an analysis lacks that a variant may bring; a problem only once the analysis
        is requested.

        Args:
            message: What is missing and what to write.
        """
        if analysis in self.on_request:
            self.deferred.setdefault(analysis, []).append(self.describe(key, message))
        else:
            self.add(key, message)

    def add_line(self, line: int | None, message: str, key: str = "") -> None:
        """Report a problem at a line of the file, or at the file as a whole.

        Args:
            line: From 1; None for the file as a whole.
            message: What is wrong and what to write.
            key: Dotted key, where one is known.
        """
        origin = Origin(line)
        self.problems.append(
            (line or 0, Problem(self._place(origin), key, self._source_line(origin), message))
        )

    def refuse(self, message: str, *, key: KeyPath = (), line: int | None = None) -> NoReturn:
        """Report what keeps a file from being looked at any further.

        Args:
            message: What is wrong and what to write.
            key: Of the file; empty for the file as a whole, or a line of it.

        Raises:
            SceneError: Always, with all that was found.
        """
        if key:
            self.add(key, message)
        else:
            self.add_line(line, message)
        self.raise_if_any()
        raise AssertionError("a problem was added")

    def warn(self, key: KeyPath, message: str) -> None:
        """Report something that is allowed but looks wrong."""
        self.warnings.append(f"{self.place_of(key)}: {show_key(key)}: {message}")

    def assume(self, key: KeyPath, what: str) -> None:
        """Note values that the scene leaves to the catalogue; once for all places of an entry that
        are alike.
        """
        if self.assumptions.setdefault(show_key(self._written_key(key)), what) != what:
            self.assumptions[show_key(key)] = what

    def check_name(
        self, key: KeyPath, name: str, names: Iterable[str], kind: str, what: str, more: str = ""
    ) -> None:
        """Report a name that is none of those there are.

        Args:
            kind: Word for one of them.
            what: Word for all of them, in the plural.
            more: What else could be written there.
        """
        if name not in (names := list(names)):
            hint = suggest_names(name, names, what=what)
            self.add(key, f"unknown {kind} {name[:80]!r}; {hint}{more}")

    def concern(self, *sections: str) -> bool:
        """Return whether a problem was found in one of the sections of the scene."""
        return any(problem.key.partition(".")[0] in sections for _, problem in self.problems)

    def origin_of(self, key: KeyPath) -> Origin:
        """Origin of a key path or of its closest ancestor that has one."""
        key = self._written_key(key)
        for path in (key, tuple(part for part in key if isinstance(part, str))):
            lengths = [path[:length] for length in range(len(path), 0, -1)]
            origins = [self.origins[part] for part in lengths if part in self.origins]
            if origins:
                return max(origins, key=lambda origin: origin.order)  # of equal ones the nearest
        return Origin(None)

    def place_of(self, key: KeyPath) -> str:
        """File and line of a key path, or of its closest ancestor that is written down."""
        return self._place(self.origin_of(key))

    def _source_line(self, origin: Origin) -> str:
        lines = self.lines if origin.file is None else self.included.get(origin.file, ())
        if origin.line is None or not 1 <= origin.line <= len(lines):
            return ""
        text = lines[origin.line - 1].strip()
        return text if len(text) <= 120 else f"{text[:117]}..."

    def raise_if_any(self) -> None:
        """Raise everything found so far.

        Raises:
            SceneError: At least one problem was found.
        """
        if self.problems:
            order = {file: number for number, file in enumerate(self.included)}
            raise SceneError(
                problem
                for _, problem in sorted(
                    self.problems, key=lambda item: (order.get(item[1].file, -1), item[0])
                )
            )

    def describe(self, key: KeyPath, message: str) -> Problem:
        """A problem at a key path (or at the closest enclosing one that is written down)."""
        origin = self.origin_of(key)
        return Problem(self._place(origin), show_key(key), self._source_line(origin), message)

    def _place(self, origin: Origin) -> str:
        file = self.path if origin.file is None else origin.file
        place = file if origin.line is None else f"{file}:{origin.line}"
        if origin.override is None:
            return place
        return origin.override if origin.line is None else f"{place} ({origin.override})"


def show_key(key: KeyPath) -> str:
    """Key path as it is written in a scene: ``joints.clamp.between[1]``."""
    text = ""
    for part in key:
        if isinstance(part, int):
            text += f"[{part}]"
        else:
            shown = part if part.isprintable() and len(part) <= 80 else repr(part[:80])
            text += f".{shown}" if text else shown
    return text


def suggest_names(wrong: object, names: Iterable[str], *, what: str) -> str:
    """Say which names exist and which one was probably meant: ``did you mean 'steel'? materials:
    cast_iron, steel``.

    Args:
        names: What could be.
        what: Word for them, in the plural.
    """
    known, text = sorted(names), str(wrong)[:80]
    alike = (
        known
        if len(known) <= LARGEST_CHOICE
        else [name for name in known if name[:2] == text[:2]][:LARGEST_CHOICE]
    )
    close = difflib.get_close_matches(text, alike, n=1, cutoff=0.6)
    listed = ", ".join(known[:20]) + (", ..." if len(known) > 20 else "")
    hint = f"did you mean {close[0]!r}? " if close else ""
    return f"{hint}{what}: {listed}" if known else f"there are no {what} in this scene"
