"""Dead code by vulture; keys of typed dictionaries and of tables of a scene are read by texts that
hold them, and what is loaded late is named in a text ``module:name``, which vulture does not see.
"""

import ast
import re
import tomllib
from pathlib import Path

from vulture import Vulture

ROOT = Path(__file__).resolve().parent.parent


def fields_of(kind: str, folders: list[str]) -> set[str]:
    """Fields of all classes that derive from one."""
    classes = [
        node
        for folder in folders
        for path in (ROOT / folder).rglob("*.py")
        for node in ast.parse(path.read_text()).body
        if isinstance(node, ast.ClassDef)
    ]
    typed = {kind}
    while (
        found := {
            node.name
            for node in classes
            if {ast.unparse(base).rpartition(".")[2] for base in node.bases} & typed
        }
        - typed
    ):
        typed |= found
    fields = [
        field.target
        for node in classes
        if node.name in typed
        for field in node.body
        if isinstance(field, ast.AnnAssign)
    ]
    return {target.id for target in fields if isinstance(target, ast.Name)}


def named_in_texts(form: str, folders: list[str]) -> set[str]:
    """Names in texts of a form."""
    return {
        match.group(1)
        for folder in folders
        for path in (ROOT / folder).rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
        if (match := re.fullmatch(form, node.value))
    }


settings = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["vulture"]
# vulture compares every name with every pattern; the keys are so many that they are looked up here
vulture = Vulture(
    ignore_names=settings["ignore_names"], ignore_decorators=settings["ignore_decorators"]
)
paths = settings["paths"]
keys = (
    fields_of("TypedDict", paths)
    | (fields_of("StrictTable", paths) & named_in_texts(r"(\w+)", paths))
    | named_in_texts(r"[\w.]+:(\w+)", paths)
)
vulture.scavenge([str(ROOT / path) for path in paths])
found = [
    item for item in vulture.get_unused_code(settings["min_confidence"]) if item.name not in keys
]
for item in found:
    print(item.get_report())
raise SystemExit(bool(found))
