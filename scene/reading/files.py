"""Scene files: read within bounds, written as text again, and finding the files they refer to."""

import json
import os
import re
import stat
import tomllib
from datetime import date, datetime, time
from pathlib import Path
from typing import Literal

from headstock.meshing.formats import MESH_SUFFIXES
from headstock.meshing.process.strangers import PART, FileKind
from headstock.scene.reading.findings import Findings, KeyPath, Origin
from headstock.scene.reading.positions import find_lines

type TomlValue = str | int | float | bool | datetime | date | time | list[TomlValue] | TomlTable
type TomlTable = dict[str, TomlValue]

MAX_BYTES = 1 << 20
MAX_DEPTH = 50
MAX_ENTRIES = 20_000
CHARACTERS_OF_ENTRY = 100  # a text counts as one entry for each of these
CHARACTERS_OF_PLACE = 64  # of a name that is filled in for {n}
TextKind = Literal["scene", "target"]
# tables that only one kind has, and what to say where the other one is given
OWN_TABLE: dict[TextKind, str] = {"scene": "components", "target": "cases"}
SWAPPED: dict[TextKind, str] = {
    "scene": "is a target file, not a scene: headstock identify SCENE TARGETS takes it in the second place",
    "target": "is a scene, not a target file: headstock identify SCENE TARGETS takes the scene in the first place",
}
PART_SUFFIXES = (".step", ".stp", *MESH_SUFFIXES)
UFF_SUFFIXES = (".uff", ".unv", ".uf")
TEST_DATA_SUFFIXES = (*UFF_SUFFIXES, ".csv", ".mat", ".frf", ".txt")
_POSITION = " (at "
# tomllib needs time quadratic in the length of a dotted key, so long ones are refused before it
# sees them
_DEEP_KEY = re.compile(
    rf"""(?<![\w.-])(?>(?>[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+){{{MAX_DEPTH},}}"""
)


def read_scene(path: Path, findings: Findings, kind: TextKind = "scene") -> TomlTable:
    """Parse a scene or target file; what keeps it from being read is raised at once, since nothing
    else can be said then.

    Args:
        path: A regular ``.toml`` file of at most 1 MiB.
        findings: Receives lines and origins of the keys.
        kind: What it should be.

    Returns:
        The parsed tables.

    Raises:
        SceneError: Not such a file, not UTF-8, not TOML, a key twice, nested too deeply, or the
            other kind of file.
    """
    text = _read_text(path, findings, kind)
    findings.lines = tuple(text.replace("\r\n", "\n").split("\n"))
    if _DEEP_KEY.search(text):
        findings.refuse(
            f"keys are nested more than {MAX_DEPTH} deep; a scene needs no more than ten levels"
        )
    if sum(text.count(sign) for sign in "=,[") > MAX_ENTRIES:
        findings.refuse(
            f"holds more than {MAX_ENTRIES} entries; a scene holds no bulk data, refer to files instead"
        )
    positions, repeated = find_lines(text.replace("\r\n", "\n"))
    try:
        raw: TomlTable = tomllib.loads(text)
    except RecursionError:
        findings.add_line(
            None,
            f"values are nested more than {MAX_DEPTH} deep; a scene needs no more than ten levels",
        )
    except (tomllib.TOMLDecodeError, ValueError) as error:
        _report_syntax(str(error), positions, repeated, findings)
    findings.raise_if_any()
    if nesting_depth(raw) > MAX_DEPTH:
        findings.refuse(
            f"values are nested more than {MAX_DEPTH} deep; a scene needs no more than ten levels"
        )
    if OWN_TABLE["scene" if kind == "target" else "target"] in raw and OWN_TABLE[kind] not in raw:
        findings.refuse(SWAPPED[kind])
    findings.origins = {key: Origin(line) for key, line in positions.items()}
    return raw


def resolve_file(folder: Path, text: str, suffixes: tuple[str, ...], kind: FileKind = PART) -> Path:
    """Find a file that a scene refers to, inside the scene's own folder.

    Args:
        text: Relative path as written.
        suffixes: Endings that are accepted, lower case.
        kind: How large it may be.

    Returns:
        The absolute path with every link resolved.

    Raises:
        ValueError: The path leaves the folder or is no regular file of an accepted kind and size; the
            message says what to write.
    """
    shown = text if len(text) <= 100 else f"{text[:97]}..."
    if (
        "\\" in text
        or ":" in text
        or text.startswith("~")
        or Path(text).is_absolute()
        or not text.strip()
    ):
        raise ValueError(
            f"{shown!r} is not a path inside the scene's folder; write a relative path with / such as parts/bed.step"
        )
    if os.path.normpath(text).split("/")[0] == "..":
        # also where it comes back: the same name beside a copy of the scene would be another file
        raise ValueError(
            f"{shown!r} lies outside the scene's folder, or goes through another one; write the path from the scene's folder"
            " on, or copy the file next to the scene"
        )
    if Path(text).suffix.lower() == ".geo":
        raise ValueError(
            f"{shown!r} is a gmsh script, which can run commands; mesh it yourself and give the .msh"
        )
    if Path(text).suffix.lower() not in suffixes:
        raise ValueError(f"{shown!r} does not end in {' or '.join(suffixes)}")
    root = folder.resolve()
    try:
        path = (root / text).resolve()
        exists, regular = path.exists(), path.is_file()
    except OSError as error:
        raise ValueError(f"{shown!r} cannot be looked up: {error.strerror}") from error
    if not path.is_relative_to(root):
        raise ValueError(
            f"{shown!r} lies outside the scene's folder; copy the file next to the scene"
        )
    if not exists:
        raise ValueError(f"{shown!r} does not exist beside the scene")
    if not regular:
        raise ValueError(f"{shown!r} is not a regular file")
    if refusal := kind.refusal(repr(shown), path.stat().st_size):
        raise ValueError(refusal)
    return path


def _read_text(path: Path, findings: Findings, kind: TextKind) -> str:
    if path.suffix.lower() != ".toml":
        findings.refuse(_explain_ending(path.suffix.lower(), kind))
    try:
        # non-blocking, so that a pipe put in place of the file cannot hang the reader
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    except OSError as error:
        findings.refuse(f"cannot be read: {error.strerror}")
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        findings.refuse("is not a regular file")
    with os.fdopen(descriptor, "rb") as stream:
        data = stream.read(MAX_BYTES + 1)
    if len(data) > MAX_BYTES:
        findings.refuse("is larger than 1 MiB; a scene holds no bulk data, refer to files instead")
    try:
        text = data.decode("utf-8")
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1
        findings.refuse(f"is not UTF-8 text (line {line}); save it as UTF-8")
    if text.startswith("\ufeff"):
        findings.refuse("begins with a byte-order mark; save it as UTF-8 without BOM", line=1)
    return text


def _explain_ending(suffix: str, kind: TextKind) -> str:
    """What to do with a file that is no TOML."""
    if kind == "target":
        text = "targets are read from a .toml file (docs/identification.md)"
        values = "frequencies (frequencies = [...]) and shapes (modes = [{ frequency, vectors }])"
        source = "a UFF file" if suffix in UFF_SUFFIXES else "measurements"
        return f"{text}; write the {values} of {source} into [cases.NAME] of one"
    if suffix in PART_SUFFIXES:
        return "a scene file ends in .toml; `headstock new FOLDER --part FILE` writes one around a part"
    return "a scene file ends in .toml"


def _report_syntax(
    message: str,
    positions: dict[KeyPath, int],
    repeated: list[tuple[KeyPath, int]],
    findings: Findings,
) -> None:
    reason, _, position = message.partition(_POSITION)
    digits = [
        part for part in position.replace(",", " ").replace(")", " ").split() if part.isdecimal()
    ]
    line = int(digits[0]) if digits else len(findings.lines)
    twice = "Cannot overwrite" in reason or "twice" in reason or "Duplicate" in reason
    # tomllib stops behind a value, which may be the line after the key
    near = [(key, at) for key, at in repeated if line - 1 <= at <= line] if twice else []
    if near:
        key, at = near[-1]
        name = ".".join(str(part) for part in key)
        findings.add_line(
            at, f"duplicate key: already written in line {positions[key]}; keep one of them", name
        )
    else:
        findings.add_line(line, f"not valid TOML: {reason[:200]}")


def count_entries(value: TomlValue) -> int:
    """Entries that a value of a scene adds to it: its own and those in it, long texts as several,
    with names filled in.
    """
    if isinstance(value, dict | list):
        inner = value.values() if isinstance(value, dict) else value
        return 1 + sum(map(count_entries, inner))
    if not isinstance(value, str):
        return 1
    return 1 + (len(value) + CHARACTERS_OF_PLACE * value.count("{")) // CHARACTERS_OF_ENTRY


def nesting_depth(raw: TomlValue) -> int:
    """Nesting depth of parsed TOML, without recursion; at most one level too deep."""
    depth = 0
    level: list[TomlValue] = [raw]
    while level:
        depth += 1
        if depth > MAX_DEPTH + 1:
            break
        inner = [
            list(item.values()) if isinstance(item, dict) else item
            for item in level
            if isinstance(item, dict | list)
        ]
        level = [value for values in inner for value in values]
    return depth


MOST_COLUMNS = 100
_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")


def write_toml(table: TomlTable) -> str:
    """A whole file; what it is parsed to equals the table, and entries keep their order."""
    return "\n".join(_write_table(table, ())).lstrip("\n") + "\n"


def write_value(value: TomlValue) -> str:
    """A value as it stands behind ``=``, in one line."""
    if isinstance(value, dict):
        inner = ", ".join(f"{_write_key(key)} = {write_value(item)}" for key, item in value.items())
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


def _write_key(key: str) -> str:
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
        header = f"[{'.'.join(_write_key(part) for part in (*path, key))}]"
        has_own = not value or (bool(inner) and not inner[0].startswith("\n"))
        lines += [f"\n{header}", *inner] if has_own else inner
    return lines


def _fits(key: str, value: TomlValue) -> bool:
    return len(_write_key(key)) + 3 + len(write_value(value)) <= MOST_COLUMNS


def _write_entry(key: str, value: TomlValue) -> str:
    if isinstance(value, list) and value and not _fits(key, value):
        items = "".join(f"    {write_value(item)},\n" for item in value)
        return f"{_write_key(key)} = [\n{items}]"
    return f"{_write_key(key)} = {write_value(value)}"
