"""Numbers of a scene by their keys: finding them by pattern, reading them, and giving them other values."""

import copy
import fnmatch
import math
import re
from collections.abc import Mapping
from typing import Any

from headstock.scene.reading.findings import show_key
from headstock.scene.reading.positions import KeyPath
from headstock.scene.reading.units import DIMENSIONS, Dimension, Quantity, UnitError, parse_quantity, unit_of

NUMBER = Dimension("plain number", "", "0.3", math.inf)
_STEP = re.compile(r"([^.\[\]\s]+)((?:\[\d{1,5}\])*)")
_INDEX = re.compile(r"\[(\d+)\]")


def split_key(text: str) -> KeyPath:
    """``joints.pad_*.at[2]`` as ``("joints", "pad_*", "at", 2)``.

    Raises:
        ValueError: It is not a dotted key.
    """
    path: list[str | int] = []
    for step in text.split("."):
        match = _STEP.fullmatch(step)
        if match is None:
            raise ValueError(f"{text[:80]!r} is not a key; write it with dots and list places, such as joints.pad_*.at[2]")
        path.append(match[1])
        path += [int(index) for index in _INDEX.findall(match[2])]
    return tuple(path)


def find_keys(raw: Mapping[str, Any], pattern: KeyPath) -> list[KeyPath]:
    """Keys of a parsed scene that fit a pattern with ``*``, ``?`` and ``[abc]`` in its names, in the scene's order."""
    found: list[tuple[KeyPath, Any]] = [((), raw)]
    for part in pattern:
        found = [(path, value) for before, table in found for path, value in _step_down(before, table, part)]
    return [path for path, _ in found]


def read_number(raw: Mapping[str, Any], key: KeyPath) -> Quantity:
    """The number a key holds, in SI units.

    Raises:
        ValueError: It holds no number; the message says what it holds.
    """
    value: Any = raw
    for part in key:
        value = value[part]
    if isinstance(value, int | float) and not isinstance(value, bool):
        return Quantity(float(value), NUMBER)
    if isinstance(value, str):
        try:
            return parse_quantity(value, *DIMENSIONS)
        except UnitError as error:
            raise ValueError(
                f'{show_key(key)} is "{value[:80]}", which is no number with a unit, so it cannot be fitted'
            ) from error
    kind = "a list" if isinstance(value, list) else "a table"
    raise ValueError(f"{show_key(key)} is {kind}, not a number; name one of its entries")


def written_unit(raw: Mapping[str, Any], key: KeyPath) -> str:
    """The unit a scene writes a number in; empty for a plain number."""
    value: Any = raw
    for part in key:
        value = value[part]
    return unit_of(value) if isinstance(value, str) else ""


def write_number(value: float, unit: str, digits: int = 9) -> str | float:
    """A number in SI units as a scene writes it in a unit.

    Args:
        value: In SI units.
        unit: As a scene writes it; empty for a plain number.
        digits: Significant ones.
    """
    if not unit:
        return float(f"{value:.{digits}g}")
    return f"{value / parse_quantity(f'1 {unit}', *DIMENSIONS).value:.{digits}g} {unit}"


def replace_numbers(entry: Any, values: Mapping[KeyPath, Any]) -> Any:
    """A copy of a part of a parsed scene with other values at some keys below it."""
    result = copy.deepcopy(entry)
    for key, value in values.items():
        place = result
        for part in key[:-1]:
            place = place[part]
        place[key[-1]] = value
    return result


def _step_down(before: KeyPath, table: Any, part: str | int) -> list[tuple[KeyPath, Any]]:
    if isinstance(part, int):
        return [((*before, part), table[part])] if isinstance(table, list) and part < len(table) else []
    if not isinstance(table, dict):
        return []
    return [((*before, name), value) for name, value in table.items() if fnmatch.fnmatchcase(str(name), part)]
