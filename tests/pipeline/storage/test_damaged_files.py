"""damaged, truncated and lying files are refused by name within 10 s and 1 GiB, and never end
the process that asks.
"""

import time
from pathlib import Path

import h5py
import numpy as np
import pytest

from cases import cases
from faults.file_fuzz import box_superelement, run_file_fuzz, write_meshes
from headstock.geometry.errors import HeadstockError
from headstock.geometry.parts.components import Component, Material
from headstock.geometry.parts.solids import MeshFile
from headstock.meshing.components.meshing import mesh_component
from headstock.meshing.errors import MeshError
from headstock.pipeline.storage.records import RecordError
from headstock.pipeline.storage.superelements import read_superelement, write_superelement

pytestmark = [pytest.mark.hard("H46"), pytest.mark.workers, pytest.mark.process]

STEEL = Material("steel", 2.1e11, 0.3, 7850.0)


def read_mesh(path: Path, text: str) -> None:
    path.write_text(text)
    mesh_component(Component("part", MeshFile(path, 1.0), STEEL))


@pytest.mark.trials
def test_sixteen_damaged_files_are_read_or_refused_by_name(tmp_path: Path) -> None:
    outcome = run_file_fuzz(16, seed=46, root=tmp_path)
    assert outcome.faults == []
    assert outcome.trials == 16
    assert sum(count for ending, count in outcome.happened.items() if "refused" in ending) > 8


@pytest.mark.parametrize(
    "count",
    [
        *("1000000000000", "-1", "46"),
        *(
            pytest.param(count, marks=pytest.mark.trials)
            for count in ("99999999999999999999", "nan", "0")
        ),
    ],
)
@pytest.mark.parametrize("section", ["$Nodes", "$Elements"])
def test_a_gmsh_file_that_lies_about_its_counts_is_refused(
    tmp_path: Path, section: str, count: str
) -> None:
    write_meshes(tmp_path)
    sound = (tmp_path / "part.msh").read_text()
    head, _, rest = sound.partition(f"{section}\n")
    text = f"{head}{section}\n{count}\n{rest.split(chr(10), 1)[1]}"
    start = time.monotonic()
    with pytest.raises(MeshError, match="part"):
        read_mesh(tmp_path / "part.msh", text)
    assert time.monotonic() - start < 10.0


@cases
def test_an_abaqus_deck_that_contradicts_itself_is_refused(
    tmp_path: Path, old: str, new: str, fragment: str
) -> None:
    write_meshes(tmp_path)
    sound = (tmp_path / "part.inp").read_text()
    assert old in sound
    start = time.monotonic()
    with pytest.raises(MeshError, match=fragment):
        read_mesh(tmp_path / "part.inp", sound.replace(old, new, 1))
    assert time.monotonic() - start < 10.0


def test_a_superelement_that_claims_more_than_its_file_holds_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "part.h5"
    write_superelement(path, box_superelement())
    with h5py.File(path, "a") as file:
        del file["stiffness"]
        file.create_dataset("stiffness", shape=(10**7, 10**7), dtype="f8", chunks=(1000, 1000))
    assert path.stat().st_size < 1 << 20
    with pytest.raises(RecordError, match="stiffness claims 100000000000000 values"):
        read_superelement(path)


def test_a_superelement_of_words_or_of_a_compressed_bomb_is_refused(tmp_path: Path) -> None:
    for name, data in (("words", np.array([b"x" * 8] * 8)), ("bomb", np.zeros(40_000_000))):
        path = tmp_path / f"{name}.h5"
        write_superelement(path, box_superelement())
        with h5py.File(path, "a") as file:
            del file["mass"]
            file.create_dataset("mass", data=data, compression="gzip")
        with pytest.raises(RecordError, match="mass"):
            read_superelement(path)


def test_a_file_that_is_replaced_by_a_folder_or_vanishes_is_named(tmp_path: Path) -> None:
    with pytest.raises(RecordError, match="is no regular file"):
        read_superelement(tmp_path)
    with pytest.raises(HeadstockError, match="there is no file"):
        mesh_component(Component("part", MeshFile(tmp_path / "gone.msh", 1.0), STEEL))
