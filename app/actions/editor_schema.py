"""JSON schemas of scene and target files for editors: every key with what it means, and no file
refused that the program accepts.
"""

from collections.abc import Iterator

from headstock.pipeline.storage.json_texts import JsonTable, JsonValue
from headstock.scene.building.joints import KINDS
from headstock.scene.expansion.catalogue import BEARINGS, CATALOGUE, FROM, read_catalogue
from headstock.scene.reading.units import DIMENSIONS, Dimension, parse_quantity
from headstock.scene.schema.scene import complete_scene
from headstock.scene.schema.types import MEANING, StrictTable
from headstock.studies.identification.targets import TargetsTable

DIALECT = "https://json-schema.org/draft/2020-12/schema"
LONG_PATTERN = 200
# what is calculated from parameters, or filled in at each place of an entry
EXPRESSION: JsonTable = {"type": "string", "pattern": r"^\s*=|\{(n|rail)\}"}


def plain_schema() -> JsonTable:
    """Tables and keys of a scene file as they are declared, for the scene reference."""
    return _declare(complete_scene())


def scene_schema() -> JsonTable:
    """JSON schema of a scene file, as ``headstock schema`` prints it."""
    schema = _finish(complete_scene(), "Scene", "Headstock scene")
    definitions = rules_in(schema, "$defs")
    _allow_catalogue(definitions)
    for rule in reversed(list(_walk(schema))):  # what is inside first
        _allow_expressions(rule)
    # their conditions are no values: an expression says nothing of the kind
    definitions["JointTable"]["allOf"] = [*_joint_rules()]
    return schema | {"$defs": {**definitions, "expression": EXPRESSION}}


def targets_schema() -> JsonTable:
    """JSON schema of a target file of ``headstock identify``, as ``headstock schema targets``
    prints it.
    """
    return _finish(TargetsTable, "Targets", "Headstock targets")


def rules_in(rule: JsonTable, key: str) -> dict[str, JsonTable]:
    """What stands under a key of a rule that names other rules, by name."""
    inner = rule.get(key)
    return (
        {name: each for name, each in inner.items() if isinstance(each, dict)}
        if isinstance(inner, dict)
        else {}
    )


def _declare(table: type[StrictTable]) -> JsonTable:
    """What pydantic says of a table; tables with names of the user's own are one rule for all
    entries and one for their names.
    """
    schema: JsonTable = table.model_json_schema(mode="validation")
    for rule in list(_walk(schema)):
        if "description" in rule:
            # of a docstring: paragraphs, however they wrap there
            paragraphs = str(rule["description"]).split("\n\n")
            rule["description"] = "\n\n".join(" ".join(each.split()) for each in paragraphs)
        if "default" in rule and (dimension := _dimension_of(rule)) is not None:
            rule["default"] = _write_default(rule["default"], dimension)
        # one entry: the user's names all follow the same pattern
        for pattern, entry in rules_in(rule, "patternProperties").items():
            del rule["patternProperties"]
            rule.update({"additionalProperties": entry, "propertyNames": {"pattern": pattern}})
    return schema


def _dimension_of(rule: JsonTable) -> Dimension | None:
    """What a value, or each of a list, measures."""
    inner = rule.get("items", rule)
    examples = inner.get("examples") if isinstance(inner, dict) else None
    first = examples[0] if isinstance(examples, list) else None
    return next((dimension for dimension in DIMENSIONS if dimension.example == first), None)


def _write_default(value: JsonValue, dimension: Dimension) -> JsonValue:
    """A default in SI units as a scene writes it, in the unit of the dimension's example."""
    if isinstance(value, list):
        return [_write_default(each, dimension) for each in value]
    if not isinstance(value, int | float):
        return value
    unit = dimension.example.partition(" ")[2]
    return f"{value / parse_quantity(f'1 {unit}', dimension).value:.6g} {unit}"


def _finish(table: type[StrictTable], name: str, title: str) -> JsonTable:
    schema = _declare(table)
    for entry in [schema, *rules_in(schema, "$defs").values()]:
        for rule in rules_in(entry, "properties").values():
            _describe(rule)
    patterns: dict[str, str] = {}
    for rule in list(_walk(schema)):
        # TOML has no null: what may be left out is left out
        if isinstance(options := rule.get("anyOf"), list):
            rule["anyOf"] = [option for option in options if option != {"type": "null"}]
        if rule.get("default", "") is None or isinstance(rule.get("default"), dict):
            del rule["default"]
        rule.pop("title", None)
        pattern = str(rule.get("pattern", ""))
        if len(pattern) > LONG_PATTERN:
            rule["$ref"] = f"#/$defs/{patterns.setdefault(pattern, f'quantity{len(patterns) + 1}')}"
            del rule["pattern"]
    definitions = rules_in(schema, "$defs") | {
        number: {"pattern": pattern} for pattern, number in patterns.items()
    }
    return {"$schema": DIALECT, "title": title, **schema, "$defs": {**definitions}}


def _allow_expressions(rule: JsonTable) -> None:
    """Let any value of a table or a list be an expression, too."""
    below = [rule.get(key) for key in ("items", "additionalProperties")]
    values = [inner for inner in below if isinstance(inner, dict)]
    for inner in [*rules_in(rule, "properties").values(), *values]:
        known: JsonTable = {
            key: inner.pop(key)
            for key in list(inner)
            if key not in ("description", "default", "examples")
        }
        inner["anyOf"] = [known, {"$ref": "#/$defs/expression"}]


def _describe(rule: JsonTable) -> None:
    """What a key means, then what it takes."""
    meaning, takes = str(rule.pop(MEANING, "")), str(rule.get("description", ""))
    rule["description"] = f"{meaning} ({takes})" if meaning and takes else meaning or takes
    if not rule["description"]:
        del rule["description"]


def _walk(rule: JsonValue) -> Iterator[JsonTable]:
    """Every object inside a schema that may hold a rule; names of keys are none."""
    if isinstance(rule, list):
        for item in rule:
            yield from _walk(item)
    if isinstance(rule, dict):
        yield rule
        for key, inner in rule.items():
            if key in ("properties", "$defs", "patternProperties"):
                for entry in rules_in(rule, key).values():
                    yield from _walk(entry)
            elif key not in ("default", "examples", "enum", "const", "required"):
                yield from _walk(inner)


def _joint_rules() -> Iterator[JsonTable]:
    """Which keys each kind of joint takes, however it is named: by ``kind``, or by an element of
    the catalogue, which brings what is required.
    """
    named: JsonTable = {"required": [FROM]}
    yield {"if": {"not": named}, "then": {"required": ["kind"]}}
    yield {
        "if": {"not": named},
        "then": {"properties": {"screw": {"anyOf": [{"required": ["diameter"]}, named]}}},
    }
    for kind, rule in KINDS.items():
        keys: JsonTable = {"propertyNames": {"enum": [*rule.keys]}}
        written: JsonTable = {"properties": {"kind": {"const": kind}}, "required": ["kind"]}
        elements: JsonTable = {"properties": {FROM: {"enum": _elements(kind)}}, **named}
        needs = {"axis": rule.needs_axis, "normal": rule.needs_normal}
        required: list[JsonValue] = [key for key, needed in needs.items() if needed]
        then: JsonTable = {
            "properties": {"stiffness": keys, "damping": keys},
            **({"required": required} if required else {}),
        }
        yield {"if": {"anyOf": [written, elements]}, "then": then}
        if rule.required:
            stiffness: JsonTable = {"stiffness": {"required": [*rule.required]}}
            yield {
                "if": {**written, "not": {"anyOf": [named, {"required": ["stiffness_per_area"]}]}},
                "then": {"properties": stiffness, "required": ["stiffness"]},
            }


def _elements(kind: str) -> list[JsonValue]:
    """What ``from`` may name for a kind of joint."""
    return [
        f"{CATALOGUE}{entry.name}"
        for entry in read_catalogue().values()
        if entry.family.kind == kind
    ]


def _allow_catalogue(definitions: dict[str, JsonTable]) -> None:
    """Let joints and bearings of screws name elements of the catalogue."""
    joint, screw = definitions["JointTable"], definitions["ScrewTable"]
    joint["required"], screw["required"] = ["between"], []
    every = [element for kind in KINDS for element in _elements(kind)]
    for table, names in ((joint, every), (screw, _elements("ball_screw"))):
        name = rules_in(table, "properties")[FROM]
        del name["anyOf"]
        name["enum"] = names
    for key in BEARINGS:
        rule = rules_in(screw, "properties")[key]
        options = rule["anyOf"]
        rule["anyOf"] = [
            *(options if isinstance(options, list) else []),
            {"enum": _elements("bearing")},
        ]
