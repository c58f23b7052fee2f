"""XDMF, MED and Exodus files that are cut short, lie about their sizes or reach for other files
are refused by name, with exit code 2.
"""

import time
from collections.abc import Callable
from pathlib import Path

import h5py
import netCDF4
import numpy as np
import pytest

from cases import cases
from headstock.app.command_line import main
from headstock.geometry.parts.components import Component, Material, MeshSettings
from headstock.geometry.parts.solids import Box, MeshFile
from headstock.meshing.component_mesh import ComponentMesh
from headstock.meshing.components.meshing import mesh_component
from headstock.meshing.errors import MeshError, PartFileError
from headstock.meshing.files import exodus
from headstock.meshing.files.exodus import read_exodus
from headstock.meshing.files.writing import encode_mesh
from headstock.meshing.process.strangers import files_beside

pytestmark = [pytest.mark.hard("H46"), pytest.mark.process]

STEEL = Material("steel", 2.1e11, 0.3, 7850.0)
STEP = "ENS_MAA/mesh/-0000000000000000001-0000000000000000001"


@pytest.fixture(scope="module")
def mesh() -> ComponentMesh:
    return mesh_component(
        Component("part", Box((0.1, 0.1, 0.1)), STEEL, mesh=MeshSettings(size=0.05, cells="hex"))
    )


@pytest.fixture
def write(mesh: ComponentMesh, tmp_path: Path) -> Callable[[str], Path]:
    def make(name: str) -> Path:
        for file, content in encode_mesh(mesh, tmp_path / name).items():
            (tmp_path / file).write_bytes(content)
        return tmp_path / name

    return make


def read_file(path: Path) -> ComponentMesh:
    beside = tuple(path.parent / name for name in files_beside(path))
    return mesh_component(Component("part", MeshFile(path, 1.0, beside), STEEL))


@pytest.mark.parametrize("share", [0.0, 0.9])
@pytest.mark.parametrize("name", ["part.xdmf", "part.med", "part.exo", "part.bdf"])
def test_a_file_that_is_cut_short_is_refused(
    write: Callable[[str], Path], name: str, share: float
) -> None:
    path = write(name)
    content = path.read_bytes()
    read_file(path)
    path.write_bytes(content[: int(share * len(content))])
    start = time.monotonic()
    with pytest.raises(PartFileError, match=name):
        read_file(path)
    assert time.monotonic() - start < 20.0


def replace_array(file: h5py.File, place: str, data: object, **options: object) -> None:
    attributes = dict(file[place].attrs)
    del file[place]
    file.create_dataset(place, data=data, **options)
    file[place].attrs.update(attributes)


@pytest.mark.parametrize(
    ("value", "words"), [(-5, "not among"), (10**9, "not among"), (2**62, "not among")]
)
def test_nodes_that_are_not_there_are_named(
    write: Callable[[str], Path], value: int, words: str
) -> None:
    for name, place in [("part.xdmf", "data1"), ("part.med", f"{STEP}/MAI/H20/NOD")]:
        path = write(name)
        with h5py.File(
            path.with_name("part_mesh.h5") if name == "part.xdmf" else path, "a"
        ) as file:
            data = file[place][()]
            data.ravel()[3] = value
            file[place][...] = data
        with pytest.raises(PartFileError, match=words):
            read_file(path)
    path = write("part.exo")
    with netCDF4.Dataset(path, "a") as exo:
        exo.variables["connect1"][0, 3] = min(value, 2**31)
    with pytest.raises(PartFileError, match=words):
        read_file(path)


def test_coordinates_that_are_no_numbers_are_named(write: Callable[[str], Path]) -> None:
    path = write("part.med")
    with h5py.File(path, "a") as file:
        file[f"{STEP}/NOE/COO"][3] = np.nan
    with pytest.raises(PartFileError, match="not finite"):
        read_file(path)


def test_arrays_of_another_size_than_stated_are_named(write: Callable[[str], Path]) -> None:
    path = write("part.xdmf")
    path.write_text(path.read_text().replace('Dimensions="8 27"', 'Dimensions="9 27"'))
    with pytest.raises(PartFileError, match=r"stated are \[9, 27\]; one of the two files"):
        read_file(path)


@pytest.mark.workers
def test_a_bomb_of_compressed_zeros_is_stopped(write: Callable[[str], Path]) -> None:
    path = write("part.med")
    with h5py.File(path, "a") as file:
        replace_array(
            file,
            f"{STEP}/NOE/COO",
            None,
            shape=(150_000_000,),
            dtype=float,
            compression="gzip",
            chunks=(10_000_000,),
        )
        file[f"{STEP}/NOE/COO"][:3] = 1.0  # the others unpack to zeros
    assert path.stat().st_size < 4 << 20
    with pytest.raises(PartFileError, match=r"COO claims 150000000 values of float64"):
        read_file(path)


@cases
def test_an_xdmf_file_reaches_for_nothing_else(
    write: Callable[[str], Path], old: str, new: str, words: str
) -> None:
    path = write("part.xdmf")
    (path.parent.parent / "secret.h5").write_bytes((path.parent / "part_mesh.h5").read_bytes())
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    if words:
        with pytest.raises(MeshError, match=words):
            read_file(path)
    else:
        assert len(read_file(path).cells) == 8


@pytest.mark.parametrize("kind", ["external link", "soft link", "external storage", "virtual"])
def test_arrays_that_lie_elsewhere_are_not_read(write: Callable[[str], Path], kind: str) -> None:
    path = write("part.med")
    other = path.with_name("other.h5")
    place = f"{STEP}/NOE/COO"
    with h5py.File(path, "a") as file, h5py.File(other, "w") as store:
        data = store["x"] = file[place][()]
        del file[place]
        if kind == "external link":
            file[place] = h5py.ExternalLink("other.h5", "/x")
        elif kind == "soft link":
            file["x"] = data
            file[place] = h5py.SoftLink("/x")
        elif kind == "external storage":
            raw = str(path.with_name("raw.bin"))
            file.create_dataset(place, data=data, external=[(raw, 0, data.nbytes)])
        else:
            layout = h5py.VirtualLayout(data.shape, data.dtype)
            layout[:] = h5py.VirtualSource("other.h5", "x", data.shape)
            file.create_virtual_dataset(place, layout)
    with pytest.raises(PartFileError, match=r"is a link|from other files"):
        read_file(path)


def test_cells_of_unknown_kinds_are_refused_by_kind(tmp_path: Path) -> None:
    points = " ".join(map(str, np.random.default_rng(1).random(24)))
    for mixed, words in [([6, 0, 1], "cut short"), ([77, 0, 1], "type 77")]:
        (tmp_path / "part.xdmf").write_text(
            '<Xdmf Version="3.0"><Domain><Grid><Geometry GeometryType="XYZ">'
            f'<DataItem Dimensions="8 3" Format="XML" Precision="8">{points}</DataItem></Geometry>'
            '<Topology TopologyType="Mixed"><DataItem DataType="Int" Precision="8" '
            f'Dimensions="{len(mixed)}" Format="XML">{" ".join(map(str, mixed))}</DataItem>'
            "</Topology></Grid></Domain></Xdmf>"
        )
        with pytest.raises(PartFileError, match=words):
            read_file(tmp_path / "part.xdmf")


def test_without_netcdf_the_package_is_named(
    write: Callable[[str], Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write("part.exo")
    monkeypatch.setattr(exodus, "HAS_NETCDF", False)
    with pytest.raises(MeshError, match="python3-netcdf4"):
        read_exodus(path)


@pytest.mark.workers
def test_a_damaged_part_ends_show_and_new_with_exit_code_2(
    write: Callable[[str], Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    path = write("part.med")
    path.write_bytes(path.read_bytes()[:3000])
    assert main(["show", "part.med"]) == 2
    assert main(["new", "mine", "--part", "part.med"]) == 2
    assert "export it again" in capsys.readouterr().err
    assert not (tmp_path / "mine").exists()
    assert main(["show", "gone.med"]) == 2
