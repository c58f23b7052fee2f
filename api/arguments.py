"""Arguments of public functions, read before anything is computed: what is of the wrong kind is a
problem like one of a scene.
"""

import contextlib
import dataclasses
import os
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from headstock.scene.reading.findings import Problem, SceneError

MOST_SHOWN = 60


def refuse(function: str, argument: str, message: str) -> SceneError:
    """Make the error of an argument.

    Args:
        message: What is wrong and what to write.
    """
    return SceneError([Problem(f"hs.{function}", argument, "", message)])


def read_path_argument(value: object, function: str, argument: str) -> Path:
    """Return a path that was given as text or as a path."""
    text = os.fspath(value) if isinstance(value, str | os.PathLike) else ""
    if text and isinstance(text, str):
        return Path(text)
    raise refuse(function, argument, f"{_show(value)} is no path; write a text or a pathlib.Path")


def read_name(value: object, function: str, argument: str) -> str:
    """Return a name."""
    if isinstance(value, str):
        return value
    raise refuse(function, argument, f"{_show(value)} is no name; write a text")


def read_names(value: object, function: str, argument: str) -> tuple[str, ...]:
    """Return names; one text is one name, None is none."""
    names = (value,) if isinstance(value, str) else () if value is None else value
    if isinstance(names, Iterable) and not isinstance(names, bytes | Mapping):
        listed = tuple(names)
        if all(isinstance(name, str) for name in listed):
            return listed
    raise refuse(function, argument, f'{_show(value)} is no list of names; write ["..."]')


def read_keys(value: object, function: str, argument: str) -> Mapping[str, object]:
    """Return dotted keys with what belongs to each; None is none."""
    if value is None:
        return {}
    if isinstance(value, Mapping) and all(isinstance(key, str) for key in value):
        return value
    raise refuse(
        function,
        argument,
        f'{_show(value)} is no table of dotted keys; write {{"components.NAME.mass": ...}}',
    )


def check_call(value: object, function: str) -> None:
    """Refuse what cannot be called with progress."""
    if not callable(value):
        raise refuse(function, "progress", f"{_show(value)} cannot be called; write a function")


@contextlib.contextmanager
def naming_arguments(function: str, section: str) -> Iterator[None]:
    """Name arguments of a function where problems name the keys of the table they describe.

    Args:
        section: Dotted key of that table.
    """
    try:
        yield
    except SceneError as error:
        raise SceneError(
            dataclasses.replace(
                problem,
                place=f"hs.{function}",
                key=problem.key.removeprefix(section).removeprefix("."),
            )
            if problem.key.startswith(section)
            else problem
            for problem in error.problems
        ) from None


def _show(value: object) -> str:
    shown = repr(value)
    return shown if len(shown) <= MOST_SHOWN else f"{shown[: MOST_SHOWN - 3]}..."
