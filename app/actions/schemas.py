"""``headstock schema``: JSON schemas of scene and target files for editors, every key with what it means
and no file refused that the program accepts; and the scene reference as Markdown, made from the schema
(``headstock schema --markdown > docs/scene_reference.md``). ``headstock schema units`` prints the page of units.
"""

import functools
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

import click

from headstock.app.commands.tool_commands import SchemaOptions
from headstock.app.terminal.guard import DONE
from headstock.geometry.frames import DOF_NAMES
from headstock.pipeline.storage.json_texts import JsonTable, JsonValue, dump_json
from headstock.scene.building.joints import KINDS
from headstock.scene.expansion.catalogue import BEARINGS, CATALOGUE, FROM, read_catalogue
from headstock.scene.reading.open_values import OPEN, REASON
from headstock.scene.reading.units import (
    DIMENSIONS,
    EDGE_FORCE,
    SPECIFIC_FORCE,
    Dimension,
    list_spellings,
    measure_unit,
    parse_quantity,
)
from headstock.scene.schema.scene import complete_scene
from headstock.scene.schema.types import DEFAULT, MEANING, PlainNames, StrictTable
from headstock.studies.identification.targets import TargetsTable

DIALECT = "https://json-schema.org/draft/2020-12/schema"
LONG_PATTERN = 200
# what is not decided yet
OPEN_VALUE: JsonTable = {
    "type": "object",
    "properties": {OPEN: {}, REASON: {"type": "string"}},
    "required": [OPEN, REASON],
    "additionalProperties": False,
}
# what is calculated from parameters, or filled in at each place of an entry
EXPRESSION: JsonTable = {"type": "string", "pattern": r"^\s*=|\{(n|rail)\}"}
INTRODUCTION = """\
# Scene reference

Made from the schema by `./headstock schema --markdown > docs/scene_reference.md`; a test asserts that it is up to date.

A scene is a TOML file. Keys that are not listed here are errors, with a suggestion. A key in square brackets names a table; `NAME` is
yours to choose, of letters, digits, `_` and `-`. Files that a scene names lie in its folder or below.

- **Value**: what a key takes, with its limits. A length, a stiffness and every other quantity is a text with a unit, as `"12.5 mm"`; the link
  leads to its [units](units.md). What has no dimension is a plain number. Whole numbers go up to 10 million.
- <span id="direction"></span>A **direction** is `"x"`, `"y"`, `"z"`, one of these with a sign, such as `"-x"`, or three numbers.
- <span id="end"></span>An **end** is `"component.interface"` or `"ground"`.
- <span id="open"></span>Any value may be **open**: `{ open = "20 mm", reason = "why it is not sure" }`. `check` lists open values. A run
  needs other values in their places, or `--accept-defaults`, and then names those that it used.
- **Default**: what holds where a key is left out. A **required** key cannot be. Of the keys marked **one of these** a table has exactly
  one. *none*: nothing is there.
- Every table opens with an example, which a test completes to a scene and loads.
"""
WITH_UNIT = " with a unit"
QUANTITIES = (*DIMENSIONS, SPECIFIC_FORCE, EDGE_FORCE)
QUANTITY_NAMES = re.compile(
    "|".join(sorted((kind.name for kind in QUANTITIES), key=len, reverse=True))
)
DIRECTIONS = "`x`, `y`, `z`, `+x`, `+y`, `+z`, `-x`, `-y`, `-z` or list of 3 × (number)"
EXAMPLES = Path(__file__).parents[1] / "texts" / "scene_examples.toml"
EMPTY = "none"
UNITS = """\
# Units

Made from the code by `./headstock schema units > docs/units.md`; a test asserts that it is up to date.

A quantity is a text with a number and a unit: `"210 GPa"`, `"380 N/um"`, `"1e6 N m/rad"`, `"2 %"`. A number without a unit is an error
where the key measures something. Any unit of the right kind is accepted: a length may be `mm`, `um`, `in` or `m`.

- Units are multiplied by a space, `*` or `·`, divided by `/`, and raised by `^2`, `**2` or `²`: `kg m^2`, `N/um/mm^2`, `1/s`.
- `u`, `µ` and `μ` all mean micro. Case counts: `mm` is a length, `MN` a force.
- A plain number or a per cent is accepted for ratios: `0.02` is `"2 %"`.
- Hertz and `rad/s` are different: `"50 Hz"` is a frequency, `"3000 rpm"` and `"10 rad/s"` are angular speeds, `"60 1/s"` is a rate.
- In [expressions](short_scenes.md#parameters) units are calculated with: `"= 2 * wall + 3 mm"`.

Results have SI units in files (`results.h5`, CSV of `numbers`), and units such as µm/kN on screen, always with the number.
"""


def schema_command(options: SchemaOptions) -> int:
    """Print a schema, the scene reference, or the page of units."""
    if options.kind == "units":
        click.echo(_render_units(), nl=False)
        return DONE
    content = _targets_schema() if options.kind == "targets" else scene_schema()
    shown = _render_reference(plain_schema()) if options.markdown else dump_json(content)
    click.echo(shown, nl=False)
    options.write_json(dump_json(content))
    return DONE


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
    added = {"expression": EXPRESSION, OPEN: OPEN_VALUE}
    return schema | {"$defs": {**definitions, **added}}


def _targets_schema() -> JsonTable:
    """JSON schema of a target file of ``headstock identify``, as ``headstock schema targets``
    prints it.
    """
    return _finish(TargetsTable, "Targets", "Headstock targets")


def rules_in(rule: JsonTable, key: str) -> dict[str, JsonTable]:
    """Return what stands under a key of a rule that names other rules, by name."""
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
    schema: JsonTable = table.model_json_schema(mode="validation", schema_generator=PlainNames)
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
    """Let any value of a table or a list be an expression or open, too."""
    below = [rule.get(key) for key in ("items", "additionalProperties")]
    values = [inner for inner in below if isinstance(inner, dict)]
    for inner in [*rules_in(rule, "properties").values(), *values]:
        known: JsonTable = {
            key: inner.pop(key)
            for key in list(inner)
            if key not in ("description", "default", "examples")
        }
        inner["anyOf"] = [known, {"$ref": "#/$defs/expression"}, {"$ref": f"#/$defs/{OPEN}"}]


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
        keys: JsonTable = {"propertyNames": {"enum": [*rule.keys, OPEN, REASON]}}
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
            written_out: JsonTable = {
                "anyOf": [{"required": [*rule.required]}, {"required": [OPEN]}]
            }
            stiffness: JsonTable = {"stiffness": written_out}
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


def _render_reference(schema: JsonTable) -> str:
    """The reference of all keys as Markdown."""
    parts = [
        INTRODUCTION,
        "## The file",
        "",
        str(schema.get("description", "")),
        "",
        *_example("scene"),
        *_key_table("Scene", schema),
    ]
    seen: set[str] = set()
    for key, rule in rules_in(schema, "properties").items():
        name = _table_of(rule)
        if name is not None:
            named = "additionalProperties" in rule
            parts += _section(schema, name, f"{key}.NAME" if named else key, seen, level=2)
    parts += ["## Kinds of joints", "", *_joint_table()]
    return "\n".join(parts).rstrip() + "\n"


def _section(
    schema: JsonTable, name: str, path: str, seen: set[str], *, level: int
) -> Iterator[str]:
    """A table, then the tables inside it that have not been written yet."""
    if name in seen:
        return
    seen.add(name)
    table = rules_in(schema, "$defs")[name]
    label = name.removesuffix("Table")
    yield from [
        f"{'#' * level} `[{path}]`",
        "",
        str(table.get("description", "")),
        "",
        *_example(path),
        *_key_table(label, table),
    ]
    for key, rule in rules_in(table, "properties").items():
        inner = _table_of(rule)
        if inner is not None:
            below = f"{path}.{key}.NAME" if "additionalProperties" in rule else f"{path}.{key}"
            yield from _section(schema, inner, below, seen, level=3)


def _example(path: str) -> list[str]:
    """Return what a table opens with."""
    return ["```toml", _read_examples()[path].strip(), "```", ""]


@functools.cache
def _read_examples() -> dict[str, str]:
    return tomllib.loads(EXAMPLES.read_text(encoding="utf-8"))


def _key_table(label: str, table: JsonTable) -> Iterator[str]:
    yield from ["| key | value | default | meaning |", "|---|---|---|---|"]
    for key, rule in rules_in(table, "properties").items():
        meaning, _, said = str(rule.get(MEANING, "")).partition(DEFAULT)
        default = said or _describe_default(key, rule, table)
        yield f"| `{key}` | {_describe_value(rule)} | {default} | {meaning} |"
    yield ""


def _table_of(rule: JsonTable) -> str | None:
    """Name of the table a key holds, in whatever wrapping."""
    if "$ref" in rule:
        return str(rule["$ref"]).rsplit("/", 1)[-1]
    for inner in (*_options(rule), rule.get("additionalProperties"), rule.get("items")):
        if isinstance(inner, dict) and (found := _table_of(inner)):
            return found
    return None


def _options(rule: JsonTable) -> list[JsonTable]:
    """What a value may be one of."""
    return [
        option
        for key in ("anyOf", "oneOf")
        for option in _items(rule, key)
        if isinstance(option, dict)
    ]


def _items(rule: JsonTable, key: str) -> list[JsonValue]:
    found = rule.get(key)
    return found if isinstance(found, list) else []


def _describe_value(rule: JsonTable) -> str:
    if _options(rule):
        options = " or ".join(
            _describe_value(option) for option in _options(rule) if option.get("type") != "null"
        )
        return options.replace(DIRECTIONS, "[direction](#direction)")
    if "$ref" in rule:
        return "table"
    if "const" in rule:
        return f"`{_show(rule['const'])}`"
    if "enum" in rule:
        return ", ".join(f"`{option}`" for option in _items(rule, "enum"))
    if (quantity := str(rule.get("description", ""))).endswith(WITH_UNIT):
        return QUANTITY_NAMES.sub(
            lambda name: f"[{name[0]}](units.md#{name[0].replace(' ', '-')})",
            quantity.removesuffix(WITH_UNIT),
        )
    if quantity == "component.interface or ground":
        return "[end](#end)"
    if "description" in rule:
        examples = ", ".join(f"`{_show(example)}`" for example in _items(rule, "examples"))
        return (
            f"{rule['description']}, such as {examples}" if examples else str(rule["description"])
        )
    kind = str(rule.get("type", ""))
    if kind in ("array", "object"):
        return _describe_entries(rule, kind)
    words = {"string": "text", "boolean": "`true`, `false`", "integer": "whole number"}
    return words.get(kind, kind) + _describe_limits(rule)


def _describe_entries(rule: JsonTable, kind: str) -> str:
    """What a list or a table holds, and how many."""
    inner = rule.get("items" if kind == "array" else "additionalProperties")
    entry = _describe_value(inner) if isinstance(inner, dict) and inner else ""
    if kind == "object":
        count = _describe_count(rule.get("minProperties"), rule.get("maxProperties"))
        return f"table of {count}{' ' if count else ''}names: {entry}" if entry else "table"
    if "examples" in rule:
        return f"list, such as `{_show(_items(rule, 'examples')[0])}`"
    count = _describe_count(rule.get("minItems"), rule.get("maxItems"))
    return (
        f"list of {count}{' × ' if count else ''}({entry})" if entry else f"list of {count} values"
    )


def _describe_count(low: JsonValue, high: JsonValue) -> str:
    """How many entries there may be; empty where any number may."""
    if low == high:
        return "" if low is None else f"{low}"
    if high is None:
        return f"at least {low}"
    return f"{low} to {high}" if low else f"up to {high}"


def _describe_limits(rule: JsonTable) -> str:
    """Lowest and highest value of a number."""
    words = {
        "exclusiveMinimum": "above",
        "minimum": "from",
        "exclusiveMaximum": "below",
        "maximum": "to",
    }
    limits = {key: f" {word} {_show(rule[key])}" for key, word in words.items() if key in rule}
    if "exclusiveMinimum" in limits:
        limits.pop("minimum", None)
    return "".join(limits.values()).replace(" below", " and below" if len(limits) > 1 else " below")


def _describe_default(key: str, rule: JsonTable, table: JsonTable) -> str:
    """What holds where a key is left out."""
    if key in _items(table, "required"):
        return "**required**"
    if {"required": [key]} in _items(table, "oneOf"):
        return "**one of these**"
    default = rule.get("default")
    if "$ref" in rule:
        return "the defaults of its keys"
    if default is None or isinstance(default, dict) or default == []:
        return EMPTY
    return f"`{_show(default)}`"


def _show(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list):
        return f"[{', '.join(_show(item) for item in value)}]"
    return (
        f'"{value}"'
        if isinstance(value, str)
        else f"{value:g}"
        if isinstance(value, float)
        else str(value)
    )


def _render_units() -> str:
    """Return ``docs/units.md``."""
    prefixes, names = list_spellings()
    parts = [
        UNITS,
        "## Quantities",
        "",
        "What is larger than the largest value is refused as a slip of units.",
        "",
        "| quantity | SI unit | example | largest value, SI |",
        "|---|---|---|---|",
        *(
            f'| <span id="{kind.name.replace(" ", "-")}"></span>{kind.name} | '
            f'{f"`{kind.unit}`" if kind.unit else EMPTY} | `"{kind.example}"` | {kind.most:g} |'
            for kind in QUANTITIES
        ),
        "",
        "## Units",
        "",
        "| unit | measures | in SI units |",
        "|---|---|---|",
    ]
    for spellings in names:
        factor, measured = measure_unit(spellings[0])
        shown = ", ".join(f"`{text}`" for text in spellings)
        kind = "a volume" if measured.startswith("in ") else measured  # alone in having no key
        parts.append(f"| {shown} | {kind} | {float(factor):.9g} |")
    parts += ["", "## Prefixes", "", "| prefix | factor |", "|---|---|"]
    for spellings in prefixes:
        factor, _ = measure_unit(f"{spellings[0]}m")
        parts.append(f"| {', '.join(f'`{text}`' for text in spellings)} | {float(factor):g} |")
    return "\n".join(parts) + "\n"


def _joint_table() -> Iterator[str]:
    yield "Directions are those of the joint: x along `axis` (z for bolted joints and mounts), z along `normal`."
    yield 'A bearing lets its shaft turn unless `torsion` holds it: `stiffness = { radial = "300 N/um", torsion = "rigid" }`.'
    yield ""
    yield from [
        "| kind | keys of `stiffness` and `damping` | always fixed | needs |",
        "|---|---|---|---|",
    ]
    for kind, rule in KINDS.items():
        keys = ", ".join(
            f"`{key}`"
            if (key,) == tuple(DOF_NAMES[dof] for dof in dofs)
            else f"`{key}` ({' '.join(DOF_NAMES[dof] for dof in dofs)})"
            for key, dofs in rule.keys.items()
        )
        fixed = " ".join(DOF_NAMES[dof] for dof in rule.fixed) or EMPTY
        needs = [f"`{key}`" for key in rule.required]
        needs += ["`axis`"] if rule.needs_axis else []
        needs += ["`normal`"] if rule.needs_normal else []
        yield f"| `{kind}` | {keys or EMPTY} | {fixed} | {', '.join(needs) or EMPTY} |"
