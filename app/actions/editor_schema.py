"""JSON schemas of scene and target files for editors: every key with what it means, and no file refused that the program accepts."""

from collections.abc import Iterator
from typing import Any

from headstock.scene.building.joints import KINDS
from headstock.scene.schema.key_notes import NOTES
from headstock.scene.schema.scene import SceneTable
from headstock.scene.schema.types import StrictTable
from headstock.studies.identification.schema import TargetsTable

DIALECT = "https://json-schema.org/draft/2020-12/schema"
LONG_PATTERN = 200


def plain_schema() -> dict[str, Any]:
    """Tables and keys of a scene file as they are declared, for the scene reference."""
    return _declare(SceneTable)


def scene_schema() -> dict[str, Any]:
    """JSON schema of a scene file, as ``headstock schema`` prints it."""
    schema = _finish(SceneTable, "Scene", "Headstock scene")
    schema["$defs"]["JointTable"]["allOf"] = [*_joint_rules()]
    return schema


def targets_schema() -> dict[str, Any]:
    """JSON schema of a target file of ``headstock identify``, as ``headstock schema targets`` prints it."""
    return _finish(TargetsTable, "Targets", "Headstock targets")


def _declare(table: type[StrictTable]) -> dict[str, Any]:
    """What pydantic says of a table; tables with names of the user's own are one rule for all entries and one for their names."""
    schema: dict[str, Any] = table.model_json_schema(mode="validation")
    for rule in list(_walk(schema)):
        named = rule.pop("patternProperties", None)
        if named is not None:
            ((pattern, rule["additionalProperties"]),) = named.items()
            rule["propertyNames"] = {"pattern": pattern}
    return schema


def _finish(table: type[StrictTable], name: str, title: str) -> dict[str, Any]:
    schema = _declare(table)
    tables = {f"{name}Table": schema, **schema["$defs"]}
    for label, entry in tables.items():
        for key, rule in entry.get("properties", {}).items():
            _describe(rule, NOTES.get(f"{label.removesuffix('Table')}.{key}", ""))
    patterns: dict[str, str] = {}
    for rule in list(_walk(schema)):
        # TOML has no null: what may be left out is left out
        if "anyOf" in rule:
            rule["anyOf"] = [option for option in rule["anyOf"] if option != {"type": "null"}]
        if rule.get("default", "") is None or isinstance(rule.get("default"), dict):
            del rule["default"]
        rule.pop("title", None)
        pattern = rule.get("pattern", "")
        if len(pattern) > LONG_PATTERN:
            rule["$ref"] = f"#/$defs/{patterns.setdefault(pattern, f'quantity{len(patterns) + 1}')}"
            del rule["pattern"]
    schema["$defs"] |= {number: {"pattern": pattern} for pattern, number in patterns.items()}
    return {"$schema": DIALECT, "title": title, **schema}


def _describe(rule: dict[str, Any], note: str) -> None:
    """What a key means, then what it takes."""
    takes = rule.get("description", "")
    rule["description"] = f"{note} ({takes})" if note and takes else note or takes
    if not rule["description"]:
        del rule["description"]


def _walk(rule: Any) -> Iterator[dict[str, Any]]:
    """Every object inside a schema that may hold a rule; names of keys are none."""
    if isinstance(rule, list):
        for item in rule:
            yield from _walk(item)
    if isinstance(rule, dict):
        yield rule
        for key, inner in rule.items():
            if key in ("properties", "$defs", "patternProperties"):
                for entry in inner.values():
                    yield from _walk(entry)
            elif key not in ("default", "examples", "enum", "const", "required"):
                yield from _walk(inner)


def _joint_rules() -> Iterator[dict[str, Any]]:
    """Which keys each kind of joint takes."""
    for kind, rule in KINDS.items():
        keys = {"propertyNames": {"enum": list(rule.keys)}}
        required = [*(["axis"] if rule.needs_axis else []), *(["normal"] if rule.needs_normal else [])]
        stiffness = {**keys, **({"required": list(rule.required)} if rule.required else {})}
        needs = [*required, *(["stiffness"] if rule.required else [])]
        then = {"properties": {"stiffness": stiffness, "damping": keys}, **({"required": needs} if needs else {})}
        yield {"if": {"properties": {"kind": {"const": kind}}, "required": ["kind"]}, "then": then}
