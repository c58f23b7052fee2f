"""What studies watch: names of numbers, such as ``frequency(pose=reference,mode=1)``, and paths into
``summary.json``: ``modal.frequencies_hz[0:6]``, ``static.tcp.compliance_um_per_kN[0][0]``, ``seconds``.

A path is a row of names and indices, nothing else: it is parsed here and never evaluated as a
program.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from headstock.scene.reading.names import NAMES, RESULT_KEYS

Step = str | int | slice
Watched = str | int | float | bool | None
# what a summary holds at its top, and what a study itself measures of a point
RESULT_NAMES = (
    "name", "status", "versions", "stages", "totals", "components", *NAMES, "static_poses", "probes", "mechanism", "accuracy", "model_errors",
    "interface_errors", "assumptions", "warnings", "failures",
)  # fmt: skip
MEASURED_NAMES = ("seconds", "cpu_seconds")
MAX_STEPS = 20
MAX_COLUMNS = 1000
POSE_NAME = "pose_name"
_TOKEN = re.compile(
    r'(?P<dot>\.)?(?:(?P<name>[A-Za-z_][\w-]*)|"(?P<quoted>[^"]+)")|\[(?P<index>-?\d{1,6})\]|\[(?P<low>-?\d{0,6}):(?P<high>-?\d{0,6})\]'
)
_NUMBER = re.compile(r"[a-z][a-z_*?]*(\(.*\))?")
_EXAMPLE = "modal.frequencies_hz[0:6]"


class WatchError(ValueError):
    """A path that cannot be read, or leads nowhere in a summary; the message says where it ends."""


@dataclass(frozen=True)
class _WatchPath:
    """A path into a summary: names, indices and slices in order; or a name of numbers.

    Attributes:
        steps: Of the path; the text itself where it is a name of numbers.
        names_numbers: It is one: a name, a kind, or a name with ``*`` and ``?``.
    """

    text: str
    steps: tuple[Step, ...]
    names_numbers: bool = False


def parse_watch(text: str) -> _WatchPath:
    """Read a path, or a name of numbers.

    Args:
        text: Name of numbers; or names joined by dots (in double quotes where they hold anything but letters, digits,
            ``_`` and ``-``), indices ``[2]`` or ``[-1]``, and ranges ``[0:6]``.

    Raises:
        WatchError: It is none, or begins with nothing that a summary holds.
    """
    roots = (*RESULT_NAMES, *MEASURED_NAMES)
    if _NUMBER.fullmatch(text) and text not in roots:
        return _WatchPath(text, (text,), names_numbers=True)
    steps: list[Step] = []
    position = 0
    while position < len(text):
        match = _TOKEN.match(text, position)
        if (
            match is None
            or len(steps) >= MAX_STEPS
            or ((match["index"] or match["low"] is not None) and not steps)
        ):
            raise WatchError(
                f"{text[:80]!r} cannot be read at {text[position : position + 20]!r}; write a path such as {_EXAMPLE}"
            )
        step = _read_step(match)
        if isinstance(step, str) and (match["dot"] is None) != (not steps):
            raise WatchError(
                f"{text[:80]!r} cannot be read at {text[position : position + 20]!r}: names are joined by dots"
            )
        steps.append(step)
        position = match.end()
    if not steps or steps[0] not in roots:
        raise WatchError(f"{text[:80]!r} is no result; results begin with {', '.join(roots)}")
    return _WatchPath(text, tuple(steps))


def read_watch(path: _WatchPath, summary: Mapping[str, object]) -> dict[str, Watched]:
    """Values at the end of a path, each under the path that leads to it alone.

    A key of results that has changed its name is found by the old one too, and labelled with the
    new. A name on the list of poses (``modal.frequencies_hz``) means the first pose, or the pose of that
    name (``modal.left``). What ends in a list gives one value per entry.

    Raises:
        WatchError: The path leads nowhere in this summary.
    """
    values: dict[str, Watched] = {}
    _follow(path.steps, summary, "", values)
    return values


def find_entry(steps: Sequence[Step], summary: Mapping[str, object]) -> object:
    """Return what a summary holds at the end of names and indices; None where they lead nowhere."""
    value: object = summary
    try:
        for step in steps:
            if isinstance(step, str):
                value = _entry(value, _present_name(value, step), "")
            elif isinstance(value, list):
                value = value[step]
            else:
                return None
    except (WatchError, IndexError):
        return None
    return value


def _read_step(match: re.Match[str]) -> Step:
    if match["name"] or match["quoted"]:
        return str(match["name"] or match["quoted"])
    if match["index"]:
        return int(match["index"])
    return slice(
        int(match["low"]) if match["low"] else None, int(match["high"]) if match["high"] else None
    )


def _follow(steps: tuple[Step, ...], value: object, label: str, values: dict[str, Watched]) -> None:
    if len(values) > MAX_COLUMNS:
        raise WatchError(f"{label} has more than {MAX_COLUMNS} values; name fewer")
    if not steps:
        if isinstance(value, dict):
            raise WatchError(f"{label} is a table; name one of {', '.join(list(value)[:20])}")
        if isinstance(value, list):
            _follow((slice(None),), value, label, values)
        elif value is None or isinstance(value, str | int | float):
            values[label] = value
        else:
            raise WatchError(f"{label} is neither number nor word")
        return
    step, rest = steps[0], steps[1:]
    if isinstance(step, str):
        name = _present_name(value, step)
        _follow(rest, _entry(value, name, label), f"{label}.{name}" if label else name, values)
    elif not isinstance(value, list):
        raise WatchError(f"{label} is no list")
    elif isinstance(step, int):
        if not -len(value) <= step < len(value):
            raise WatchError(f"{label} has {len(value)} entries, so there is no [{step}]")
        _follow(rest, value[step], f"{label}[{step}]", values)
    else:
        for index in range(*step.indices(len(value))):
            _follow(rest, value[index], f"{label}[{index}]", values)


def _present_name(value: object, name: str) -> str:
    """The name under which a table has a key that may have changed its name; as it is otherwise."""
    renamed = RESULT_KEYS["summary.json"].get(name)
    if renamed is not None and isinstance(value, dict) and name not in value and renamed in value:
        return renamed
    return name


def _entry(value: object, name: str, label: str) -> object:
    if isinstance(value, list):
        poses = [entry for entry in value if isinstance(entry, dict) and POSE_NAME in entry]
        named = [entry for entry in poses if entry[POSE_NAME] == name]
        if named:
            return named[0]
        value = poses[0] if poses else value
    if not isinstance(value, dict) or name not in value:
        names = (
            f"; there are: {', '.join(list(value)[:20])}"
            if isinstance(value, dict) and value
            else ""
        )
        raise WatchError(f"{label or 'the summary'} has no {name!r}{names}")
    return value[name]
