"""Numbers of a scene by their keys: finding them by pattern, reading them, and giving them other
values.
"""

import contextlib
import fnmatch
import math
import re
from collections.abc import Mapping

from headstock.scene.reading.files import TomlTable, TomlValue
from headstock.scene.reading.findings import KeyPath, show_key
from headstock.scene.reading.units import (
    DIMENSIONS,
    Dimension,
    Quantity,
    UnitError,
    parse_quantity,
    unit_of,
)

type ReadValue = TomlValue | Quantity | list[ReadValue] | dict[str, ReadValue]

NUMBER = Dimension("plain number", "", "0.3", math.inf)
_STEP = re.compile(r"([^.\[\]\s]+)((?:\[\d{1,5}\])*)")
# as values that are calculated have them
_BASE_UNITS = re.compile(r"(?:kg|m|s|rad)(?:\^-?\d+)?(?:\*(?:kg|m|s|rad)(?:\^-?\d+)?)*")
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
            raise ValueError(
                f"{text[:80]!r} is not a key; write it with dots and list places, such as joints.pad_*.at[2]"
            )
        path.append(match[1])
        path += [int(index) for index in _INDEX.findall(match[2])]
    return tuple(path)


def find_keys(raw: TomlTable, pattern: KeyPath) -> list[KeyPath]:
    """Keys of a parsed scene that fit a pattern with ``*``, ``?`` and ``[abc]`` in its names, in
    the scene's order.
    """
    entries: list[tuple[KeyPath, TomlValue]] = [((), raw)]
    for part in pattern:
        entries = [
            (path, value)
            for before, table in entries
            for path, value in _step_down(before, table, part)
        ]
    return [path for path, _ in entries]


def value_at(raw: TomlTable, key: KeyPath) -> TomlValue:
    """Return what a parsed scene holds at a key.

    Raises:
        KeyError: There is no such key.
    """
    value: TomlValue = raw
    for part in key:
        if isinstance(value, list) and isinstance(part, int) and part < len(value):
            value = value[part]
        elif isinstance(value, dict) and part in value:
            value = value[str(part)]
        else:
            raise KeyError(show_key(key))
    return value


def read_entries(raw: TomlTable, section: str) -> dict[str, TomlTable]:
    """Tables of the entries of a section of a parsed scene, by name."""
    entries = raw.get(section)
    if isinstance(entries, dict):
        return {name: entry for name, entry in entries.items() if isinstance(entry, dict)}
    return {}


def read_number(raw: TomlTable, key: KeyPath) -> Quantity:
    """The number a key holds, in SI units.

    Raises:
        ValueError: It holds no number; the message says what it holds.
    """
    value = value_at(raw, key)
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


def written_unit(raw: TomlTable, key: KeyPath, written: TomlTable) -> str:
    """The unit a scene writes a number in; the usual one of what it calculates, empty for a plain
    number.
    """
    value = value_at(raw, key)
    if not isinstance(value, str):
        return ""
    with contextlib.suppress(KeyError):
        if value_at(written, key) == value:
            return unit_of(value)
    unit = unit_of(value)
    calculated = _BASE_UNITS.fullmatch(unit) is not None
    return unit_of(read_number(raw, key).dimension.example) if calculated else unit


def write_number(value: float, unit: str, digits: int = 9) -> str | float:
    """A number in SI units as a scene writes it in a unit.

    Args:
        unit: As a scene writes it; empty for a plain number.
    """
    if not unit:
        return float(f"{value:.{digits}g}")
    return f"{value / parse_quantity(f'1 {unit}', *DIMENSIONS).value:.{digits}g} {unit}"


def write_size(size: float) -> str:
    """Return a length [m] as a scene has it, to three digits."""
    return f"{float(f'{1e3 * size:.3g}'):g} mm"


def replace_numbers(entry: TomlValue, values: Mapping[KeyPath, float | Quantity]) -> ReadValue:
    """A copy of a part of a parsed scene with other numbers at some keys below it."""
    if () in values:
        return values[()]
    if isinstance(entry, dict):
        return {name: replace_numbers(value, _below(name, values)) for name, value in entry.items()}
    if isinstance(entry, list):
        return [replace_numbers(value, _below(index, values)) for index, value in enumerate(entry)]
    return entry


def _below(
    part: str | int, values: Mapping[KeyPath, float | Quantity]
) -> dict[KeyPath, float | Quantity]:
    return {key[1:]: value for key, value in values.items() if key[0] == part}


def _step_down(
    before: KeyPath, table: TomlValue, part: str | int
) -> list[tuple[KeyPath, TomlValue]]:
    if isinstance(part, int):
        if isinstance(table, list) and part < len(table):
            return [((*before, part), table[part])]
        return []
    if not isinstance(table, dict):
        return []
    return [
        ((*before, name), value) for name, value in table.items() if fnmatch.fnmatchcase(name, part)
    ]
