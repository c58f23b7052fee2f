"""Parsed TOML as text again: sections with headers, short tables in one line, lines of at most 100
columns where that can be.
"""

import json
import re
from datetime import date, datetime, time

from headstock.scene.reading.files import TomlTable, TomlValue

MOST_COLUMNS = 100
_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")


def write_toml(table: TomlTable) -> str:
    """A whole file; what it is parsed to equals the table, and entries keep their order."""
    return "\n".join(_write_table(table, ())).lstrip("\n") + "\n"


def write_value(value: TomlValue) -> str:
    """A value as it stands behind ``=``, in one line."""
    if isinstance(value, dict):
        inner = ", ".join(f"{write_key(key)} = {write_value(item)}" for key, item in value.items())
        return f"{{ {inner} }}" if inner else "{}"
    if isinstance(value, list):
        return f"[{', '.join(write_value(item) for item in value)}]"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        # JSON leaves the delete character as it is, TOML does not know it
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, datetime | date | time):
        return value.isoformat()
    return repr(value)


def write_key(key: str) -> str:
    """A key, in quotes where it needs them."""
    return key if _BARE_KEY.fullmatch(key) else json.dumps(key, ensure_ascii=False)


def _write_table(table: TomlTable, path: tuple[str, ...]) -> list[str]:
    below = {key: value for key, value in table.items() if isinstance(value, dict)}
    # entries of one kind are written alike, or they would change their order
    entries = len(below) == len(table) and not all(map(_fits, below, below.values()))
    if path and not entries:
        below = {key: value for key, value in below.items() if not _fits(key, value)}
    lines = [_write_entry(key, value) for key, value in table.items() if key not in below]
    for key, value in below.items():
        inner = _write_table(value, (*path, key))
        header = f"[{'.'.join(write_key(part) for part in (*path, key))}]"
        has_own = not value or (bool(inner) and not inner[0].startswith("\n"))
        lines += [f"\n{header}", *inner] if has_own else inner
    return lines


def _fits(key: str, value: TomlValue) -> bool:
    return len(write_key(key)) + 3 + len(write_value(value)) <= MOST_COLUMNS


def _write_entry(key: str, value: TomlValue) -> str:
    if isinstance(value, list) and value and not _fits(key, value):
        items = "".join(f"    {write_value(item)},\n" for item in value)
        return f"{write_key(key)} = [\n{items}]"
    return f"{write_key(key)} = {write_value(value)}"
