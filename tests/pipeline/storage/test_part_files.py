"""Patches that the file of a part does not have: reported by ``check`` and by ``run`` with file, line, key
and what there is, and an exit code of 2.
"""

from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

import headstock as hs
from common import make_box
from fixture_machines import stored_scene
from headstock.app.actions.checking import check_command
from headstock.app.commands.scene_commands import CheckOptions
from headstock.app.terminal.guard import BAD_INPUT, run_guarded
from headstock.meshing.component_mesh import CellKind
from headstock.meshing.errors import PatchError
from headstock.meshing.files.writing import encode_mesh
from headstock.pipeline.runner import run_scene
from headstock.pipeline.storage.part_files import find_missing_patches
from headstock.pipeline.storage.store import Store
from headstock.scene.building.loader import load_scene
from scene_runs import run

pytestmark = [pytest.mark.process]

STEP = Path(__file__).parents[2] / "data" / "support.step"
SCENE = stored_scene("part_files")


def write_scene(
    tmp_path: Path,
    name: str,
    *,
    foot: str = "set:foot",
    tip: str = "set:tip",
    kind: CellKind = "hex8",
    cells: tuple[int, int, int] = (1, 1, 1),
) -> Path:
    """A scene of a box from a mesh file with the sets foot and tip."""
    mesh = make_box(cells, (0.1, 0.1, 0.2), {"foot": "z-", "tip": "z+"}, kind=kind)
    for file, content in encode_mesh(mesh, tmp_path / name).items():
        (tmp_path / file).write_bytes(content)
    return fill(tmp_path, f'mesh = "{name}"', foot=foot, tip=tip)


def fill(tmp_path: Path, solid: str, *, foot: str, tip: str) -> Path:
    path = tmp_path / "scene.toml"
    path.write_text(SCENE.replace("FILE", solid).replace("FOOT", foot).replace("TIP", tip))
    return path


@pytest.mark.parametrize("name", ["box.msh", "box.xdmf", "box.med", "box.exo", "box.bdf"])
def test_a_set_that_a_mesh_file_lacks_is_told_with_its_line_and_the_sets_there_are(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_scene(tmp_path, name, foot="set:fot", tip="set:tips")
    assert run_guarded(lambda: check_command(CheckOptions(scene=path)), debug=False) == BAD_INPUT
    reported = capsys.readouterr().err
    for line, key, wrong in (
        (12, "components.part.interfaces.foot.patches[1].face", "fot"),
        (15, "components.part.interfaces.tip.face", "tips"),
    ):
        assert f"{path}:{line}: {key}\n" in reported
        assert f"'{wrong}'" in reported and "x-, x+, y-, y+, z-, z+, set:" in reported
    assert "set:foot" in reported
    assert "set:tip\n" in reported or "set:tip, " in reported


def test_a_run_tells_the_same_and_ends_as_bad_input(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_scene(tmp_path, "box.msh", foot="set:fot")

    def action() -> int:
        run(load_scene(path), tmp_path)
        return 0

    assert run_guarded(action, debug=False) == BAD_INPUT
    reported = capsys.readouterr().err
    assert f"{path}:12: components.part.interfaces.foot.patches[1].face\n" in reported
    assert "'fot'" in reported and "available: x-" in reported
    with pytest.raises(hs.SceneError, match=r"'fot'.*available: x-"):
        hs.check(path)


def test_sets_that_are_there_are_no_problem(tmp_path: Path) -> None:
    scene = load_scene(write_scene(tmp_path, "box.msh"))
    assert find_missing_patches(scene) == ([], [])
    run(scene, tmp_path)


def test_a_mesh_from_a_file_whose_factors_do_not_fit_is_iterated_and_the_run_says_so(
    tmp_path: Path,
) -> None:
    path = write_scene(tmp_path, "box.msh", kind="tet10", cells=(3, 3, 5))
    text = path.read_text().replace('fidelity = "rigid"', "reduction = { modes = 4 }")
    path.write_text(text.replace('    { face = "z-" },\n', ""))
    details, compliances = [], []
    for name, settings in (("direct", []), ("iterative", ['limits.memory="130 MB"'])):
        scene = load_scene(path, overrides=settings)
        store = Store(tmp_path / name)
        results = run_scene(scene, tmp_path / "out", comm=MPI.COMM_SELF, store=store)
        details += [record.detail for record in results.stages if record.stage.kind == "reduce"]
        compliances.append(results.compliance["tcp"])
    assert "iterative" not in details[0]
    assert "iterative: " in details[1] and "of the 130 MB there are" in details[1]
    np.testing.assert_allclose(compliances[1], compliances[0], rtol=1e-8, atol=1e-18)


def test_supports_and_loads_are_looked_up_too(tmp_path: Path) -> None:
    path = write_scene(tmp_path, "box.msh")
    with path.open("a") as file:
        file.write('[supports.base]\nface = "part.set:base"\nfix = ["x"]\n')
        file.write('[loads.push]\nface = "part.set:top"\npressure = "1 bar"\n')
    scene = load_scene(path, overrides=["components.part.fidelity=elastic"])
    problems, _ = find_missing_patches(scene)
    assert [(problem.line, problem.key) for problem in problems] == [
        (24, "supports.base.face"),
        (27, "loads.push.face"),
    ]


def test_a_file_that_is_no_mesh_is_a_problem_of_the_key_that_names_it(tmp_path: Path) -> None:
    path = write_scene(tmp_path, "box.msh")
    (tmp_path / "box.msh").write_text("nothing of the kind")
    problems, _ = find_missing_patches(load_scene(path))
    assert [(problem.line, problem.key) for problem in problems] == [
        (6, "components.part.solid.mesh")
    ]


def test_a_face_that_a_step_file_lacks_is_told_with_its_line(tmp_path: Path) -> None:
    (tmp_path / "part.step").write_bytes(STEP.read_bytes())
    path = fill(tmp_path, 'step = "part.step"', foot="face:1", tip="face:99")
    with pytest.raises(PatchError, match=r"face:1 \.\. face:83") as error:
        run(load_scene(path), tmp_path)
    assert str(error.value).startswith(f"{path}:15: components.part.interfaces.tip.face\n")
