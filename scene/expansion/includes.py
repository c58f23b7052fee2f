"""Files that a scene includes: their entries become entries of the scene. A prefix is put before
their names, and before whatever refers to them inside the file.
"""

import re
from dataclasses import dataclass
from pathlib import Path

from headstock.scene.expansion.expansion import EACH, list_members, place_names, split_dotted
from headstock.scene.expansion.parameters import MACHINE_SECTIONS, PARAMETERS
from headstock.scene.reading.expressions import ExpressionError, is_expression, prefix_names
from headstock.scene.reading.files import (
    MAX_BYTES,
    TomlTable,
    TomlValue,
    read_scene,
    resolve_file,
    write_toml,
)
from headstock.scene.reading.findings import Findings, KeyPath, Origin
from headstock.scene.reading.open_values import OPEN, is_open
from headstock.scene.reading.units import quote_value
from headstock.scene.schema.scene import MAX_INCLUDED, IncludeTable
from headstock.scene.schema.validation import validate_tables

INCLUDE = "include"
MAX_INCLUDE_DEPTH = 5
VARIANT_SECTIONS = ("variants", "fits")  # of files without a prefix
MAX_INCLUDED_BYTES = 4 << 20
MAX_REFERENCE = 200  # characters
# section that a text names an entry of, by section and keys of the entry it stands in; an end or a
# face names its component before the dot
_REFERENCES = {
    ("components", "material"): "materials",
    ("joints", "between"): "components",
    ("joints", "screw", "floating_end"): "components",
    ("joints", "screw", "second_end"): "components",
    ("chains", "from"): "components",
    ("chains", "to"): "components",
    ("points", "tool"): "components",
    ("points", "work"): "components",
    ("axes", "joints"): "joints",
    ("axes", "joint"): "joints",
    ("axes", "moves"): "components",
    ("supports", "at"): "components",
    ("supports", "face"): "components",
    ("supports", "edge"): "components",
    ("loads", "at"): "components",
    ("loads", "face"): "components",
    ("loads", "component"): "components",
    ("loads", "joint"): "joints",
    ("probes", "component"): "components",
    ("sensors", "component"): "components",
    ("masses", "component"): "components",
    ("drives", "axis"): "axes",
    ("drives", "joint"): "joints",
    ("drives", "scale"): "points",
}
_FILES = (
    *(("components", "solid", kind) for kind in ("step", "mesh", "superelement")),
    *(("sensors", "file"), ("masses", "file")),
)
_NUMBER = re.compile(r"\{n\}|\{rail\}")


def read_with_includes(path: Path, findings: Findings) -> TomlTable:
    """Parse a scene file and the files it includes.

    Args:
        path: A ``.toml`` file; those it includes lie in its folder.
        findings: Receives lines and origins of the keys of all of them.

    Returns:
        The tables as if all were written in the scene.

    Raises:
        SceneError: A file cannot be read or included.
    """
    return _Reader(path.parent).read(path, findings, (path.resolve(),))


def scene_content(path: Path) -> bytes:
    """Return what a scene file says: its bytes, or with all it includes as one scene.

    Raises:
        SceneError: The file is too large, or one that it includes cannot be read.
        OSError: The file cannot be read.
    """
    with path.open("rb") as file:
        content = file.read(MAX_BYTES + 1)
    if len(content) <= MAX_BYTES and INCLUDE.encode() not in content:
        return content
    findings = Findings(str(path))
    merged = read_with_includes(path, findings)
    return write_toml(merged).encode() if findings.included else content


@dataclass
class _Reader:
    """Counts what a scene includes.

    Attributes:
        files: Included so far.
    """

    folder: Path
    files: int = 0
    size: int = 0

    def read(self, path: Path, findings: Findings, chain: tuple[Path, ...]) -> TomlTable:
        """Tables of a file of the chain of files that include each other, and of those below."""
        raw = read_scene(path, findings)
        if INCLUDE not in raw:
            return raw
        table = validate_tables({INCLUDE: raw.pop(INCLUDE)}, findings)
        findings.raise_if_any()
        for number, entry in enumerate([] if table is None else table.include):
            self._include(raw, entry, (INCLUDE, number, "file"), findings, chain)
        return raw

    def _include(
        self,
        raw: TomlTable,
        entry: IncludeTable,
        key: KeyPath,
        findings: Findings,
        chain: tuple[Path, ...],
    ) -> None:
        folder = chain[-1].parent.relative_to(self.folder.resolve())
        try:
            path = resolve_file(self.folder, (folder / entry.file).as_posix(), (".toml",))
        except ValueError as error:
            findings.refuse(str(error), key=key)
        self.files += 1
        if problem := self._refuse(path, chain):
            findings.refuse(problem, key=key)
        inner = Findings(str(Path(findings.path).parent / entry.file))
        tables = self.read(path, inner, (*chain, path))
        self.size += sum(len(line) + 1 for line in inner.lines)
        if self.size > MAX_INCLUDED_BYTES:
            findings.refuse(
                f"makes the included files larger than {MAX_INCLUDED_BYTES >> 20} MiB together; "
                "a scene holds no bulk data, refer to files instead",
                key=key,
            )
        _check_sections(tables, entry, inner)
        _merge(raw, tables, entry, findings, inner)

    def _refuse(self, path: Path, chain: tuple[Path, ...]) -> str:
        if path in chain:
            circle = " -> ".join(file.name for file in (*chain[chain.index(path) :], path))
            return f"includes itself: {circle}; remove one include"
        if len(chain) > MAX_INCLUDE_DEPTH:
            return f"is included more than {MAX_INCLUDE_DEPTH} deep; include it higher up"
        if self.files > MAX_INCLUDED:
            return f"is one of more than {MAX_INCLUDED} included files; put some into one"
        return ""


def _check_sections(tables: TomlTable, entry: IncludeTable, findings: Findings) -> None:
    # keys of variants are those of the scene, so they bear no prefix
    allowed = (*MACHINE_SECTIONS, *(() if entry.prefix else VARIANT_SECTIONS))
    for section, entries in tables.items():
        if section not in allowed:
            findings.add(
                (section,),
                f"{section[:80]!r} is not allowed in an included file; write it in the scene. "
                f"Included are: {', '.join(allowed)}",
            )
        elif not isinstance(entries, dict):
            findings.add(
                (section,), f"{quote_value(entries)} is not a table; write [{section}.name]"
            )
    findings.raise_if_any()


def _merge(
    raw: TomlTable, tables: TomlTable, entry: IncludeTable, findings: Findings, inner: Findings
) -> None:
    """Put the tables of an included file into those of the file that includes it.

    Args:
        raw: Of the including file; changed in place.
        findings: Of the including file; receives the origins.
    """
    names = _Names(tables, entry, inner)
    for section, entries in tables.items():
        present = raw.setdefault(section, {})
        if not isinstance(present, dict) or not isinstance(entries, dict):
            findings.add(
                (section,), f"{quote_value(present)} is not a table; write [{section}.name]"
            )
            continue
        for name, value in entries.items():
            full = f"{entry.prefix}{name}"
            if full in present:
                where = findings.place_of((section, full))
                inner.add(
                    (section, name),
                    f"is {section}.{full} of the scene, which {where} already has; rename one of them"
                    " or include the file with another prefix",
                )
            present[full] = names.renamed_entry(section, name, value)
    inner.raise_if_any()
    findings.raise_if_any()
    for key, origin in inner.origins.items():
        if key[0] == INCLUDE:
            continue
        full_key = (*key[:1], f"{entry.prefix}{key[1]}", *key[2:]) if len(key) > 1 else key
        findings.origins.setdefault(full_key, Origin(origin.line, file=origin.file or inner.path))
    findings.included |= inner.included | {inner.path: inner.lines}


class _Names:
    """Puts a prefix before what an included file names of its own."""

    def __init__(self, tables: TomlTable, entry: IncludeTable, findings: Findings) -> None:
        self._prefix, self._folder = entry.prefix, Path(entry.file).parent
        self._findings = findings
        self._own: dict[str, set[str]] = {}
        for section, entries in tables.items():
            table = entries if isinstance(entries, dict) else {}
            self._own[section] = {
                *table,
                *(f"{name}_{place}" for name in table for place in place_names(table[name])),
            }
        for section, names in list_members(tables).items():
            self._own.setdefault(section, set()).update(names)

    def renamed_entry(self, section: str, name: str, value: TomlValue) -> TomlValue:
        """An entry with the prefix before every name in it that is the file's own."""
        try:
            return self._renamed(value, (section,))
        except ExpressionError as error:
            self._findings.add((section, name), str(error))
            return value

    def _renamed(self, value: TomlValue, path: tuple[str, ...]) -> TomlValue:
        if isinstance(value, list):
            return [self._renamed(item, path) for item in value]
        if is_open(value):
            return value | {OPEN: self._renamed(value[OPEN], path)}
        if isinstance(value, dict):
            return {
                key: self._renamed_exceptions(item, path)
                if key == EACH
                else self._renamed(item, (*path, key))
                for key, item in value.items()
            }
        if not isinstance(value, str):
            return value
        if is_expression(value):
            return prefix_names(value, self._prefix, self._own.get(PARAMETERS, set()))
        if path in _FILES:
            return (self._folder / value).as_posix() if value else value
        return self._referred(value, _REFERENCES[path]) if path in _REFERENCES else value

    def _renamed_exceptions(self, each: TomlValue, path: tuple[str, ...]) -> TomlValue:
        """What is different at single places, by dotted keys."""
        if not isinstance(each, dict):
            return each
        return {
            place: {
                dotted: self._renamed(
                    item,
                    (*path, *(part for part in split_dotted(dotted) if isinstance(part, str))),
                )
                for dotted, item in table.items()
            }
            if isinstance(table, dict)
            else table
            for place, table in each.items()
        }

    def _referred(self, text: str, section: str) -> str:
        """A reference; one with ``{n}`` is the file's own where one of its places could be."""
        head, names = text.partition(".")[0], self._own.get(section, set())
        internal = head in names
        if not internal and len(head) <= MAX_REFERENCE and _NUMBER.search(head):
            first, *middle, last = (re.escape(part) for part in _NUMBER.split(head))
            # atomic, so that many numbers in a text cannot take exponential time
            wanted = re.compile(f"{first}{''.join(f'(?>.+?{part})' for part in middle)}.+{last}")
            internal = any(wanted.fullmatch(name) for name in names)
        return f"{self._prefix}{text}" if internal else text
