"""The scene reference as Markdown, made from the schema: ``headstock schema --markdown >
docs/scene_reference.md``.
"""

from collections.abc import Iterator

from headstock.app.actions.editor_schema import rules_in
from headstock.geometry.frames import DOF_NAMES
from headstock.pipeline.storage.json_texts import JsonTable, JsonValue
from headstock.scene.building.joints import KINDS
from headstock.scene.schema.types import DEFAULT, MEANING

INTRODUCTION = """\
# Scene reference

Made from the schema by `./headstock schema --markdown > docs/scene_reference.md`; a test asserts that it is up to date.

A scene is a TOML file. Keys that are not listed here are errors, with a suggestion. Quantities are texts with a unit (`"210 GPa"`,
`"380 N/um"`, `"12.5 mm"`, `"30 deg"`); plain numbers are for what has no dimension. Names are letters, digits, `_` and `-`. A key in
square brackets names a table; `NAME` is yours to choose. `component.interface` and `ground` name the ends of joints. Files that a
scene names lie in its folder or below.

The column *value* states what a key takes, with its limits where it has any; whole numbers go up to 10 million, and a quantity far
beyond any machine is refused as a slip of units. The column *default* states what holds where a key is left out: a **required** key
cannot be, of the keys marked **one of these** a table has exactly one, and *none* means that nothing is there.
"""
EMPTY = "none"


def render_reference(schema: JsonTable) -> str:
    """The reference of all keys as Markdown."""
    parts = [
        INTRODUCTION,
        "## The file",
        "",
        str(schema.get("description", "")),
        "",
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
        *_key_table(label, table),
    ]
    for key, rule in rules_in(table, "properties").items():
        inner = _table_of(rule)
        if inner is not None:
            below = f"{path}.{key}.NAME" if "additionalProperties" in rule else f"{path}.{key}"
            yield from _section(schema, inner, below, seen, level=3)


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
        return " or ".join(
            _describe_value(option) for option in _options(rule) if option.get("type") != "null"
        )
    if "$ref" in rule:
        return "table"
    if "const" in rule:
        return f"`{_show(rule['const'])}`"
    if "enum" in rule:
        return ", ".join(f"`{option}`" for option in _items(rule, "enum"))
    if "description" in rule:
        examples = ", ".join(f"`{_show(example)}`" for example in _items(rule, "examples"))
        return (
            f"{rule['description']}, such as {examples}" if examples else str(rule["description"])
        )
    if rule.get("type") == "array":
        inner = rule.get("items")
        if "examples" in rule:
            return f"list, such as `{_show(_items(rule, 'examples')[0])}`"
        count = _describe_count(rule.get("minItems"), rule.get("maxItems"))
        return (
            f"list of {count}{' × ' if count else ''}({_describe_value(inner)})"
            if isinstance(inner, dict) and inner
            else f"list of {count} values"
        )
    if rule.get("type") == "object":
        inner = rule.get("additionalProperties")
        if not isinstance(inner, dict) or not inner:
            return "table"
        count = _describe_count(rule.get("minProperties"), rule.get("maxProperties"))
        return f"table of {count}{' ' if count else ''}names: {_describe_value(inner)}"
    kind = str(rule.get("type", ""))
    words = {"string": "text", "boolean": "`true`, `false`", "integer": "whole number"}
    return words.get(kind, kind) + _describe_limits(rule)


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
