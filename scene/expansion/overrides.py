"""Overrides of a parsed scene: variants written in the scene and ``key=value`` given on the command
line.
"""

import copy
import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import replace

from headstock.scene.expansion.expansion import (
    EACH,
    is_repeated,
    replaced,
    split_dotted,
    written_entry,
)
from headstock.scene.expansion.parameters import MACHINE_SECTIONS, PARAMETERS
from headstock.scene.reading.files import MAX_DEPTH, TomlTable, TomlValue
from headstock.scene.reading.findings import (
    Findings,
    KeyPath,
    Origin,
    Problem,
    show_key,
    suggest_names,
)
from headstock.scene.reading.open_values import default_of, enter_open, is_open
from headstock.scene.schema.validation import is_list, known_keys, unknown_key

ENTRY_SECTIONS = frozenset({*MACHINE_SECTIONS, "poses", "sweeps", "studies", "exports", "variants"})
MAX_OVERRIDES = 1000
AS_WRITTEN = "as written"  # the scene without any variant, where variants are listed
VARIANT_JOINER = "+"
_LIST_PLACE = re.compile(r"\[(\d{1,5})\]")


def apply_variant(raw: TomlTable, name: str | None, findings: Findings) -> TomlTable:
    """Apply a variant to a copy of a parsed scene, and check that the keys of every other variant
    exist too.

    ``calibrated+segmented+R`` applies three variants, the later over the earlier.

    Args:
        name: One variant, or several joined by ``+``; None for none.
    """
    variants = raw.get("variants", {})
    result = dict(raw)
    if not isinstance(variants, dict):
        if name is not None:
            findings.add(("variants",), f"variant {name!r} cannot be used: variants is not a table")
        return result
    chosen = split_variant(name)
    for unknown in [part for part in chosen if part not in variants]:
        findings.add_line(
            None,
            f"unknown variant {unknown!r}; {suggest_names(unknown, variants, what='variants')}",
            "variants",
        )
    for part in chosen:
        _apply_overrides(result, part, variants.get(part), findings, record=True)
    for other in variants:
        if other not in chosen:
            _apply_overrides(dict(raw), other, variants[other], findings, record=False)
    return result


def split_variant(name: str | None) -> list[str]:
    """Variants that a choice such as ``calibrated+segmented+R`` applies; none for None."""
    return [] if name is None else name.split(VARIANT_JOINER)


def _apply_overrides(
    raw: TomlTable, name: str, overrides: TomlValue | None, findings: Findings, *, record: bool
) -> None:
    if not isinstance(overrides, dict):
        return  # unknown, or the schema reports it
    for path, value, source in _flatten(overrides, ()):
        line = findings.origin_of(("variants", name, *source)).line
        _override(raw, path, value, Origin(line, f"variant {name}"), findings, record=record)


def apply_settings(raw: TomlTable, settings: Sequence[str], findings: Findings) -> None:
    """Apply ``key=value`` settings in order to a parsed scene; the value is TOML, or text if it is
    not.

    Args:
        raw: The scene as parsed; changed in place.
        settings: ``key=value`` with dotted keys.
    """
    for setting in settings[:MAX_OVERRIDES]:
        key, equals, text = setting.partition("=")
        path = _split_key(key)
        label = f"--set {setting}"
        if not equals or "" in path:
            findings.problems.append(_unreadable_setting(label))
            continue
        _override(raw, path, _read_value(text), Origin(None, label), findings, record=True)


def apply_values(
    raw: TomlTable, values: Mapping[str, TomlValue], findings: Findings, source: str = "study"
) -> None:
    """Set dotted keys of a parsed scene to values as TOML parses them: the point of a study.

    Args:
        raw: The scene as parsed; changed in place.
        source: What has the values, in messages.
    """
    for key, value in values.items():
        _override(
            raw,
            _split_key(key),
            copy.deepcopy(value),
            Origin(None, f"{source}: {key} = {value}"),
            findings,
            record=True,
        )


def path_exists(raw: TomlTable, key: str) -> str:
    """Say why a dotted key cannot be set in a scene; empty when it can."""
    probe = dict(raw)
    findings = Findings("")
    _override(probe, _split_key(key), "", Origin(None), findings, record=False)
    return findings.problems[0][1].message if findings.problems else ""


def _unreadable_setting(label: str) -> tuple[int, Problem]:
    findings = Findings(label)
    findings.add_line(
        None, "write key=value with a dotted key, such as components.column.fidelity=rigid"
    )
    return findings.problems[0]


def _split_key(key: str) -> KeyPath:
    """``joints.pad_1.at[2]`` (or ``joints.pad_1.at.2``) as a path."""
    parts = _LIST_PLACE.sub(r".\1", key.strip()).split(".")
    return tuple(int(part) if part.isdecimal() and len(part) < 6 else part for part in parts)


def _read_value(text: str) -> TomlValue:
    try:
        parsed: TomlTable = tomllib.loads(f"value = {text.strip()}")
    except (tomllib.TOMLDecodeError, RecursionError, ValueError):
        return text.strip()
    return parsed["value"] if list(parsed) == ["value"] else text.strip()


def _flatten(table: TomlTable, prefix: KeyPath) -> list[tuple[KeyPath, TomlValue, KeyPath]]:
    """Target path, value and source path of each override; a plain table is walked into, a dotted
    key is a target.
    """
    result: list[tuple[KeyPath, TomlValue, KeyPath]] = []
    for key, value in table.items():
        table_inside = isinstance(value, dict) and value and not is_open(value)
        if isinstance(value, dict) and table_inside and "." not in key and len(prefix) < 8:
            result.extend(_flatten(value, (*prefix, key)))
        else:
            path = (*(part for step in prefix for part in _split_key(str(step))), *_split_key(key))
            result.append((path, value, (*prefix, key)))
    return result


def _override(
    raw: TomlTable,
    path: KeyPath,
    value: TomlValue,
    origin: Origin,
    findings: Findings,
    *,
    record: bool,
) -> None:
    problem = _find_obstacle(_one_place(raw, path), path)
    if problem:
        label = Findings(findings.path, findings.lines, {path: origin})
        label.add(path, problem)
        findings.problems.extend(label.problems)
        return
    section, written = str(path[0]), _written_path(raw, path)
    raw[section] = replaced(raw.get(section, {}), enter_open(raw, written)[1:], value)
    if written == path:
        _forget_exceptions(raw, path)
    if record:
        findings.overrides += 1
        findings.origins[path] = replace(origin, order=findings.overrides)


def _group_of(raw: TomlTable, path: KeyPath) -> tuple[KeyPath, TomlTable, KeyPath] | None:
    """Key and table of the entries among which a path names a repeated entry or one of its places,
    and the rest of the path from its name on.
    """
    for depth in (1, 3):
        if path[0] not in ("joints", "components") or (
            depth == 3 and (path[0] != "components" or path[2:3] != ("interfaces",))
        ):
            continue
        table: TomlValue = raw
        for part in path[:depth]:
            table = table.get(str(part), {}) if isinstance(table, dict) else {}
        if not isinstance(table, dict) or len(path) <= depth:
            continue
        name = str(path[depth])
        if is_repeated(table.get(name)) or written_entry(table, name) is not None:
            return path[:depth], table, path[depth:]
    return None


def _written_path(raw: TomlTable, path: KeyPath) -> KeyPath:
    """Where an override is kept: that of one place of a repeated entry with this entry."""
    group = _group_of(raw, path)
    member = None if group is None else written_entry(group[1], str(group[2][0]))
    if group is None or member is None or len(group[2]) < 2:
        return path
    dotted = ".".join(str(part) for part in group[2][1:])
    return (*group[0], member[0], EACH, member[1], dotted)


def _one_place(raw: TomlTable, path: KeyPath) -> TomlTable:
    """The scene with the repeated entry that a path names one place of under that name."""
    group = _group_of(raw, path)
    member = None if group is None else written_entry(group[1], str(group[2][0]))
    if group is None or member is None:
        return raw
    table = replaced(raw, (*group[0], str(group[2][0])), group[1][member[0]])
    return table if isinstance(table, dict) else raw


def _forget_exceptions(raw: TomlTable, path: KeyPath) -> None:
    """What single places had of their own at a path that is now set for all of them."""
    group = _group_of(raw, path)
    if group is None or not is_repeated(entry := group[1].get(str(group[2][0]))):
        return
    exceptions = entry.get(EACH) if isinstance(entry, dict) else None
    rest = group[2][1:]
    if isinstance(exceptions, dict) and rest:
        left = {
            number: {
                dotted: value
                for dotted, value in table.items()
                if split_dotted(dotted)[: len(rest)] != rest
            }
            for number, table in exceptions.items()
            if isinstance(table, dict)
        }
        raw[str(path[0])] = replaced(
            raw[str(path[0])], (*group[0][1:], str(group[2][0]), EACH), dict(left)
        )


def _find_obstacle(raw: TomlTable, path: KeyPath) -> str:
    """Why nothing can be set at a path: an unknown section, entry or key, or a value in the way."""
    sections = known_keys(()) or []
    if len(path) > MAX_DEPTH:
        return f"cannot set a key of {len(path)} parts; a scene needs no more than ten"
    fault = "" if path[0] in sections else suggest_names(path[0], sections, what="sections")
    table: TomlValue = raw
    for depth, part in enumerate(path):
        table = default_of(table)
        if fault:
            return f"cannot set {show_key(path)}: {fault}"
        if isinstance(table, list):
            if not isinstance(part, int) or part >= len(table):
                fault = f"{show_key(path[:depth])} has entries 0 to {len(table) - 1}"
            else:
                table = table[part]
        elif not isinstance(table, dict):
            fault = f"{show_key(path[:depth])} holds a value, not a table"
        elif part in table:
            table = table[str(part)]
        else:
            fault = _find_key_fault(table, path, depth)
            table = {}
    return f"cannot set {show_key(path)}: {fault}" if fault else ""


def _find_key_fault(table: TomlTable, path: KeyPath, depth: int) -> str:
    """Why a key that a table does not have cannot be added to it; empty where it can."""
    section, last = path[0], depth == len(path) - 1
    if depth == 1 and (not last or section == PARAMETERS) and section in ENTRY_SECTIONS:
        return suggest_names(path[1], table, what=str(section))
    keys = known_keys(path[:depth])
    if keys is not None and path[depth] not in keys:
        return unknown_key(path[: depth + 1])
    if not last and isinstance(path[depth + 1], int) and is_list(path[: depth + 1]):
        whole = show_key(path[: depth + 1])
        return f"{whole} is not written; set it as a whole, {whole}=[..., ...]"
    return ""
