"""Machines that many tests share: `data/machines/*.toml`, each with what a test changes about it;
longer scenes of a test are files of `data/scenes`.
"""

import functools
import json
import re
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path

FOLDER = Path(__file__).parent / "data" / "machines"
SCENES = Path(__file__).parent / "data" / "scenes"


def machine(text: str) -> str:
    """The text of a scene, from TOML that says how it differs from a machine.

    `machine` names the file, `names` other names for its components, interfaces, joints and points,
    `without` dotted keys that the scene has not. A key of an entry (``joints.clamp.kind``) takes the
    place of the machine's; its other keys stay.
    """
    changes = tomllib.loads(text)
    base = (FOLDER / f"{changes.pop('machine')}.toml").read_text()
    for old, new in changes.pop("names", {}).items():
        base = re.sub(rf"(?<![\w-]){old}(?![\w-])", new, base)
    scene = tomllib.loads(base)
    for key in changes.pop("without", []):
        *path, last = key.split(".")
        del functools.reduce(dict.__getitem__, path, scene)[last]
    for section, entries in changes.items():
        old = scene.get(section)
        if isinstance(entries, dict) and isinstance(old, dict):
            pairs = ((name, old.get(name), entry) for name, entry in entries.items())
            entries = old | {
                name: before | entry
                if isinstance(before, dict) and isinstance(entry, dict)
                else entry
                for name, before, entry in pairs
            }
        scene[section] = entries
    for last in list(changes)[-1:]:  # stands last in the scene too: keys may be added to it
        scene[last] = scene.pop(last)
    return "".join(write_tables(scene))


def stored_scene(name: str) -> str:
    """The text of a file of `data/scenes`: a scene, or how it differs from a machine."""
    text = (SCENES / f"{name}.toml").read_text(encoding="utf-8")
    return machine(text) if text.startswith("machine = ") else text


def write_scene(folder: Path, text: str, *changes: tuple[str, str], name: str = "scene") -> Path:
    """The file of a scene; each change has to have something to replace."""
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new)
    path = folder / f"{name}.toml"
    path.write_text(text)
    return path


def write_tables(scene: Mapping[str, object]) -> Iterator[str]:
    """A table an entry of each section, keys a line; tables further down are inline."""
    for key, value in scene.items():
        if not isinstance(value, dict):
            yield f"{key} = {write_value(value)}\n"
    for section, entries in scene.items():
        if isinstance(entries, dict):
            tables = {
                k: v for k, v in entries.items() if isinstance(v, dict) and section != "effects"
            }
            if len(tables) < len(entries) or not entries:
                yield from write_table(
                    section, {k: v for k, v in entries.items() if k not in tables}
                )
            for name, entry in tables.items():
                yield from write_table(f"{section}.{name}", entry)


def write_table(name: str, keys: Mapping[str, object]) -> Iterator[str]:
    yield f"[{name}]\n"
    yield from (f"{write_key(key)} = {write_value(value)}\n" for key, value in keys.items())


def write_key(key: str) -> str:
    return key if re.fullmatch(r"[\w-]+", key) else json.dumps(key)


def write_value(value: object) -> str:
    if isinstance(value, dict):
        inside = (f"{write_key(key)} = {write_value(entry)}" for key, entry in value.items())
        return f"{{ {', '.join(inside)} }}" if value else "{}"
    if isinstance(value, list):
        return f"[{', '.join(map(write_value, value))}]"
    return json.dumps(value, ensure_ascii=False)
