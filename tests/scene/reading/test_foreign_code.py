"""nothing a user, a colleague or a working folder hands in is run as code (compiled forms:
test_form_cache; scripts: H49).
"""

import ast
import pickle
from pathlib import Path

import h5py
import numpy as np
import pytest

from faults.file_fuzz import box_superelement
from headstock.geometry.parts.components import Component, Material
from headstock.geometry.parts.solids import MeshFile, StepFile
from headstock.meshing.components.meshing import describe_component, mesh_component
from headstock.meshing.errors import MeshError
from headstock.pipeline.storage.records import RecordError
from headstock.pipeline.storage.superelements import read_superelement, write_superelement
from headstock.scene.reading.units import LENGTH, UnitError, parse_quantity

pytestmark = [pytest.mark.hard("H50"), pytest.mark.workers]

ROOT = Path(__file__).resolve().parents[3]
LINKS = sorted((ROOT / ".typing" / "headstock").iterdir())
FOLDERS = [ROOT / "api", *(link.resolve() for link in LINKS if link.is_symlink())]
SOURCES = [path for folder in FOLDERS for path in sorted(folder.rglob("*.py"))]
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
STEEL = Material("steel", 2.1e11, 0.3, 7850.0)
SCRIPT = 'SystemCall "touch {mark}";\nPoint(1) = {{0,0,0}};\n'


def test_there_are_sources_to_look_at() -> None:
    assert len(SOURCES) > 300


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_a_module_runs_no_text_and_unpacks_no_objects(path: Path) -> None:
    nodes = list(ast.walk(ast.parse(path.read_text())))
    assert nodes
    for node in nodes:
        if isinstance(node, ast.Import | ast.ImportFrom):
            names = (
                {alias.name.split(".")[0] for alias in node.names}
                if isinstance(node, ast.Import)
                else {str(node.module).split(".")[0]}
            )
            assert not names & READERS
        if isinstance(node, ast.Call):
            called = node.func.id if isinstance(node.func, ast.Name) else ""
            assert called not in RUNNERS
            attribute = node.func.attr if isinstance(node.func, ast.Attribute) else ""
            assert attribute not in {
                "system",
                "popen",
                "parse_expression",
                "sympify",
                "read_pickle",
            }
            given = {keyword.arg: keyword.value for keyword in node.keywords}
            for name in {"shell", "allow_pickle"} & given.keys():
                value = given[name]
                assert isinstance(value, ast.Constant) and value.value is False
            assert attribute != "load" or "allow_pickle" in given or not _is_numpy(node.func)


def _is_numpy(function: ast.expr) -> bool:
    return (
        isinstance(function, ast.Attribute)
        and isinstance(function.value, ast.Name)
        and function.value.id in {"np", "numpy"}
    )


@pytest.mark.parametrize(
    "text",
    [
        "__import__('os').system('true') m", "(1).__class__ m", "9**9**9 m", "2*3 m", "1+1 m", "(1) m", "1 m**1e9", "1 m; 2 m", "lambda: 1",
        "1 __class__",
        "1 m.__class__", "{1} m", "%d m", "1 os.system", "1 m**(9**9)", "1 m^" + "9" * 300,
    ],
)  # fmt: skip
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
