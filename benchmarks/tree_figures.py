"""Figures of the tree itself: sizes, import chains, and the habits that make code hard to follow,
of commits beside the work tree.

``./headstock exec python3 benchmarks/tree_figures.py [--folders] [--list FIGURE] [COMMIT ...]``

What is counted, over the layers (folders linked below ``.typing/headstock``), not tests and
benchmarks:

- chain: the largest number of modules of which each imports the next; inside a layer, of modules of
  that layer only;
- untyped signature: a function with ``Any`` or ``Json`` in an annotation of a parameter or of what
  it returns;
- tuple bundle: a parameter, or what a function returns, is annotated ``tuple[...]`` with three or
  more entries that are not all alike. Where such a tuple goes on by position, the type checker does
  not see two entries of one type that changed places;
- unpacked parameter: the body unpacks a parameter into two or more names (``row, column = entry``):
  several things that travel as one. A vector unpacked into components is none: a parameter
  annotated as an array, a list, or a tuple of three alike or without an end;
- positional splat: ``f(a, *rest)`` where ``f`` is a function or class of this tree that takes named
  parameters only;
- undescribed function: public, at module level or a method, three or more parameters (``self``
  aside), no ``Args:``. Not counted are the commands of the command line: typer prints their
  docstring as the help text and describes each parameter by its own ``help=``.
"""

import argparse
import ast
import re
import statistics
import subprocess
import tarfile
import tempfile
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from io import BytesIO
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
UNTYPED = {"Any", "Json"}
VECTOR = re.compile(
    r"\w*Array|NDArray\[.+\]|list(\[.+\])?|Sequence\[.+\]|tuple\[(.+), (\.{3}|\2, \2)\]"
)
BUNDLE = 3  # entries of a tuple, and parameters of a function
Function = ast.FunctionDef | ast.AsyncFunctionDef


@dataclass(frozen=True)
class Tree:
    """The modules of one state of the code."""

    name: str
    sources: Mapping[str, str]
    """Text of each module by its place, such as ``geometry/frames.py``; without the files of
    packages.
    """

    @cached_property
    def modules(self) -> dict[str, ast.Module]:
        return {_module_name(place): ast.parse(text) for place, text in self.sources.items()}

    @cached_property
    def imports(self) -> dict[str, dict[str, str]]:
        """By module, what each imported name stands for: a module of the tree or
        ``module.name``.
        """
        return {name: dict(_imported(tree)) for name, tree in self.modules.items()}

    @cached_property
    def arrows(self) -> dict[str, set[str]]:
        """Modules of the tree that each module imports."""
        owners = {
            name: {_owner(full, self.modules) for full in names.values()}
            for name, names in self.imports.items()
        }
        return {
            name: {owner for owner in found if owner not in ("", name)}
            for name, found in owners.items()
        }

    @cached_property
    def functions(self) -> list[tuple[str, Function]]:
        """Every function with the module it is in."""
        return [
            (name, node)
            for name, tree in self.modules.items()
            for node in ast.walk(tree)
            if isinstance(node, Function)
        ]

    @cached_property
    def named_only(self) -> set[str]:
        """Functions and classes of the tree, as ``module.name``, that take named parameters and no
        ``*rest``.
        """
        return {
            f"{module}.{name}"
            for module, tree in self.modules.items()
            for name in _with_named_parameters(tree.body)
        }

    @cached_property
    def bundle_names(self) -> set[str]:
        """Names, as ``module.name``, that stand for a tuple bundle (``Key = tuple[str, int,
        float]``).
        """
        found = set()
        for module, tree in self.modules.items():
            for node in tree.body:
                if isinstance(node, ast.TypeAlias) and _is_bundle(node.value, {}):
                    found.add(f"{module}.{node.name.id}")
                elif (
                    isinstance(node, ast.Assign)
                    and isinstance(node.targets[0], ast.Name)
                    and _is_bundle(node.value, {})
                ):
                    found.add(f"{module}.{node.targets[0].id}")
        return found

    def bundles_known_in(self, module: str) -> dict[str, str]:
        """Names of a module that stand for tuple bundles, with their full names."""
        local = {
            full.rpartition(".")[2]: full
            for full in self.bundle_names
            if full.rpartition(".")[0] == module
        }
        return local | {
            name: full for name, full in self.imports[module].items() if full in self.bundle_names
        }

    @property
    def folders(self) -> Counter[str]:
        return Counter(str(Path(place).parent) for place in self.sources)

    def longest_chain(self, layer: str = "") -> int:
        """Modules in the longest chain of imports, of one layer where it is named."""
        inside = {name for name in self.modules if not layer or name.split(".")[1] == layer}
        lengths: dict[str, int] = {}

        def length(name: str) -> int:
            if name not in lengths:
                lengths[name] = 0  # a circle ends here instead of never
                lengths[name] = 1 + max(
                    (length(other) for other in self.arrows[name] & inside), default=0
                )
            return lengths[name]

        return max(map(length, inside), default=0)


def list_layers(root: Path) -> list[str]:
    """Names of the folders that are linked as layers, and of the front door where there is one."""
    names = {link.name for link in (root / ".typing" / "headstock").iterdir()} | {"api"}
    return sorted(name for name in names if (root / name).is_dir())


def read_work_tree() -> Tree:
    """The files as they are on disk."""
    layers = list_layers(ROOT)
    places = [
        path.relative_to(ROOT).as_posix()
        for layer in layers
        for path in sorted((ROOT / layer).rglob("*.py"))
    ]
    return Tree(
        "work tree",
        {
            place: (ROOT / place).read_text()
            for place in places
            if not place.endswith("__init__.py")
        },
    )


def read_commit(commit: str) -> Tree:
    """The files of a commit."""
    archive = subprocess.run(
        ["git", "archive", commit], cwd=ROOT, capture_output=True, check=True
    ).stdout
    with tempfile.TemporaryDirectory() as folder, tarfile.open(fileobj=BytesIO(archive)) as files:
        files.extractall(folder, filter="data")
        top = Path(folder)
        layers = list_layers(top)
        paths = [
            path
            for layer in layers
            for path in sorted((top / layer).rglob("*.py"))
            if path.name != "__init__.py"
        ]
        return Tree(commit, {path.relative_to(top).as_posix(): path.read_text() for path in paths})


def find_habits(tree: Tree) -> dict[str, list[str]]:
    """Places of each habit, by the name of its figure."""
    found: dict[str, list[str]] = {
        "signatures with Any or Json": [],
        "tuple bundles as parameters": [],
        "tuple bundles returned": [],
        "parameters unpacked in the body": [],
        "positional splats into named parameters": list(_find_splats(tree)),
        f"public functions of {BUNDLE} or more parameters without Args:": list(
            _find_undescribed(tree)
        ),
    }
    for module, node in tree.functions:
        place = f"{module}:{node.lineno} {node.name}"
        known = tree.bundles_known_in(module)
        parameters = [
            given.annotation for given in _parameters(node) if given.annotation is not None
        ]
        if any(
            _names(note) & UNTYPED
            for note in [*parameters, *([node.returns] if node.returns else [])]
        ):
            found["signatures with Any or Json"].append(place)
        found["parameters unpacked in the body"] += [
            f"{place}: {unpacked}" for unpacked in _find_unpacked(node)
        ]
        found["tuple bundles as parameters"] += [
            place for note in parameters if _is_bundle(note, known)
        ]
        found["tuple bundles returned"] += [
            place for note in [node.returns] if note is not None and _is_bundle(note, known)
        ]
    return found


def collect_figures(tree: Tree) -> dict[str, str]:
    """Every figure as text, by its name."""
    lines = [len(text.splitlines()) for text in tree.sources.values()]
    (largest, most), *_ = tree.folders.most_common(1)
    layers = sorted({place.split("/")[0] for place in tree.sources})
    inside, layer = max((tree.longest_chain(layer), layer) for layer in layers)
    return {
        "modules": str(len(lines)),
        "lines": str(sum(lines)),
        "lines per module, median / largest": f"{statistics.median(lines):.0f} / {max(lines)}",
        "folders": str(len(tree.folders)),
        "largest folder": f"{most} ({largest})",
        "longest import chain": str(tree.longest_chain()),
        "longest import chain inside a layer": f"{inside} ({layer})",
        **{name: str(len(places)) for name, places in find_habits(tree).items()},
    }


def _module_name(place: str) -> str:
    return ".".join(("headstock", *Path(place).with_suffix("").parts))


def _imported(tree: ast.Module) -> Iterator[tuple[str, str]]:
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module:
            yield from (
                (alias.asname or alias.name, f"{node.module}.{alias.name}") for alias in node.names
            )
        elif isinstance(node, ast.Import):
            yield from ((alias.asname or alias.name, alias.name) for alias in node.names)


def _owner(full: str, modules: Mapping[str, ast.Module]) -> str:
    """The module that a full name is in, or is; empty where it is none of the tree's."""
    return next((name for name in (full, full.rpartition(".")[0]) if name in modules), "")


def _parameters(node: Function) -> list[ast.arg]:
    given = node.args
    return [
        *given.posonlyargs,
        *given.args,
        *given.kwonlyargs,
        *(more for more in (given.vararg, given.kwarg) if more),
    ]


def _names(note: ast.expr) -> set[str]:
    """Words of an annotation, those in quotes included."""
    return set(re.findall(r"\w+", ast.unparse(note)))


def _is_bundle(note: ast.expr, names: Mapping[str, str]) -> bool:
    """Whether an annotation is a tuple of several unlike things, by a name of it, alone or in a
    union.
    """
    if isinstance(note, ast.BinOp):
        return _is_bundle(note.left, names) or _is_bundle(note.right, names)
    if isinstance(note, ast.Name):
        return note.id in names
    if not (
        isinstance(note, ast.Subscript)
        and ast.unparse(note.value) == "tuple"
        and isinstance(note.slice, ast.Tuple)
    ):
        return False
    entries = [ast.unparse(entry) for entry in note.slice.elts]
    return len(entries) >= BUNDLE and "..." not in entries and len(set(entries)) > 1


def _find_unpacked(node: Function) -> Iterator[str]:
    """Assignments of a body, also several at once, that unpack a parameter which is no vector."""
    notes = {
        given.arg: ast.unparse(given.annotation) if given.annotation else ""
        for given in _parameters(node)
    }
    for made in (inner for inner in ast.walk(node) if isinstance(inner, ast.Assign)):
        target, value = made.targets[0], made.value
        several = isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple)
        targets, values = (
            list(ast.iter_child_nodes(each)) if several else [each] for each in (target, value)
        )
        for names, source in zip(targets, values, strict=False):
            if (
                isinstance(names, ast.Tuple)
                and isinstance(source, ast.Name)
                and not VECTOR.fullmatch(notes.get(source.id, "list"))
            ):
                yield f"{ast.unparse(names)} = {source.id}"


def _with_named_parameters(body: list[ast.stmt]) -> Iterator[str]:
    for node in body:
        if isinstance(node, ast.ClassDef):
            starts = [
                made for made in node.body if isinstance(made, Function) and made.name == "__init__"
            ]
            fields = [field for field in node.body if isinstance(field, ast.AnnAssign)]
            if all(start.args.vararg is None for start in starts) if starts else fields:
                yield node.name
        elif isinstance(node, Function) and node.args.vararg is None:
            yield node.name


def _find_splats(tree: Tree) -> Iterator[str]:
    for module, code in tree.modules.items():
        known = {
            name.rpartition(".")[2]: name
            for name in tree.named_only
            if name.rpartition(".")[0] == module
        }
        known |= tree.imports[module]
        for node in ast.walk(code):
            if not (
                isinstance(node, ast.Call)
                and any(isinstance(given, ast.Starred) for given in node.args)
            ):
                continue
            owner, _, attribute = ast.unparse(node.func).rpartition(".")
            full = f"{known.get(owner, owner)}.{attribute}" if owner else known.get(attribute, "")
            if full in tree.named_only:
                yield f"{module}:{node.lineno} {ast.unparse(node)[:100]}"


def _find_undescribed(tree: Tree) -> Iterator[str]:
    commands = set(_list_commands(tree))
    for module, code in tree.modules.items():
        owners: list[ast.Module | ast.ClassDef] = [
            code,
            *(node for node in code.body if isinstance(node, ast.ClassDef)),
        ]
        for node in (node for owner in owners for node in owner.body if isinstance(node, Function)):
            given = [each.arg for each in _parameters(node) if each.arg not in ("self", "cls")]
            reported = (
                node.name.startswith("_")
                or f"{module}.{node.name}" in commands
                or "Args:" in (ast.get_docstring(node) or "")
            )
            if len(given) >= BUNDLE and not reported:
                yield f"{module}:{node.lineno} {node.name}"


def _list_commands(tree: Tree) -> Iterator[str]:
    """Full names of the functions in a tuple ``COMMANDS``, which the command line registers."""
    for module, code in tree.modules.items():
        for node in code.body:
            if (
                isinstance(node, ast.Assign)
                and ast.unparse(node.targets[0]) == "COMMANDS"
                and isinstance(node.value, ast.Tuple)
            ):
                owned = [each for each in node.value.elts if isinstance(each, ast.Attribute)]
                yield from (
                    f"{tree.imports[module].get(ast.unparse(each.value), '')}.{each.attr}"
                    for each in owned
                )


def main() -> None:
    """Prints one column for each commit and one for the work tree."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0] if __doc__ else "")
    parser.add_argument("commits", nargs="*", metavar="COMMIT")
    parser.add_argument("--folders", action="store_true", help="modules of each folder, too")
    parser.add_argument(
        "--list",
        metavar="FIGURE",
        help="print the places in the work tree counted for figures with these words",
    )
    options = parser.parse_args()
    trees = [*map(read_commit, options.commits), read_work_tree()]
    rows = [collect_figures(tree) for tree in trees]
    print(f"{'':62}", *(f"{tree.name[:24]:>24}" for tree in trees))
    for name in rows[0]:
        print(f"{name:62}", *(f"{row[name]:>24}" for row in rows))
    if options.folders:
        for folder in sorted({folder for tree in trees for folder in tree.folders}):
            print(f"{'  ' + folder:62}", *(f"{tree.folders[folder] or '–':>24}" for tree in trees))
    if options.list:
        places = [
            place
            for name, found in find_habits(trees[-1]).items()
            if options.list in name
            for place in found
        ]
        print(*places, sep="\n")


if __name__ == "__main__":
    main()
