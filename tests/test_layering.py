"""The tree is what it says: layers and rooms point one way, modules form no circle, heavy libraries
stay in their rooms.
"""

import ast
import functools
import re
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

from headstock.pipeline.storage.content_keys import MESH_CODE, REDUCTION_ROOMS

ROOT = Path(__file__).resolve().parent.parent
# A layer imports from those before it; scene and reduction stand side by side, and of meshing a
# scene sees the sizes, and the process that reads files of strangers.
LAYERS = (
    "geometry",
    "meshing",
    "solvers",
    "reduction",
    "scene",
    "pipeline",
    "studies",
    "validation",
    "app",
)
# The folder that is the package headstock itself: its front door, beside app.
DOOR = "api"
APART = {("scene", "reduction"), (DOOR, "app"), (DOOR, "validation")}
# What the files of a layer that are in no room are: nouns that its rooms import, or doors that
# import its rooms.
GROUNDS = {"geometry", "meshing", "solvers", "reduction", "scene", "studies"}
BELOW_THE_GROUND = {("scene", "reading")}  # the nouns of a scene know where they were written
# Which rooms of its own layer a room may import from.
ROOMS: dict[str, dict[str, set[str]]] = {
    "geometry": {
        "parts": set(),
        "mechanisms": set(),
        "machine": {"parts", "mechanisms"},
        "assemblies": {"parts", "machine"},
    },
    "meshing": {
        "process": set(),
        "elements": {"process"},
        "files": {"process", "elements"},
        "cad": {"process", "elements", "files"},
        "components": {"process", "elements", "files"},
        "assemblies": {"process", "elements", "files", "cad", "components"},
    },
    "solvers": {
        "recovery": set(),
        "elastic": {"recovery"},
        "linear": set(),
        "pairing": {"linear"},
        "modal_fitting": {"linear", "pairing"},
        "mechanisms": set(),
        "state_spaces": {"linear"},
        "control": {"linear", "state_spaces"},
        "motion": {"linear", "state_spaces", "mechanisms", "control"},
        "milling": {"linear", "mechanisms", "motion"},
    },
    "reduction": {
        "components": set(),
        "coupling": set(),
        "motions": {"components", "coupling"},
        "estimates": {"components", "coupling", "motions"},
    },
    "scene": {
        "reading": set(),
        "test_data": {"reading"},
        "schema": {"reading"},
        "expansion": {"reading", "schema"},
        "assemblies": {"reading", "expansion"},
        "building": {"reading", "schema", "expansion", "test_data"},
        "analyses": {"reading", "schema", "expansion", "building"},
    },
    "pipeline": {
        "planning": {"storage"},
        "storage": set(),
        "exchange": {"storage"},
        "numbers": {"storage"},
        "answers": {"planning", "storage", "numbers"},
        "results": {"planning", "storage", "numbers", "answers"},
        "stages": {"planning", "storage", "exchange", "numbers", "answers", "results"},
        "preview": {"planning", "storage", "exchange", "numbers", "answers", "results", "stages"},
        "motion": {"planning", "storage", "numbers", "answers", "results", "stages"},
        "lobes": {"planning", "storage", "numbers", "answers", "results", "stages"},
        "accuracy": {"planning", "storage", "numbers", "answers", "results", "stages", "motion"},
    },
    "studies": {
        "parameters": set(),
        "sweeps": set(),
        "identification": set(),
        "correlation": {"identification"},  # it writes what identify reads
    },
    "validation": {
        "references": set(),
        "parts": {"references"},
        "mechanisms": {"references", "parts"},
        "coverage": {"references", "parts"},
        "machines": {"references", "parts", "mechanisms", "coverage"},
        "refinement": {"references", "parts", "mechanisms"},
    },
    "app": {
        "texts": set(),
        "tables": {"texts"},
        "pictures": set(),
        "drawings": {"texts", "tables"},
        "views": {"texts", "tables", "drawings"},
        "terminal": {"texts", "tables", "pictures", "views"},
        "charts": {"texts", "tables", "pictures", "drawings"},
        "report": {"texts", "tables", "pictures", "drawings", "views"},
        "commands": {"terminal"},
        "actions": {
            *("texts", "tables", "pictures", "terminal", "charts", "report", "views", "commands"),
        },
    },
}
MOST_MODULES = 20  # in a folder: what is longer is no longer seen at a glance
ADAPTERS = {
    "gmsh": {"meshing/cad", "meshing/files", "meshing/assemblies", "validation/coverage"},
    "meshio": {"meshing/files"},
    "netCDF4": {"meshing/files"},
    "basix": {"solvers/elastic", "solvers/recovery"},
    "dolfinx": {"solvers/elastic"},
    "ffcx": {"solvers/elastic"},
    "ufl": {"solvers/elastic"},
    "petsc4py": {"solvers/elastic"},
    "slepc4py": {"solvers/elastic"},
    "pydantic": {
        "scene/schema",
        "scene/analyses",
        "scene/expansion",
        "studies/identification",
        DOOR,
    },
    "typer": {"app", "app/commands", "app/actions", "app/terminal"},
    "click": {"app", "app/commands", "app/actions", "app/terminal"},
    "rich": {"app", "app/terminal", "app/actions", "app/commands"},
    "matplotlib": {"app/charts", "app/pictures"},
    "jinja2": {"app/report", "app/actions"},
    "PIL": {"app/pictures", "app/drawings"},
    "pandas": {"pipeline/storage"},
    "pyvista": {"app/pictures", "pipeline/results"},
    "vtkmodules": {"meshing/components"},
}
# Libraries that read files of the working folder while they start, and the modules that import them:
# adapters of geometry/loading.py, and modules of meshing, which children and exports load there.
LOADERS = {
    "mpi4py": {"solvers/mpi.py"},
    "h5py": {
        "meshing/process/plain_hdf5.py",
        *(f"meshing/files/{name}.py" for name in ("exodus", "hdf5", "writing")),
    },
    "basix": {"solvers/recovery/libraries.py"},
    "matplotlib": {"app/pictures/libraries.py"},
    "pyvista": {
        "app/pictures/renderer.py",
        *(f"pipeline/results/{name}.py" for name in ("meshes", "results", "files")),
    },
    **{
        name: {"solvers/elastic/libraries.py"}
        for name in ("dolfinx", "ffcx", "petsc4py", "slepc4py", "ufl")
    },
}

MODULES = sorted(path for layer in (*LAYERS, DOOR) for path in (ROOT / layer).rglob("*.py"))
FOLDERS = sorted({path.parent for path in MODULES})


def layer_of(path: Path) -> str:
    return path.relative_to(ROOT).parts[0]


def module_name(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(("headstock", *(parts[1:] if parts[0] == DOOR else parts)))


def room_of(path: Path) -> str:
    """Name of the room inside its layer; empty for the layer's own files."""
    parts = path.relative_to(ROOT).parts
    return parts[1] if len(parts) == 3 else ""


KNOWN = {module_name(path) for path in MODULES}
PACKAGES = {name.removesuffix(".__init__") for name in KNOWN}


def imported_names(node: ast.AST) -> list[str]:
    """Modules an import statement names; ``from headstock.x import y`` counts as ``headstock.x.y``
    where that is a module.
    """
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    if isinstance(node, ast.ImportFrom) and node.module is not None:
        inner = [f"{node.module}.{alias.name}" for alias in node.names]
        return [name if name in KNOWN else node.module for name in inner]
    return []


@functools.cache
def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text())


@functools.cache
def imports_of(path: Path) -> frozenset[str]:
    return frozenset(name for node in ast.walk(tree_of(path)) for name in imported_names(node))


def offenders(wrong: Callable[[Path], object]) -> dict[str, object]:
    """What is wrong with each module, by its place in the tree; empty when nothing is."""
    found = {str(path.relative_to(ROOT)): wrong(path) for path in MODULES}
    return {place: what for place, what in found.items() if what}


def may_import(importer: tuple[str, str], imported: tuple[str, str]) -> bool:
    """Whether a module of one (layer, room) may import from another."""
    (layer, room), (other, other_room) = importer, imported
    if layer != other:
        if (layer, other) == ("scene", "meshing"):
            return other_room in ("", "process")
        order = (*LAYERS, DOOR)
        return order.index(other) < order.index(layer) and (layer, other) not in APART
    if room == other_room:
        return True
    if room == "":
        return layer not in GROUNDS or (layer, other_room) in BELOW_THE_GROUND
    if other_room == "":
        return layer in GROUNDS and (layer, room) not in BELOW_THE_GROUND
    return other_room in ROOMS[layer][room]


PLACES = {module_name(path): (layer_of(path), room_of(path)) for path in MODULES}


def libraries_of(path: Path) -> set[str]:
    return {name.split(".")[0] for name in imports_of(path)}


def later_modules(path: Path) -> set[str]:
    """Modules of layers and rooms that are not before its own; a layer as a whole is imported for
    its folder only, where its code is part of a key.
    """
    mine = (layer_of(path), room_of(path))
    return {n for n in imports_of(path) if n in PLACES and not may_import(mine, PLACES[n])}


def unknown_modules(path: Path) -> set[str]:
    layers = {f"headstock.{layer}" for layer in LAYERS}
    inside = {name for name in imports_of(path) if name.split(".")[0] == "headstock"}
    return inside - KNOWN - layers


def heavy_libraries(path: Path) -> set[str]:
    """Libraries outside of their adapter folders."""
    folder = path.parent.relative_to(ROOT).as_posix()
    return {n for n in libraries_of(path) & set(ADAPTERS) if folder not in ADAPTERS[n]}


def early_libraries(path: Path) -> set[str]:
    """Libraries that read the working folder, elsewhere than where they are loaded apart."""
    place = path.relative_to(ROOT).as_posix()
    return {name for name in libraries_of(path) & set(LOADERS) if place not in LOADERS[name]}


def libraries_of_geometry(path: Path) -> set[str]:
    """What geometry needs besides numpy."""
    others = libraries_of(path) - {"headstock", "numpy"} - sys.stdlib_module_names
    return others if layer_of(path) == "geometry" else set()


def relative_imports(path: Path) -> list[int]:
    nodes = (node for node in ast.walk(tree_of(path)) if isinstance(node, ast.ImportFrom))
    return [node.lineno for node in nodes if node.level > 0]


def late_imports(path: Path) -> list[int]:
    """Imports inside functions, which only the folder of the command line has."""
    kinds = ast.FunctionDef | ast.AsyncFunctionDef
    bodies = (node for node in ast.walk(tree_of(path)) if isinstance(node, kinds))
    inside = (node for body in bodies for node in ast.walk(body))
    late = [node.lineno for node in inside if isinstance(node, ast.Import | ast.ImportFrom)]
    return [] if layer_of(path) == "app" else late


def names_of_the_module(path: Path) -> set[str]:
    """What a module defines under its own name."""
    kinds = ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef
    return {n.name for n in tree_of(path).body if isinstance(n, kinds)} & {path.stem}


RULES: tuple[Callable[[Path], object], ...] = (
    *(later_modules, unknown_modules, heavy_libraries, early_libraries, libraries_of_geometry),
    *(relative_imports, late_imports, names_of_the_module),
)


@pytest.mark.parametrize("rule", RULES)
def test_no_module_imports_or_names_what_it_may_not(rule: Callable[[Path], object]) -> None:
    assert len(MODULES) > 400
    assert offenders(rule) == {}


def test_every_room_is_in_the_table_and_rooms_form_no_circle() -> None:
    found = {layer: {room for each, room in PLACES.values() if each == layer} for layer in LAYERS}
    assert found == {layer: {"", *rooms} for layer, rooms in ROOMS.items()}
    for rooms in ROOMS.values():
        assert len(list(TopologicalSorter(rooms).static_order())) == len(rooms)


def test_a_folder_is_seen_at_a_glance() -> None:
    sizes = Counter(path.parent for path in MODULES if path.stem != "__init__")
    assert len(sizes) > 40
    assert {folder: size for folder, size in sizes.items() if size > MOST_MODULES} == {}


def test_modules_form_a_directed_acyclic_graph() -> None:
    graph = {
        module_name(path): {name for name in imports_of(path) if name.startswith("headstock.")}
        for path in MODULES
    }
    order = list(TopologicalSorter(graph).static_order())
    assert set(graph) <= set(order)


def test_a_package_file_holds_a_docstring_and_nothing_else() -> None:
    packages = [path for path in MODULES if path.name == "__init__.py"]
    packages = [path for path in packages if path.parent.name != DOOR]
    assert {path.parent for path in packages} == {path for path in FOLDERS if path.name != DOOR}
    trees = {path: tree_of(path) for path in packages}
    plain = [path for path, t in trees.items() if ast.get_docstring(t) and len(t.body) == 1]
    assert len(plain) == len(packages) > len(LAYERS)


@pytest.mark.parametrize("layer", LAYERS)
def test_a_folder_is_typed_mapped_and_linked(layer: str) -> None:
    assert (ROOT / layer / "py.typed").is_file()
    assert (ROOT / ".typing" / "headstock" / layer).resolve() == ROOT / layer
    (layers,) = (
        node.value
        for node in ast.parse((ROOT / "setup.py").read_text()).body
        if isinstance(node, ast.Assign)
    )
    assert layer in ast.literal_eval(layers)


def test_a_module_that_is_named_in_a_string_exists() -> None:
    """Modules that children run and that are loaded late are named in strings, which no type
    checker follows.
    """
    pattern = re.compile(rf"(headstock(?:\.(?:{'|'.join(LAYERS)}))(?:\.\w+)+)(:\w+)?")
    functions = {
        f"{module_name(path)}:{node.name}"
        for path in MODULES
        for node in tree_of(path).body
        if isinstance(node, ast.FunctionDef)
    }

    def wrong(path: Path) -> set[str]:
        constants = (node for node in ast.walk(tree_of(path)) if isinstance(node, ast.Constant))
        texts = {node.value for node in constants if isinstance(node.value, str)}
        return {text for text in texts if pattern.fullmatch(text)} - KNOWN - PACKAGES - functions

    named = [path for path in MODULES if pattern.search(path.read_text())]
    assert len(named) > 100
    assert offenders(wrong) == {}


def test_there_is_one_form_of_a_number_and_one_maker_of_a_run() -> None:
    """Second forms that were folded into ``pipeline/numbers`` do not come back."""
    old = re.compile(r"NumberChange|ResponseNumber|WatchedSeries|WatchedAnswers")

    def wrong(path: Path) -> set[str]:
        if layer_of(path) not in ("pipeline", "studies"):
            return set()
        classes = {node.name for node in ast.walk(tree_of(path)) if isinstance(node, ast.ClassDef)}
        return {name for name in classes if old.fullmatch(name) or name.endswith("Worth")}

    assert offenders(wrong) == {}
    assert "headstock.studies.answers" not in KNOWN
    made = re.compile(r"(?<![\w.])RunState\(")
    makers = offenders(lambda path: made.search(path.read_text()))
    own = "pipeline/stages/run_state.py"
    assert {*makers} - {own} == {"pipeline/stages/shared_components.py"}
    light = closure_of("headstock.pipeline.numbers.folders")
    assert not [name for name in light if ".answers." in name or ".solvers." in name]


def test_the_front_door_is_the_package_itself() -> None:
    mapped = ROOT / ".typing" / "headstock"
    files = {path.name for path in (ROOT / DOOR).iterdir() if path.is_file()}
    links = {link.name for link in mapped.iterdir() if link.is_symlink()}
    assert files == links - set(LAYERS)
    assert all((mapped / name).resolve() == ROOT / DOOR / name for name in files)
    assert '"headstock": "api"' in (ROOT / "setup.py").read_text()
    assert not (ROOT / "__init__.py").exists()


def closure_of(start: str) -> set[str]:
    """Modules that a module imports, and what these import."""
    named = {module_name(path): imports_of(path) & KNOWN for path in MODULES}
    found, waiting = set(), {start}
    while waiting:
        found |= waiting
        waiting = set().union(*(named[name] for name in waiting)) - found
    return found


@pytest.mark.parametrize(
    "start",
    ["reduction.components.elastic", "meshing.components.meshing", "meshing.components.skins"],
)
def test_the_keys_of_the_store_cover_every_module_that_an_entry_is_computed_by(start: str) -> None:
    whole, grounds = {package.__name__ for package in MESH_CODE}, set()
    if start.startswith("reduction"):
        whole |= {f"{package.__name__}.{room}" for package, room in REDUCTION_ROOMS}
        grounds |= {package.__name__ for package, _ in REDUCTION_ROOMS}
    used = closure_of(f"headstock.{start}")
    assert len(used) > 10
    covered = {name for name in used if any(name.startswith(f"{package}.") for package in whole)}
    covered |= {name for name in used if name.rpartition(".")[0] in grounds}
    assert used - covered == set()


def text_files() -> Iterator[Path]:
    folders = (*LAYERS, DOOR, "tests", "benchmarks", "machines", "docs", "environment", ".ci")
    kinds = {".py", ".sh", ".md", ".toml", ".txt", ".yaml", ".in", ""}
    paths = [path for folder in folders for path in sorted((ROOT / folder).rglob("*"))]
    for path in (*paths, *sorted(ROOT.iterdir())):
        # a worktree has a file .git, which names the folder of the clone it belongs to
        if path.suffix in kinds and path.is_file() and path.name != ".git":
            yield path


def test_no_line_names_a_folder_of_one_machine_or_a_host_of_packages() -> None:
    # taken apart so that this file does not hold what it looks for
    folders = "|".join(rf"(?<![\w.$}}/])/{name}/\w" for name in ("work", "root", "home"))
    hosts = "|".join(
        re.escape(".".join(parts))
        for parts in (("deb", "debian", "org"), ("pypi", "org"), ("pythonhosted", "org"))
    )
    pattern = re.compile(f"{folders}|{hosts}")
    found = [
        f"{path.relative_to(ROOT)}:{number}: {line.strip()}"
        for path in text_files()
        for number, line in enumerate(path.read_text(errors="replace").splitlines(), start=1)
        if pattern.search(line)
    ]
    assert found == []
