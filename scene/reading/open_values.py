"""Open values: ``{ open = DEFAULT, reason = "..." }`` stands where a value is not decided yet. ``check``
lists them as questions; whatever computes needs answers, or leave to use the defaults.
"""

import copy
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NoReturn, TypeGuard

from headstock.scene.reading.files import TomlTable, TomlValue, write_value
from headstock.scene.reading.findings import Findings, KeyPath, SceneError, show_key

OPEN, REASON = "open", "reason"
ACCEPT = "accept_defaults"
# applied to a scene, or written by commands, in which these are values of other things
NOT_OPEN = ("variants", "fits")
_SHOWN_KEYS = 3


@dataclass(frozen=True)
class OpenValue:
    """A question: a value that is not decided, or several that are alike.

    Attributes:
        keys: Of all of them, in the scene's order.
        place: File and line of the first.
    """

    keys: tuple[KeyPath, ...]
    default: TomlValue
    reason: str
    place: str

    @property
    def others(self) -> str:
        """Return the keys but the first, of many the first ones and how many there are; empty for none."""
        more = len(self.keys) - _SHOWN_KEYS
        shown = ", ".join(show_key(key) for key in self.keys[1:_SHOWN_KEYS])
        return f"{shown} and {more} more" if more > 0 else shown

    def __str__(self) -> str:
        subject = ", ".join(filter(None, [show_key(self.keys[0]), self.others]))
        return f"{subject} = {write_value(self.default)}: {self.reason}"

    def as_table(self) -> dict[str, object]:
        """Return it as JSON has it."""
        named = {"keys": [show_key(key) for key in self.keys], "default": self.default}
        return named | {"reason": self.reason, "place": self.place}


def is_open(value: object) -> TypeGuard[TomlTable]:
    """Return whether a value of a scene is not decided yet."""
    return (
        isinstance(value, dict)
        and value.keys() == {OPEN, REASON}
        and (isinstance(value[REASON], str))
    )


def default_of[T](value: TomlValue | T) -> TomlValue | T:
    """Return a value, of an open one its default."""
    return value[OPEN] if is_open(value) else value


def enter_open(raw: TomlTable, path: KeyPath) -> KeyPath:
    """Return where an override of a key is kept: inside the default of an open value that has the key,
    which stays open; the path itself where it answers the value, or where nothing on the way is open.
    """
    entered: list[str | int] = []
    value: TomlValue | None = raw
    for part in path:
        if is_open(value):
            entered.append(OPEN)
            value = value[OPEN]
        entered.append(part)
        if isinstance(value, dict):
            value = value.get(str(part))
        else:
            inside = isinstance(value, list) and isinstance(part, int) and part < len(value)
            value = value[part] if inside else None  # type: ignore[index]
    return tuple(entered)


def close_values(raw: TomlTable, findings: Findings) -> tuple[TomlTable, tuple[OpenValue, ...]]:
    """Put defaults in the places of open values.

    Args:
        raw: As parsed, with includes, variants and overrides applied; left as it is.
        findings: Knows where keys are written.

    Returns:
        The tables without open values, and the questions, equal ones of entries of a section as one.
    """
    grouped: dict[str, list[tuple[KeyPath, TomlTable]]] = {}

    def close(value: TomlValue, key: KeyPath) -> TomlValue:
        if is_open(value):
            # the same key of another entry is the same question
            alike = repr((key[0], *key[2:], value[OPEN], value[REASON]))
            grouped.setdefault(alike, []).append((key, value))
            return close(copy.deepcopy(value[OPEN]), key)
        if isinstance(value, dict):
            return {name: close(item, (*key, name)) for name, item in value.items()}
        if isinstance(value, list):
            return [close(item, (*key, index)) for index, item in enumerate(value)]
        return value

    closed = {
        section: value if section in NOT_OPEN else close(value, (section,))
        for section, value in raw.items()
    }
    questions = tuple(
        OpenValue(
            tuple(key for key, _ in members),
            members[0][1][OPEN],
            str(members[0][1][REASON]),
            findings.place_of(members[0][0]),
        )
        for members in grouped.values()
    )
    return closed, questions


def refuse_open(questions: Sequence[OpenValue], findings: Findings) -> NoReturn:
    """Report what has to be decided before anything is computed.

    Raises:
        SceneError: Always, with every question.
    """
    count = sum(len(question.keys) for question in questions)
    findings.add_line(
        None,
        f"{'1 value is' if count == 1 else f'{count} values are'} open; write each in its place or with "
        "--set KEY=VALUE, or use the defaults with --accept-defaults",
    )
    listed = [
        findings.describe(
            question.keys[0],
            f"is open{question.others and f', as {question.others}'}: {question.reason}; "
            f"default: {write_value(question.default)}",
        )
        for question in questions
    ]
    raise SceneError([*(problem for _, problem in findings.problems), *listed])
