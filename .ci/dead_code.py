"""Dead code by vulture; keys of typed dictionaries are read by their strings, which vulture does
not see.
"""

import ast
import subprocess
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def typed_keys(folders: list[str]) -> set[str]:
    """Keys of all classes that derive from ``TypedDict``."""
    classes = [
        node
        for folder in folders
        for path in (ROOT / folder).rglob("*.py")
        for node in ast.parse(path.read_text()).body
        if isinstance(node, ast.ClassDef)
    ]
    typed = {"TypedDict"}
    while (
        found := {
            node.name for node in classes if {ast.unparse(base) for base in node.bases} & typed
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


settings = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["vulture"]
names = [*settings["ignore_names"], *sorted(typed_keys(settings["paths"]))]
raise SystemExit(
    subprocess.run(["vulture", "--ignore-names", ",".join(names)], cwd=ROOT, check=False).returncode
)
