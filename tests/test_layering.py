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
    "geometry": {"parts": set(), "mechanisms": set(), "machine": {"parts", "mechanisms"}},
    "meshing": {
        "process": set(),
        "elements": {"process"},
        "files": {"process", "elements"},
        "cad": {"process", "elements", "files"},
        "components": {"process", "elements", "files"},
    },
    "solvers": {
        "recovery": set(),
        "elastic": {"recovery"},
        "linear": set(),
        "pairing": {"linear"},
        "mechanisms": set(),
        "control": {"linear"},
        "motion": {"linear", "mechanisms", "control"},
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
        "schema": {"reading"},
        "expansion": {"reading", "schema"},
        "building": {"reading", "schema", "expansion"},
        "analyses": {"reading", "schema", "expansion", "building"},
    },
    "pipeline": {
        "planning": {"storage"},
        "storage": set(),
        "numbers": {"storage"},
        "answers": {"planning", "storage", "numbers"},
        "results": {"planning", "storage", "numbers", "answers"},
        "stages": {"planning", "storage", "numbers", "answers", "results"},
        "preview": {"planning", "storage", "numbers", "answers", "results", "stages"},
        "motion": {"planning", "storage", "numbers", "answers", "results", "stages"},
        "lobes": {"planning", "storage", "numbers", "answers", "results", "stages"},
        "accuracy": {"planning", "storage", "numbers", "answers", "results", "stages", "motion"},
    },
    "studies": {"parameters": set(), "sweeps": set(), "identification": set()},
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
    "gmsh": {"meshing/cad", "meshing/files", "validation/coverage"},
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


def test_a_module_imports_only_from_layers_and_rooms_before_its_own() -> None:
    places = {module_name(path): (layer_of(path), room_of(path)) for path in MODULES}

    def wrong(path: Path) -> set[str]:
        # a layer as a whole is imported for its folder only, where its code is part of a key
        inside = {name for name in imports_of(path) if name in places}
        return {
            name for name in inside if not may_import((layer_of(path), room_of(path)), places[name])
        }

    assert offenders(wrong) == {}


def test_an_import_of_this_program_names_a_module() -> None:
    def wrong(path: Path) -> set[str]:
        layers = {f"headstock.{layer}" for layer in LAYERS}
        return {
            name
            for name in imports_of(path)
            if name.split(".")[0] == "headstock" and name not in KNOWN | layers
        }

    assert offenders(wrong) == {}


def test_every_room_is_in_the_table_and_rooms_form_no_circle() -> None:
    found = {
        layer: {room_of(path) for path in MODULES if layer_of(path) == layer} - {""}
        for layer in LAYERS
    }
    assert found == {layer: set(rooms) for layer, rooms in ROOMS.items()}
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


def test_heavy_libraries_are_imported_only_in_their_adapter_folders() -> None:
    def wrong(path: Path) -> set[str]:
        libraries = {name.split(".")[0] for name in imports_of(path)}
        return {
            name
            for name in libraries & set(ADAPTERS)
            if path.parent.relative_to(ROOT).as_posix() not in ADAPTERS[name]
        }

    assert offenders(wrong) == {}


def test_libraries_that_read_the_working_folder_are_imported_where_they_are_loaded_apart() -> None:
    def wrong(path: Path) -> set[str]:
        libraries = {name.split(".")[0] for name in imports_of(path)}
        place = path.relative_to(ROOT).as_posix()
        return {name for name in libraries & set(LOADERS) if place not in LOADERS[name]}

    assert offenders(wrong) == {}


def test_geometry_needs_numpy_and_nothing_else() -> None:
    def wrong(path: Path) -> set[str]:
        libraries = {name.split(".")[0] for name in imports_of(path)} - {"headstock", "numpy"}
        return libraries - sys.stdlib_module_names if layer_of(path) == "geometry" else set()

    assert offenders(wrong) == {}


def test_no_import_is_relative() -> None:
    def wrong(path: Path) -> list[int]:
        return [
            node.lineno
            for node in ast.walk(tree_of(path))
            if isinstance(node, ast.ImportFrom) and node.level > 0
        ]

    assert offenders(wrong) == {}


def test_only_the_command_line_folder_imports_inside_functions() -> None:
    def wrong(path: Path) -> list[int]:
        functions = [
            node
            for node in ast.walk(tree_of(path))
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        ]
        late = [
            node.lineno
            for body in functions
            for node in ast.walk(body)
            if isinstance(node, ast.Import | ast.ImportFrom)
        ]
        return [] if layer_of(path) == "app" else late

    assert offenders(wrong) == {}


def test_a_package_file_holds_a_docstring_and_nothing_else() -> None:
    packages = {
        folder: tree_of(folder / "__init__.py") for folder in FOLDERS if folder.name != DOOR
    }
    assert len(packages) > len(LAYERS)
    assert [
        folder
        for folder, tree in packages.items()
        if not ast.get_docstring(tree) or len(tree.body) != 1
    ] == []


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
        texts = {
            node.value
            for node in ast.walk(tree_of(path))
            if isinstance(node, ast.Constant) and isinstance(node.value, str)
        }
        return {
            text
            for text in texts
            if pattern.fullmatch(text) and text not in KNOWN | PACKAGES | functions
        }

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
    readers = {module_name(path) for path in MODULES if layer_of(path) == "studies"}
    assert "headstock.studies.answers" not in readers
    makers = offenders(
        lambda path: (
            re.findall(r"(?<![\w.])RunState\(", path.read_text())
            if path.name != "run_state.py"
            else []
        )
    )
    assert list(makers) == ["pipeline/stages/shared_components.py"]
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


def test_no_module_shares_its_name_with_a_function_in_it() -> None:
    kinds = ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef
    assert (
        offenders(
            lambda path: (
                path.stem in {node.name for node in tree_of(path).body if isinstance(node, kinds)}
            )
        )
        == {}
    )


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
    for folder in folders:
        for path in sorted((ROOT / folder).rglob("*")):
            if (
                path.suffix in {".py", ".sh", ".md", ".toml", ".txt", ".yaml", ""}
                and path.is_file()
            ):
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
