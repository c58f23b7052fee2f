"""The tree is what the design says: layers point left, modules form a DAG, heavy libraries stay in their adapters."""

import ast
import re
import sys
from collections.abc import Callable, Iterator
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
LAYERS = ("geometry", "meshing", "solvers", "reduction", "pipeline", "validation", "app")
ADAPTERS = {
    "gmsh": {"meshing"},
    "meshio": {"meshing"},
    "basix": {"solvers"},
    "dolfinx": {"solvers"},
    "ffcx": {"solvers"},
    "ufl": {"solvers"},
    "petsc4py": {"solvers"},
    "slepc4py": {"solvers"},
    "pydantic": {"pipeline"},
    "pint": {"pipeline"},
    "typer": {"app"},
    "click": {"app"},
    "rich": {"app"},
    "matplotlib": {"app"},
    "jinja2": {"app"},
    "vtk": {"app"},
    "vtkmodules": {"app"},
    "pyvista": {"app"},
}

MODULES = sorted(path for layer in LAYERS for path in (ROOT / layer).rglob("*.py"))
TREES = {path: ast.parse(path.read_text()) for path in MODULES}


def layer_of(path: Path) -> str:
    return path.relative_to(ROOT).parts[0]


def module_name(path: Path) -> str:
    return ".".join(("headstock", *path.relative_to(ROOT).with_suffix("").parts))


KNOWN = {module_name(path) for path in MODULES}


def imported_names(node: ast.AST) -> list[str]:
    """Modules an import statement names; ``from headstock.x import y`` counts as ``headstock.x.y`` where that is a module."""
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    if isinstance(node, ast.ImportFrom) and node.module is not None:
        inner = [f"{node.module}.{alias.name}" for alias in node.names]
        return [name if name in KNOWN else node.module for name in inner]
    return []


IMPORTS = {path: {name for node in ast.walk(tree) for name in imported_names(node)} for path, tree in TREES.items()}


def offenders(wrong: Callable[[Path], object]) -> dict[str, object]:
    """What is wrong with each module, by its place in the tree; empty when nothing is."""
    found = {str(path.relative_to(ROOT)): wrong(path) for path in MODULES}
    return {place: what for place, what in found.items() if what}


def test_a_module_imports_only_from_its_own_folder_or_folders_to_its_left() -> None:
    def wrong(path: Path) -> set[str]:
        allowed = LAYERS[: LAYERS.index(layer_of(path)) + 1]
        inside = {name for name in IMPORTS[path] if name == "headstock" or name.startswith("headstock.")}
        return {name for name in inside if name.split(".")[1:2] == [] or name.split(".")[1] not in allowed}

    assert offenders(wrong) == {}


def test_modules_form_a_directed_acyclic_graph() -> None:
    graph = {module_name(path): {name for name in IMPORTS[path] if name.startswith("headstock.")} for path in MODULES}
    order = list(TopologicalSorter(graph).static_order())
    assert set(graph) <= set(order)


def test_heavy_libraries_are_imported_only_in_their_adapter_folders() -> None:
    def wrong(path: Path) -> set[str]:
        libraries = {name.split(".")[0] for name in IMPORTS[path]}
        return {name for name in libraries & set(ADAPTERS) if layer_of(path) not in ADAPTERS[name]}

    assert offenders(wrong) == {}


def test_geometry_needs_numpy_and_nothing_else() -> None:
    def wrong(path: Path) -> set[str]:
        libraries = {name.split(".")[0] for name in IMPORTS[path]} - {"headstock", "numpy"}
        return libraries - sys.stdlib_module_names if layer_of(path) == "geometry" else set()

    assert offenders(wrong) == {}


def test_no_import_is_relative() -> None:
    def wrong(path: Path) -> list[int]:
        return [node.lineno for node in ast.walk(TREES[path]) if isinstance(node, ast.ImportFrom) and node.level > 0]

    assert offenders(wrong) == {}


def test_only_the_command_line_folder_imports_inside_functions() -> None:
    def wrong(path: Path) -> list[int]:
        functions = [node for node in ast.walk(TREES[path]) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)]
        late = [node.lineno for body in functions for node in ast.walk(body) if isinstance(node, ast.Import | ast.ImportFrom)]
        return [] if layer_of(path) == "app" else late

    assert offenders(wrong) == {}


FOLDERS = sorted({path.parent for path in MODULES})


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda folder: folder.relative_to(ROOT).as_posix())
def test_a_package_file_holds_a_docstring_and_nothing_else(folder: Path) -> None:
    tree = ast.parse((folder / "__init__.py").read_text())
    assert ast.get_docstring(tree)
    assert len(tree.body) == 1


@pytest.mark.parametrize("layer", LAYERS)
def test_a_folder_is_typed_mapped_and_linked(layer: str) -> None:
    assert (ROOT / layer / "py.typed").is_file()
    assert (ROOT / ".typing" / "headstock" / layer).resolve() == ROOT / layer
    (layers,) = (node.value for node in ast.parse((ROOT / "setup.py").read_text()).body if isinstance(node, ast.Assign))
    assert layer in ast.literal_eval(layers)


def test_a_module_that_is_named_in_a_string_exists() -> None:
    """Modules that children run and that are loaded late are named in strings, which no type checker follows."""
    pattern = re.compile(rf"headstock(\.({'|'.join(LAYERS)}))(\.\w+)+")

    def wrong(path: Path) -> set[str]:
        texts = {node.value for node in ast.walk(TREES[path]) if isinstance(node, ast.Constant) and isinstance(node.value, str)}
        return {text for text in texts if pattern.fullmatch(text) and text not in KNOWN}

    named = [path for path in MODULES if pattern.search(path.read_text())]
    assert len(named) > 100
    assert offenders(wrong) == {}


def test_headstock_is_a_namespace_without_a_file_of_its_own() -> None:
    assert not (ROOT / "__init__.py").exists()
    assert not (ROOT / ".typing" / "headstock" / "__init__.py").exists()


def test_no_module_shares_its_name_with_a_function_in_it() -> None:
    kinds = ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef
    assert offenders(lambda path: path.stem in {node.name for node in TREES[path].body if isinstance(node, kinds)}) == {}


def text_files() -> Iterator[Path]:
    folders = (*LAYERS, "tests", "benchmarks", "machines", "docs", "environment", ".ci")
    for folder in folders:
        for path in sorted((ROOT / folder).rglob("*")):
            if path.suffix in {".py", ".sh", ".md", ".toml", ".txt", ".yaml", ""} and path.is_file():
                yield path
    # a worktree has a file .git, which names the folder of the clone it belongs to
    yield from (
        path
        for path in sorted(ROOT.iterdir())
        if path.is_file() and path.suffix in {"", ".md", ".toml", ".in"} and path.name != ".git"
    )


def test_no_line_names_a_folder_of_one_machine_or_a_host_of_packages() -> None:
    # taken apart so that this file does not hold what it looks for
    folders = "|".join(rf"(?<![\w.$}}/])/{name}/\w" for name in ("work", "root", "home"))
    hosts = "|".join(re.escape(".".join(parts)) for parts in (("deb", "debian", "org"), ("pypi", "org"), ("pythonhosted", "org")))
    pattern = re.compile(f"{folders}|{hosts}")
    found = [
        f"{path.relative_to(ROOT)}:{number}: {line.strip()}"
        for path in text_files()
        for number, line in enumerate(path.read_text(errors="replace").splitlines(), start=1)
        if pattern.search(line)
    ]
    assert found == []
