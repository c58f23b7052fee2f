"""An exported mesh serves another scene as the component itself would."""

from pathlib import Path

import pytest
from mpi4py import MPI

from common import approx
from fixture_machines import machine
from headstock.app.command_line import main
from headstock.geometry.parts.solids import MeshFile
from headstock.pipeline.exports import export_mesh
from headstock.pipeline.runner import run_scene
from headstock.pipeline.storage.content_keys import file_digests, mesh_key
from headstock.pipeline.storage.outputs import TakenOutputError
from headstock.pipeline.storage.store import Store
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.findings import SceneError

SCENE = machine("""
machine = "bar"
names = { bar = "column" }
components.column.solid = "SOLID"
components.column.reduction = { modes = 8 }
components.column.interfaces = { foot = { face = "FOOT" }, tip = { face = "TIP", coupling = "average" } }
joints.clamp.between = ["column.foot", "ground"]
analyses.modal = { count = 6 }
""")
TETS = 'solid = { box = ["40 mm", "60 mm", "200 mm"] }\nmesh = { size = "40 mm" }'
HEXES = TETS.replace('size = "40 mm"', 'size = "20 mm", cells = "hex"')
LINEAR = TETS.replace('size = "40 mm"', 'size = "40 mm", order = 1')


def write_scene(path: Path, solid: str, foot: str, tip: str) -> Path:
    path.write_text(
        SCENE.replace('solid = "SOLID"', solid).replace("FOOT", foot).replace("TIP", tip)
    )
    return path


@pytest.fixture
def store(tmp_path: Path) -> Store:
    return Store(tmp_path / "store")


@pytest.mark.parametrize(
    "solid",
    [
        pytest.param(TETS, id="tet10"),
        pytest.param(HEXES, id="hex27", marks=pytest.mark.trials),
        pytest.param(LINEAR, id="tet4", marks=pytest.mark.trials),
    ],
)
def test_every_format_gives_the_same_frequencies(tmp_path: Path, store: Store, solid: str) -> None:
    scene = load_scene(write_scene(tmp_path / "own.toml", solid, "z-", "z+"))
    given = run_scene(scene, tmp_path / "own", comm=MPI.COMM_SELF, store=store).modal[0]
    assert len(given.frequencies_hz) == 6
    for suffix in (".xdmf", ".exo", ".med", ".bdf", ".msh"):
        name = f"part{suffix}"
        text = export_mesh(scene, None, tmp_path / name, comm=MPI.COMM_SELF, store=store)
        assert "sets: foot, tip" in text
        own = f'solid = {{ mesh = "{name}" }}'
        path = write_scene(tmp_path / f"{suffix[1:]}.toml", own, "set:foot", "set:tip")
        found = run_scene(load_scene(path), tmp_path / suffix[1:], comm=MPI.COMM_SELF, store=store)
        assert found.modal[0].frequencies_hz == approx(given.frequencies_hz, rel=1e-9)


def test_arrays_beside_an_xdmf_file_are_part_of_its_key(tmp_path: Path, store: Store) -> None:
    scene = load_scene(write_scene(tmp_path / "own.toml", LINEAR, "z-", "z+"))
    export_mesh(scene, "column", tmp_path / "part.xdmf", comm=MPI.COMM_SELF, store=store)
    solid = 'solid = { mesh = "part.xdmf" }'
    path = write_scene(tmp_path / "two.toml", solid, "set:foot", "set:tip")
    part = load_scene(path).machine.components["column"]
    arrays = (tmp_path / "part_mesh.h5").resolve()
    assert isinstance(part.solid, MeshFile) and part.solid.beside == (arrays,)
    before = mesh_key(part, (), ())
    raw = load_scene(path).raw
    digests = dict(file_digests(tmp_path, raw))
    assert set(digests) == {"part.xdmf", "part_mesh.h5"}
    arrays.write_bytes(arrays.read_bytes() + b"\0")
    assert mesh_key(part, (), ()) != before
    assert dict(file_digests(tmp_path, raw)) != digests
    arrays.unlink()
    with pytest.raises(SceneError, match=r"part.xdmf.*'part_m"):
        load_scene(path)


def test_nothing_of_the_user_is_written_over(tmp_path: Path, store: Store) -> None:
    scene = load_scene(write_scene(tmp_path / "own.toml", LINEAR, "z-", "z+"))
    (tmp_path / "part_mesh.h5").write_text("mine")
    with pytest.raises(TakenOutputError, match=r"part_mesh.h5 exists"):
        export_mesh(scene, "column", tmp_path / "part.xdmf", comm=MPI.COMM_SELF, store=store)
    assert (tmp_path / "part_mesh.h5").read_text() == "mine"
    assert not (tmp_path / "part.xdmf").exists()
    with pytest.raises(SceneError, match=r"did you mean 'column'\? components: column"):
        export_mesh(scene, "colum", tmp_path / "part.med", comm=MPI.COMM_SELF, store=store)


def test_an_unknown_ending_is_answered_with_the_known_ones(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_scene(tmp_path / "own.toml", LINEAR, "z-", "z+")
    assert main(["export", str(path), "--mesh", str(tmp_path / "part.stl")]) == 2
    assert ".xdmf, .xmf, .med" in capsys.readouterr().err
    assert main(["export", str(path), "column", "--mesh", "a.med", "-o", "b.h5"]) == 2
