"""``import headstock``: what it loads, what it offers, and that it does what the command line does."""

import ast
import os
import runpy
import sys
from pathlib import Path

import numpy as np
import pytest

import headstock as hs
from common import Shell, loaded_by, run_process
from headstock.machine import Sections
from headstock.scene.schema.scene import SceneTable

ROOT = Path(__file__).resolve().parents[2]
COLUMN = ROOT / "tests" / "data" / "segmented_column.toml"
ANALYSES = '[analyses.static]\nat = "tcp"\n[analyses.modal]\ncount = 3\n'


@pytest.fixture
def column(shell: Shell) -> Shell:
    shell.write(COLUMN.read_text() + ANALYSES)
    return shell


@pytest.fixture
def scene(column: Shell) -> Path:
    return column.folder / "scene.toml"


@pytest.mark.parametrize("code", ["import headstock", "import headstock.geometry.frames"])
def test_an_import_loads_neither_the_schema_nor_the_solvers(code: str) -> None:
    heavy = {"pydantic", "dolfinx", "petsc4py", "mpi4py", "scipy", "h5py", "pyvista"}
    found = loaded_by(code)
    assert "headstock" in found
    assert found & heavy == set()
    assert ("numpy" in found) == ("geometry" in code)


def test_loading_a_scene_loads_no_finite_elements() -> None:
    code = f"import headstock as hs; hs.load({str(COLUMN)!r})"
    assert loaded_by(code) & {"dolfinx", "gmsh", "pyvista", "matplotlib", "typer"} == set()


def test_every_public_name_is_there_and_no_other() -> None:
    for name in hs.__all__:
        assert getattr(hs, name) is not None
    assert dir(hs) == sorted(hs.__all__)
    with pytest.raises(AttributeError, match=r"'analyze'.*load"):
        hs.analyze  # type: ignore[attr-defined]  # noqa: B018


def test_the_stub_has_the_names_and_the_keys_of_now() -> None:
    """Else: ``./headstock exec python3 .ci/stub.py`` writes it anew."""
    program = runpy.run_path(str(ROOT / ".ci" / "stub.py"))
    text = program["render_stub"]()
    assert (ROOT / "api" / "__init__.pyi").read_text() == text
    tree = ast.parse(text)
    classes = {node.name: node for node in tree.body if isinstance(node, ast.ClassDef)}
    imported = [node for node in tree.body if isinstance(node, ast.ImportFrom)]
    names = {alias.asname for node in imported for alias in node.names if alias.asname}
    assert names - {"np"} | classes.keys() | {"__version__"} == set(hs.__all__)
    (init,) = classes["Joint"].body
    assert isinstance(init, ast.FunctionDef)
    assert {"between", "stiffness", "from_"} <= {each.arg for each in init.args.kwonlyargs}


def test_sections_of_a_machine_are_those_of_a_scene() -> None:
    assert set(Sections.__annotations__) == SceneTable.model_fields.keys() - {"include", "fits"}


def test_a_key_that_a_type_checker_refuses_is_refused_with_the_right_one() -> None:
    """mypy reads this file too, and would tell of an ``ignore`` that hides nothing."""
    with pytest.raises(hs.SceneError, match="did you mean 'stiffness'"):
        hs.Joint(between=["a.b", "ground"], kind="spring", stifness={})  # type: ignore[call-arg]
    with pytest.raises(hs.SceneError, match="did you mean 'linear_guide'"):
        hs.Joint(between=["a.b", "ground"], kind="linear_guid")  # type: ignore[arg-type]
    with pytest.raises(hs.SceneError, match="did you mean 'joints'"):
        hs.Machine(name="a", joint={})  # type: ignore[call-arg]


def test_a_run_finds_what_the_command_line_finds(column: Shell) -> None:
    stages: list[str] = []
    machine = hs.load("scene.toml")
    result = hs.run(machine, output="mine", progress=lambda done: stages.append(done.stage.kind))
    column("run scene.toml -o other --no-figures")
    summary = column.json("other/summary.json")
    assert summary["modal"][0]["frequencies_hz"] == list(result.modes["reference"].frequencies_hz)
    assert summary["static"]["tcp"]["compliance_6x6"] == result.compliance["tcp"].tolist()
    assert stages == [entry["stage"] for entry in summary["stages"]]
    assert stages == [stage.kind for stage in hs.plan(machine).stages]
    mine = column.json("mine/summary.json")["provenance"]
    shared = ("scene_sha256", "scene_text", "variant", "overrides", "version", "commit")
    assert [mine[key] for key in shared] == [summary["provenance"][key] for key in shared]


def test_a_run_leaves_no_page_of_an_earlier_one_and_keeps_what_the_user_put_there(
    column: Shell,
) -> None:
    out = column.folder / "out"
    column("run scene.toml -o out")
    (out / "tables" / "mine.csv").write_text("mine")
    machine = hs.load("scene.toml", set={"components.column.solid.box[2]": 0.4})
    result = hs.run(machine, output=out)
    left = {path.relative_to(out).as_posix() for path in out.rglob("*") if path.is_file()}
    found = {name for name in left if not name.startswith(("modes/", "."))}
    assert found == {"results.h5", "summary.json", "tables/mine.csv"}
    column("report out")
    frequency = f"{result.modes['reference'].frequencies_hz[0]:.4g}"
    assert frequency in column.text("out/report.html")
    (out / "report.html").write_text("edited")
    with pytest.raises(hs.HeadstockError, match=r"report\.html.*changed"):
        hs.run(machine, output=out)
    assert column.text("out/report.html") == "edited"


def test_a_run_without_output_leaves_no_file(column: Shell) -> None:
    hs.run("scene.toml")
    assert column.files() - {"store"} == {"scene.toml"}


def test_results_come_back_from_their_folder(scene: Path, tmp_path: Path) -> None:
    first = hs.run(scene, output=tmp_path / "out")
    again = hs.open(tmp_path / "out")
    assert type(again) is type(first)
    pose, other = first.modes["reference"], again.modes["reference"]
    assert np.array_equal(pose.frequencies_hz, other.frequencies_hz)
    assert pose.errors == other.errors
    assert again.stages[-1].stage.kind == "write"
    assert again.mesh("column").n_points == first.mesh("column").n_points


def test_only_the_analyses_that_are_named_run(scene: Path) -> None:
    result = hs.run(scene, analyses=["modal"])
    assert result.modes
    assert result.compliance == {}
    with pytest.raises(hs.SceneError, match=r"'modal'\?.*modal, static"):
        hs.run(scene, analyses=["modall"])


def test_an_error_names_file_line_key_and_remedy(scene: Path) -> None:
    scene.write_text(scene.read_text().replace('material = "steel"', 'material = "stel"'))
    with pytest.raises(hs.SceneError) as caught:
        hs.load(scene)
    (problem,) = caught.value.problems
    assert (problem.file, problem.key) == (str(scene), "components.column.material")
    assert scene.read_text().splitlines()[(problem.line or 0) - 1].startswith("material")
    assert "steel" in problem.remedy


def test_a_setting_in_si_units_is_the_setting_with_a_unit(scene: Path) -> None:
    key = "components.column.solid.box[2]"
    in_si, with_unit = hs.load(scene, set={key: 0.4}), hs.load(scene, set={key: "400 mm"})
    assert in_si == with_unit == hs.load(scene).change(set={key: np.float64(0.4)})
    assert in_si != hs.load(scene)


def test_a_setting_that_does_not_fit_is_refused_as_on_the_command_line(scene: Path) -> None:
    with pytest.raises(hs.SceneError, match=r"--set components\.colum\.fidelity") as caught:
        hs.load(scene, set={"components.colum.fidelity": "rigid"})
    assert "column" in caught.value.problems[0].message


def test_check_returns_warnings() -> None:
    assert hs.check(COLUMN) == ()


@pytest.mark.parametrize("table", ["modes", "compliance", "components", "stages"])
def test_a_table_has_a_row_for_each_entry(scene: Path, table: str) -> None:
    pytest.importorskip("pandas")
    result = hs.run(scene)
    frame = result.to_pandas(table)
    counts = {"modes": 3, "compliance": 6, "components": 1, "stages": len(result.stages)}
    assert len(frame) == counts[table]
    if table == "modes":
        assert list(frame["frequency_hz"]) == list(result.modes["reference"].frequencies_hz)
    elif table == "compliance":
        assert frame.loc[0, "x"] == result.compliance["tcp"][0, 0]
    with pytest.raises(KeyError, match="modes, compliance, frf"):
        result.to_pandas("moods")


def test_a_response_is_a_table_of_its_lines(scene: Path) -> None:
    pytest.importorskip("pandas")
    response = {"inputs": [["tcp", "x"]], "up_to": "300 Hz", "points": 11, "adaptive": False}
    result = hs.run(hs.load(scene, set={"analyses.frf": response}))
    frame = result.to_pandas("frf")
    curves = result.frf["reference"].curves
    assert len(frame) == len(curves.frequencies_hz) == 11
    assert frame["tcp x / tcp x"].iloc[3] == curves.receptance[3, 0, 0]


@pytest.mark.parametrize(
    ("words", "wanted"),
    [
        (["python", "script.py", "--ranks", "3"], ["script.py", "--ranks", "3"]),
        (["notebook", "--no-browser"], ["-m", "jupyterlab", "--no-browser"]),
        (["python", "--ranks", "2", "script.py"], ["-m", "mpi4py", "script.py"]),
    ],
)
def test_the_launcher_starts_python_and_notebook(words: list[str], wanted: list[str]) -> None:
    own = {"HEADSTOCK_DRY_RUN": "1", "HEADSTOCK_PYTHON": sys.executable}
    done = run_process([ROOT / "headstock", *words], env=os.environ | own, check=True)
    assert done.stdout.split("\n")[-len(wanted) - 1 : -1] == wanted, done.stderr
