"""Writes api/__init__.pyi: what type checkers and editors know of ``import headstock``. The keys of
each noun are those of the schema of scenes.
"""

import keyword
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import headstock
from headstock.app.actions.schemas import plain_schema, rules_in
from headstock.machine import Noun
from headstock.pipeline.storage.json_texts import JsonTable, JsonValue

STUB = Path(__file__).resolve().parents[1] / "api" / "__init__.pyi"
HEAD = """# fmt: off
# ruff: noqa: E501, I001
# written by .ci/stub.py
from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from headstock.machine import Noun
from headstock.scene.schema import axes, components, joints, loads, sensors
from headstock.values import Quantity"""
ALIASES = """
type _Table = Noun | Mapping[str, object]
type _Numbers = Sequence[Quantity] | NDArray[np.floating[Any]]

__version__: str
__all__: list[str]"""
PLAIN = {"string": "str", "number": "float", "integer": "int", "boolean": "bool"}
QUANTITIES = (" with a unit", "ratio")  # in descriptions


def types_of(rule: JsonValue) -> Iterator[str]:
    """The types in Python of what a rule of the schema allows."""
    if not isinstance(rule, dict):
        yield "object"
    elif isinstance(options := rule.get("anyOf"), list):
        for option in options:
            yield from types_of(option)
    elif isinstance(values := rule.get("enum"), list):
        yield f"Literal[{', '.join(map(repr, values))}]"
    elif "const" in rule:
        yield f"Literal[{rule['const']!r}]"
    elif "$ref" in rule:
        yield "_Table"
    elif any(word in str(rule.get("description", "")) for word in QUANTITIES):
        yield "Quantity"
    elif rule.get("type") == "array":
        item = type_of(rule.get("items"))
        yield "_Numbers" if item in ("Quantity", "float") else f"Sequence[{item}]"
    elif rule.get("type") == "object":
        yield f"Mapping[str, {type_of(rule.get('additionalProperties'))}]"
    elif rule.get("type") != "null":
        yield PLAIN.get(str(rule.get("type")), "object")


def type_of(rule: JsonValue) -> str:
    """The same as one text."""
    return " | ".join(dict.fromkeys(types_of(rule)))


def write_noun(noun: type[Noun], table: JsonTable) -> str:
    """The class of a noun with its keys as keyword-only parameters."""
    required = table.get("required")
    needed = set(required if isinstance(required, list) else ())
    keys = rules_in(table, "properties")
    if "from" in keys:
        needed -= {"kind"}  # an element of the catalogue has it
    schema = f"{noun.schema.__module__.rpartition('.')[2]}.{noun.schema.__name__}"
    lines = [
        f"\nclass {noun.__name__}(Noun, schema={schema}):",
        "    def __init__(",
        "        self, *,",
    ]
    for key, rule in keys.items():
        name = f"{key}_" if keyword.iskeyword(key) else key
        end = "," if key in needed else " | None = ...,"
        lines.append(f"        {name}: {type_of(rule)}{end}")
    return "\n".join([*lines, "    ) -> None: ..."])


def render_stub() -> str:
    """The text of the stub."""
    definitions = rules_in(plain_schema(), "$defs")
    imports, classes = [], []
    for name, home in headstock._HOME_OF.items():
        found = getattr(import_module(home), name)
        if home == "headstock.nouns" and "__init__" not in vars(found):
            table = definitions[found.schema.__name__.lstrip("_")]
            inner = rules_in(table, "properties").get(found.only_key, table)
            if found.only_key:
                inner = definitions[f"{found.only_key.capitalize()}Table"]
            classes.append(write_noun(found, inner))
        else:
            imports.append(f"from {home} import {name} as {name}")
    return "\n".join([HEAD, *sorted(imports), ALIASES, *classes, ""])


if __name__ == "__main__":
    STUB.write_text(render_stub())
