"""nothing a user, a colleague or a working folder hands in is run as code (compiled forms:
test_form_cache; scripts: H49).
"""

import ast
import pickle
from collections.abc import Iterator
from pathlib import Path

import h5py
import numpy as np
import pytest

from cases import cases
from faults.file_fuzz import box_superelement
from headstock.geometry.parts.components import Component, Material
from headstock.geometry.parts.solids import MeshFile, StepFile
from headstock.meshing.components.meshing import describe_component, mesh_component
from headstock.meshing.errors import MeshError
from headstock.pipeline.storage.records import RecordError
from headstock.pipeline.storage.superelements import read_superelement, write_superelement
from headstock.scene.reading.units import LENGTH, UnitError, parse_quantity

pytestmark = pytest.mark.hard("H50")

ROOT = Path(__file__).resolve().parents[3]
LINKS = sorted((ROOT / ".typing" / "headstock").iterdir())
LAYERS = [ROOT / "api", *(link.resolve() for link in LINKS if link.resolve().parent == ROOT)]
RUNNERS = {"eval", "exec", "compile", "__import__", "execfile", "input"}
READERS = {
    "pickle",
    "cPickle",
    "marshal",
    "shelve",
    "dill",
    "cloudpickle",
    "joblib",
    "yaml",
    "xmlrpc",
}
METHODS = {"system", "popen", "parse_expression", "sympify", "read_pickle"}
STEEL = Material("steel", 2.1e11, 0.3, 7850.0)
SCRIPT = 'SystemCall "touch {mark}";\nPoint(1) = {{0,0,0}};\n'


def find_runners(path: Path) -> Iterator[str]:
    """What a module runs as code or unpacks as objects."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import | ast.ImportFrom):
            modules = [alias.name for alias in node.names]
            if isinstance(node, ast.ImportFrom):
                modules = [str(node.module)]
            yield from {name.split(".")[0] for name in modules} & READERS
        if isinstance(node, ast.Call):
            called = node.func.id if isinstance(node.func, ast.Name) else ""
            attribute = node.func.attr if isinstance(node.func, ast.Attribute) else ""
            given = {keyword.arg: keyword.value for keyword in node.keywords}
            yield from {called} & RUNNERS | {attribute} & METHODS
            for name in {"shell", "allow_pickle"} & given.keys():
                value = given[name]
                if not (isinstance(value, ast.Constant) and value.value is False):
                    yield name
            if attribute == "load" and "allow_pickle" not in given and _is_numpy(node.func):
                yield "load"


@pytest.mark.parametrize("folder", LAYERS, ids=lambda folder: folder.name)
def test_modules_run_no_text_and_unpack_no_objects(folder: Path) -> None:
    found = {path: [*find_runners(path)] for path in folder.rglob("*.py")}
    assert len(found) > 5
    assert {path: names for path, names in found.items() if names} == {}


def test_a_module_that_runs_text_or_unpacks_objects_is_noticed(tmp_path: Path) -> None:
    path = tmp_path / "evil.py"
    path.write_text(
        "import os, pickle\nimport numpy as np\neval('1')\nos.system('x')\nrun(shell=True)\n"
        "np.load('x')\nfrom yaml import load\n"
    )
    found = {"pickle", "yaml", "eval", "system", "shell", "load"}
    assert {*find_runners(path)} == found


def _is_numpy(function: ast.expr) -> bool:
    return (
        isinstance(function, ast.Attribute)
        and isinstance(function.value, ast.Name)
        and function.value.id in {"np", "numpy"}
    )


@cases
def test_a_quantity_is_a_number_and_a_unit_and_no_expression(text: str) -> None:
    with pytest.raises(UnitError):
        parse_quantity(text, LENGTH)


@pytest.mark.process
@pytest.mark.parametrize("suffix", [".msh", ".step"])
@pytest.mark.parametrize("head", ["", "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n", "ISO-10303-21;\n"])
def test_a_gmsh_script_under_another_name_is_not_run(
    tmp_path: Path, suffix: str, head: str
) -> None:
    mark = tmp_path / "mark"
    path = tmp_path / f"part{suffix}"
    path.write_text(head + SCRIPT.format(mark=mark))
    read = mesh_component if suffix == ".msh" else describe_component
    solid = MeshFile(path, 1.0) if suffix == ".msh" else StepFile(path)
    with pytest.raises(MeshError):
        read(Component("part", solid, STEEL))
    assert not mark.exists()


@pytest.mark.workers
@pytest.mark.process
def test_a_configuration_of_gmsh_in_the_working_folder_or_home_is_not_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mark = tmp_path / "mark"
    for name in (".gmshrc", ".gmsh-options"):
        (tmp_path / name).write_text(SCRIPT.format(mark=mark))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("GMSH_HOME", str(tmp_path))
    path = tmp_path / "part.msh"
    path.write_text("$MeshFormat\n2.2 0 8\n$EndMeshFormat\n")
    with pytest.raises(MeshError):
        mesh_component(Component("part", MeshFile(path, 1.0), STEEL))
    assert not mark.exists()


class Bomb:
    def __reduce__(self) -> tuple[object, tuple[str, ...]]:
        return (exec, ("raise SystemExit('ran')",))


@pytest.mark.workers
@pytest.mark.process
def test_objects_packed_into_a_superelement_file_stay_packed(tmp_path: Path) -> None:
    packed = np.frombuffer(pickle.dumps(Bomb()), dtype=np.uint8)
    kinds = (
        ("void", np.void(packed.tobytes())),
        ("words", np.array([b"a", b"b"], dtype=h5py.special_dtype(vlen=bytes))),
    )
    for name, kind in kinds:
        path = tmp_path / f"{name}.h5"
        write_superelement(path, box_superelement())
        with h5py.File(path, "a") as file:
            del file["stiffness"]
            file["stiffness"] = kind
        with pytest.raises(RecordError, match="stiffness"):
            read_superelement(path)
