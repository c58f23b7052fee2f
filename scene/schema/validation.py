"""Runs the schema over a parsed scene and turns what pydantic finds into problems with a place and
a remedy.
"""

import difflib
import functools
import re
import types
from functools import cache
from typing import Annotated, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from headstock.geometry.loading import without_collecting
from headstock.scene.reading.expressions import is_expression
from headstock.scene.reading.files import TomlTable, TomlValue
from headstock.scene.reading.findings import Findings, KeyPath, suggest_names
from headstock.scene.reading.names import REMOVED_KEYS, SCENE_KEYS
from headstock.scene.reading.units import quote_value
from headstock.scene.schema.scene import SceneTable, table_of
from headstock.scene.schema.types import table_name

# what pydantic puts among the keys: a faulty key, and which kind of value was taken
_TAG = re.compile(r"(|literal|function-\w+)\[.*\]")
_KINDS = {
    "string_type": 'is not text; write it in quotes, such as "text"',
    "bool_type": "is neither true nor false; write one of them without quotes",
    "list_type": "is not a list; write [ ..., ... ]",
    "dict_type": "is not a table; write { key = value } or [section]",
    "model_type": "is not a table; write { key = value } or [section]",
    "model_attributes_type": "is not a table; write { key = value } or [section]",
}


def validate_tables(raw: TomlTable, findings: Findings) -> SceneTable | None:
    """Validate a parsed scene, as ``validate_against`` does."""
    analyses = raw.get("analyses")
    names = frozenset(analyses) if isinstance(analyses, dict) else frozenset[str]()
    with without_collecting():
        return validate_against(table_of(frozenset(raw), names), raw, findings)


def validate_against[T: BaseModel](model: type[T], raw: TomlTable, findings: Findings) -> T | None:
    """Validate a parsed file; entries that fail are reported and left out, so that the rest can be
    checked further.

    Args:
        model: Schema of the whole file.
        raw: Parsed TOML after overrides.
        findings: Where problems go.

    Returns:
        What is valid, or None when not enough of the file is left to look at.
    """
    pruned: TomlTable = {
        key: dict(value) if isinstance(value, dict) else value for key, value in raw.items()
    }
    for attempt in range(4):
        try:
            return model.model_validate(pruned)
        except ValidationError as error:
            details = error.errors(include_url=False)
            for detail in details:
                # of what was left out because of its own fault
                follows = (detail["type"] == "missing" and _is_written(raw, detail["loc"])) or (
                    attempt > 0 and not detail["loc"]
                )
                if not follows:
                    _report(model, detail, findings)
            if not all(detail["loc"] for detail in details):
                return None  # the table itself is at fault
            for detail in details:
                _prune(pruned, detail["loc"])
    return None


def validate_part[T: BaseModel](
    model: type[T], raw: TomlValue, key: KeyPath, findings: Findings
) -> T | None:
    """Validate a table of a scene; what is wrong with it is reported below its key.

    Returns:
        The table, or None where anything is wrong.
    """
    try:
        return model.model_validate(raw)
    except ValidationError as error:
        for detail in error.errors(include_url=False):
            _report(model, detail, findings, key)
        return None


def known_keys(path: KeyPath, root: type[BaseModel] | None = None) -> list[str] | None:
    """Keys a schema, by default the scene's, knows at a path; None where any key may stand."""
    model = _resolve_model(root or _root(path), path)
    return (
        [field.alias or name for name, field in model.model_fields.items()]
        if model is not None
        else None
    )


def is_list(path: KeyPath) -> bool:
    """Return whether the scene's schema has a list at a path."""
    model = _resolve_model(_root(path), path[:-1])
    return model is not None and get_origin(_field_kind(model, str(path[-1]))) is list


def unknown_key(path: KeyPath) -> str:
    """Return what is wrong with the last key of a path that the scene's schema does not know, or no longer
    by this name.
    """
    return _unknown_key(_root(path), path)


def _root(path: KeyPath) -> type[SceneTable]:
    """Return the table of a scene as far as a path needs it."""
    if path[:1] != ("analyses",):
        return SceneTable
    return table_of(frozenset(("analyses",)), frozenset(str(part) for part in path[1:2]))


def _unknown_key(root: type[BaseModel], path: KeyPath) -> str:
    model, key = _resolve_model(root, path[:-1]), str(path[-1])
    label = "" if model is None else table_name(model)
    if renamed := SCENE_KEYS.get(f"{label}.{key}"):
        return f"{key!r} is now called {renamed!r}; write {renamed}"
    if reason := REMOVED_KEYS.get(f"{label}.{key}"):
        return f"{key!r} is not needed: {reason}"
    keys = known_keys(path[:-1], root) or []
    return f"unknown key {key[:80]!r}; {suggest_names(path[-1], keys, what='known keys')}"


def _report(
    root: type[BaseModel], detail: ErrorDetails, findings: Findings, key: KeyPath = ()
) -> None:
    """Report what pydantic found.

    Args:
        root: Table that was validated.
    """
    path: KeyPath = tuple(part for part in detail["loc"] if not _TAG.fullmatch(str(part)))
    kind, value = detail["type"], detail.get("input")
    if is_expression(value):
        return  # said where it could not be calculated
    message = str(detail["msg"])
    if kind == "extra_forbidden":
        message = _unknown_key(root, path)
    elif kind == "missing":
        message = _missing_message(root, path)
    elif kind == "literal_error":
        expected = str(detail.get("ctx", {}).get("expected", ""))
        message = f"{quote_value(value)} is not one of {expected}{_closest(value, expected)}"
    elif kind in ("too_short", "too_long"):
        message = _length_message(detail)
    elif kind in _KINDS:
        message = f"{quote_value(value)} {_KINDS[kind]}"
    findings.add((*key, *path), message)


def _missing_message(root: type[BaseModel], path: KeyPath) -> str:
    model = _resolve_model(root, path[:-1])
    example = "" if model is None else _example_of(model, str(path[-1]))
    return f"{path[-1]!r} is missing; write it{example}"


@cache
def _example_of(model: type[BaseModel], key: str) -> str:
    """An example value of a key, where its type has one."""
    schema = model.model_json_schema(mode="validation")["properties"].get(key, {})
    return f', such as {key} = "{schema["examples"][0]}"' if schema.get("examples") else ""


def _length_message(detail: ErrorDetails) -> str:
    context = detail.get("ctx", {})
    length = context.get("actual_length")
    low, high = context.get("min_length"), context.get("max_length")
    wanted = f"at least {low}" if low is not None else f"at most {high}"
    return f"has {length} entries but needs {wanted}"


def _closest(value: object, expected: str) -> str:
    names = [part.strip(" '") for part in expected.replace(" or ", ",").split(",")]
    close = difflib.get_close_matches(str(value)[:80], names, n=1, cutoff=0.5)
    return f"; did you mean {close[0]!r}?" if close else ""


def _is_written(raw: TomlValue, loc: tuple[int | str, ...]) -> bool:
    """Whether anything stands at a place."""
    for part in loc:
        if not isinstance(raw, dict) or part not in raw:
            return False
        raw = raw[str(part)]
    return True


def _prune(pruned: TomlTable, loc: tuple[int | str, ...]) -> None:
    """Remove the entry an error lies in: ``components.column`` for
    ``components.column.mesh.size``.
    """
    section = str(loc[0])
    entries = pruned.get(section)
    if len(loc) > 1 and isinstance(entries, dict) and loc[1] in entries:
        del entries[str(loc[1])]
    elif len(loc) == 1 or not isinstance(entries, dict):
        pruned.pop(section, None)


def _resolve_model(annotation: object, path: KeyPath) -> type[BaseModel] | None:
    annotation = _unwrap(annotation)
    if not path:
        if isinstance(annotation, type) and issubclass(annotation, BaseModel):
            return annotation
        return None
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return _resolve_model(_field_kind(annotation, str(path[0])), path[1:])
    arguments = get_args(annotation)
    if get_origin(annotation) in (dict, list) and arguments:
        return _resolve_model(arguments[-1], path[1:])
    return None


@functools.cache
def _field_kind(model: type[BaseModel], key: str) -> object:
    """What a field of a table holds; None where there is no such field."""
    field = model.model_fields.get(key)
    return None if field is None else _unwrap(field.annotation)


def _unwrap(annotation: object) -> object:
    """Strip ``Annotated`` and ``| None``."""
    while True:
        origin = get_origin(annotation)
        if origin is Annotated:
            annotation = get_args(annotation)[0]
        elif origin in (Union, types.UnionType):
            candidates = [item for item in get_args(annotation) if item is not type(None)]
            tables = [
                item
                for item in candidates
                if isinstance(kind := _strip(item), type) and issubclass(kind, BaseModel)
            ]
            annotation = (tables or candidates)[0]
        else:
            return annotation


def _strip(annotation: object) -> object:
    return get_args(annotation)[0] if get_origin(annotation) is Annotated else annotation
