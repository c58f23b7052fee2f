"""The store believes only whole entries of this user, and its keys hold what matters and nothing
else.
"""

import dataclasses
import os
import stat
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from built_scenes import STEEL, make_block
from built_superelements import bar
from headstock.geometry.frames import Frame, rotation_about
from headstock.geometry.parts.components import (
    Component,
    Interface,
    Load,
    MeshSettings,
    Patch,
    ReductionSettings,
    Support,
)
from headstock.geometry.parts.solids import Box, MeshFile
from headstock.meshing.component_mesh import ComponentMesh, MeshQuality
from headstock.pipeline.storage import store as store_module
from headstock.pipeline.storage import superelements
from headstock.pipeline.storage.content_keys import code_fingerprint, mesh_key, superelement_key
from headstock.pipeline.storage.records import RecordError
from headstock.pipeline.storage.store import (
    Store,
    _entry_path,
    default_store_root,
    read_entry,
    write_entry,
)
from headstock.pipeline.storage.superelements import read_superelement, write_superelement
from headstock.reduction.superelement import (
    ErrorEstimates,
    InterfaceMap,
    Recovery,
    StaticLoad,
    Superelement,
)

KEY = "ab" + 62 * "0"
COLUMN = make_block(
    "column",
    (0.038, 0.1, 0.5),
    mesh=MeshSettings(size=0.019),
    reduction=ReductionSettings(modes=4),
)


def make_mesh() -> ComponentMesh:
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    quality = MeshQuality(0.7, 0, 1 / 6, float("nan"), {"foot": 0.5, "support:a b": float("nan")})
    return ComponentMesh(
        points,
        np.array([[0, 1, 2, 3]]),
        "tet4",
        True,
        {"foot": np.array([[0, 1, 2]]), "support:a b": np.array([[0, 1, 3]])},
        quality,
    )


def make_superelement() -> Superelement:
    rng = np.random.default_rng(1)
    return dataclasses.replace(
        bar(),
        frames=(Frame(np.array([1.0, 2.0, 3.0]), rotation_about(np.array([1.0, 1, 0]), 0.3)),),
        interface_maps={
            "foot": InterfaceMap(0, Frame()),
            "tip/upper": InterfaceMap(0, Frame(np.ones(3))),
        },
        recovery=Recovery(
            basis=rng.normal(size=(12, 8)),
            points=np.vstack([rng.normal(size=(2, 3)), [[-5.0] * 3, [5.0] * 3]]),
        ),
        cutoff_hz=float("inf"),
        full_dofs=12,
        residual=1e-12,
        loads={
            "push": StaticLoad(np.arange(8.0, dtype=np.float64), None),
            "pull": StaticLoad(np.ones(8), np.ones(12)),
        },
        errors=ErrorEstimates(),
        free_dofs=("tip.rz",),
    )


def assert_same_record(first: object, second: object) -> None:
    assert type(first) is type(second)
    if dataclasses.is_dataclass(first):
        for field in dataclasses.fields(first):
            assert_same_record(getattr(first, field.name), getattr(second, field.name))
    elif isinstance(first, np.ndarray):
        assert isinstance(second, np.ndarray)
        assert first.shape == second.shape
        np.testing.assert_array_equal(first, second)
    elif isinstance(first, dict):
        assert isinstance(second, dict)
        assert sorted(first) == sorted(second)
        for key, value in first.items():
            assert_same_record(value, second[key])
    elif isinstance(first, tuple) and first and dataclasses.is_dataclass(first[0]):
        assert isinstance(second, tuple)
        for one, other in zip(first, second, strict=True):
            assert_same_record(one, other)
    else:
        assert first == second or (first != first and second != second)


@pytest.mark.parametrize("record", [make_mesh(), make_superelement()], ids=["mesh", "superelement"])
def test_an_entry_comes_back_as_it_went_in(
    tmp_path: Path, record: ComponentMesh | Superelement
) -> None:
    store = Store(tmp_path)
    assert write_entry(store, KEY, record) is None
    read = read_entry(store, KEY, type(record))
    assert read.warning is None
    assert_same_record(record, read.value)


def test_a_missing_entry_is_no_warning(tmp_path: Path) -> None:
    assert read_entry(Store(tmp_path), KEY, ComponentMesh) == store_module.StoreRead(None, None)


def test_a_flipped_byte_anywhere_is_noticed(tmp_path: Path) -> None:
    store = Store(tmp_path)
    write_entry(store, KEY, make_mesh())
    path = _entry_path(store, "componentmesh", KEY)
    content = path.read_bytes()
    assert len(content) > 2000
    for position in [0, 40, *range(512, len(content), 997), len(content) - 1]:
        damaged = bytearray(content)
        damaged[position] ^= 0x10
        path.write_bytes(bytes(damaged))
        read = read_entry(store, KEY, ComponentMesh)
        assert read.value is None
        assert read.warning is not None and "damaged" in read.warning


def link_to(path: Path) -> None:
    path.rename(path.parents[2] / "elsewhere.h5")
    path.symlink_to(path.parents[2] / "elsewhere.h5")


def cut(length: int) -> Callable[[Path], None]:
    return lambda path: os.truncate(path, length)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (cut(0), ""),
        (cut(100), ""),
        (cut(512), ""),
        (cut(4000), ""),
        (lambda path: path.chmod(0o666), ""),
        (link_to, ""),
        (lambda path: None, "another user"),
    ],
    ids=["empty", "100", "512", "4000", "others may write it", "a link", "another user"],
)
def test_an_entry_that_is_cut_short_or_of_others_is_not_trusted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, change: Callable[[Path], None], words: str
) -> None:
    store = Store(tmp_path)
    write_entry(store, KEY, make_mesh())
    path = _entry_path(store, "componentmesh", KEY)
    assert stat.S_IMODE(path.stat().st_mode) == 0o600 and path.stat().st_size > 4000
    change(path)
    if words:
        other = os.geteuid() + 1
        monkeypatch.setattr(os, "geteuid", lambda: other)
    read = read_entry(store, KEY, ComponentMesh)
    assert read.value is None and read.warning is not None and words in read.warning


def test_a_store_that_cannot_be_written_warns_and_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full_disk(descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full_disk)
    warning = write_entry(Store(tmp_path), KEY, make_mesh())
    assert warning is not None and "No space left" in warning
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []


def test_concurrent_writers_leave_one_valid_entry(tmp_path: Path) -> None:
    code = (
        "import numpy as np, sys; from pathlib import Path; from headstock.pipeline.storage.store import Store, write_entry, read_entry;"
        "from headstock.reduction.superelement import StaticLoad;"
        "store = Store(Path(sys.argv[1])); key = 'ab' * 32\n"
        "for _ in range(30):\n"
        "    assert write_entry(store, key, StaticLoad(np.arange(5000.0))) is None\n"
        "    read = read_entry(store, key, StaticLoad)\n"
        "    assert read.warning is None and read.value.vector[-1] == 4999.0\n"
    )
    workers = [subprocess.Popen([sys.executable, "-c", code, str(tmp_path)]) for _ in range(3)]
    assert [worker.wait(timeout=60) for worker in workers] == [0, 0, 0]
    assert len([path for path in tmp_path.rglob("*") if path.is_file()]) == 1


def test_the_store_sits_where_the_environment_says(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", "/c")
    monkeypatch.delenv("HEADSTOCK_STORE", raising=False)
    assert default_store_root() == Path("/c/headstock/store")
    monkeypatch.setenv("HEADSTOCK_STORE", "/s")
    assert default_store_root() == Path("/s")


TRACTION = Load("push", "column", "traction", (Patch("z+"),), vector=(1.0, 0.0, 0.0))
SUPPORT = Support("clamp", "column", (Patch("x-"),), ("x",))


def key_of(
    component: Component = COLUMN, supports: tuple[Support, ...] = (), loads: tuple[Load, ...] = ()
) -> str:
    return superelement_key(component, supports, loads)


@pytest.mark.parametrize(
    "same",
    [
        dataclasses.replace(COLUMN, name="column_left"),
        dataclasses.replace(
            COLUMN,
            placement=Frame(np.array([1.0, 2.0, 3.0]), rotation_about(np.array([0, 0, 1.0]), 0.7)),
        ),
        dataclasses.replace(COLUMN, material=dataclasses.replace(STEEL, name="S235")),
        dataclasses.replace(COLUMN, solid=Box((38.0 * 1e-3, 100.0 / 1000.0, 0.1 + 0.4))),
        dataclasses.replace(COLUMN, reduction=ReductionSettings(modes=5)),
    ],
    ids=["name", "placement", "material name", "units", "modes"],
)
def test_what_does_not_matter_does_not_change_the_key(same: Component) -> None:
    assert key_of(same) == key_of()


@pytest.mark.parametrize(
    "other",
    [
        dataclasses.replace(COLUMN, solid=Box((0.038, 0.1, 0.5001))),
        dataclasses.replace(COLUMN, material=dataclasses.replace(STEEL, youngs_modulus=211e9)),
        dataclasses.replace(COLUMN, material=dataclasses.replace(STEEL, density=7800.0)),
        dataclasses.replace(COLUMN, mesh=MeshSettings(size=0.02)),
        dataclasses.replace(COLUMN, mesh=MeshSettings(size=0.019, cells="hex")),
        dataclasses.replace(COLUMN, mass=10.0),
        dataclasses.replace(
            COLUMN, interfaces={**COLUMN.interfaces, "tip": Interface("tip", (Patch("z+"),))}
        ),
        dataclasses.replace(COLUMN, interfaces={"foot": COLUMN.interfaces["foot"]}),
    ],
    ids=["size", "E", "rho", "mesh size", "cells", "mass", "coupling", "interface"],
)
def test_what_matters_changes_the_key(other: Component) -> None:
    assert key_of(other) != key_of()


PRESSURE = Load("oil", "column", "pressure", (Patch("z+"),), magnitude=1e5)


def test_supports_and_loads_change_the_key() -> None:
    keys = {
        key_of(),
        key_of(supports=(SUPPORT,)),
        key_of(supports=(dataclasses.replace(SUPPORT, directions=("x", "y")),)),
        key_of(loads=(TRACTION,)),
        key_of(loads=(PRESSURE,)),
        key_of(loads=(dataclasses.replace(PRESSURE, magnitude=2e5),)),
    }
    assert len(keys) == 6


def test_the_size_of_a_traction_and_a_force_at_an_interface_need_no_other_superelement() -> None:
    stronger = dataclasses.replace(TRACTION, vector=(0.0, 5.0, 0.0))
    assert key_of(loads=(stronger,)) == key_of(loads=(TRACTION,))
    force = Load("pull", "column", "force", interface="tip", vector=(1.0, 0, 0, 0, 0, 0))
    assert key_of(loads=(force,)) == key_of()


def test_material_and_coupling_leave_the_mesh_alone() -> None:
    changed = dataclasses.replace(
        COLUMN,
        material=dataclasses.replace(STEEL, youngs_modulus=1e9),
        interfaces={**COLUMN.interfaces, "tip": Interface("tip", (Patch("z+"),))},
        reduction=ReductionSettings(modes=9),
    )
    assert mesh_key(changed, (), ()) == mesh_key(COLUMN, (), ())


def test_the_content_of_a_referenced_file_counts_and_not_its_name(tmp_path: Path) -> None:
    for name, content in [("a.msh", b"1"), ("b.msh", b"1"), ("c.msh", b"2")]:
        (tmp_path / name).write_bytes(content)
    keys = [
        mesh_key(dataclasses.replace(COLUMN, solid=MeshFile(tmp_path / name)), (), ())
        for name in ["a.msh", "b.msh", "c.msh"]
    ]
    assert keys[0] == keys[1] != keys[2]


def test_a_superelement_file_comes_back_as_it_went_in(tmp_path: Path) -> None:
    path = tmp_path / "column.h5"
    write_superelement(path, make_superelement())
    assert_same_record(read_superelement(path), make_superelement())


@pytest.mark.parametrize("content", [b"", b"not hdf5", b"\x89HDF\r\n\x1a\n" + 200 * b"\0"])
def test_a_file_that_is_no_superelement_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "column.h5"
    path.write_bytes(content)
    with pytest.raises(RecordError, match=r"column\.h5"):
        read_superelement(path)


def test_a_change_in_a_room_below_a_package_changes_its_fingerprint(tmp_path: Path) -> None:
    """A store key that looked at the top folder only would serve numbers of old code."""
    (tmp_path / "room").mkdir()
    names = ("top.py", "room/deep.py", "room/catalogue.toml")
    sources = [tmp_path / name for name in names]
    for source in sources:
        source.write_text("FACTOR = 1\n")

    def fingerprint() -> str:
        package = ModuleType("package")  # another one each time: fingerprints are cached
        package.__path__ = [str(tmp_path)]
        return code_fingerprint(package)

    prints = {fingerprint()}
    for source in sources:
        source.write_text("FACTOR = 2\n")
        prints.add(fingerprint())
    sources[1].rename(tmp_path / "room" / "moved.py")
    prints.add(fingerprint())
    assert len(prints) == 5


def test_a_file_that_is_exchanged_after_its_probe_is_not_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "part.h5"
    write_superelement(path, make_superelement())
    probe = superelements._probe

    def exchange(content: bytes, name: str) -> None:
        probe(content, name)
        path.write_bytes(b"something else")

    monkeypatch.setattr(superelements, "_probe", exchange)
    assert read_superelement(path).mass_kg == make_superelement().mass_kg
    with pytest.raises(RecordError, match=r"part\.h5"):
        read_superelement(path)


def test_a_file_that_is_nothing_but_size_is_refused_unread(tmp_path: Path) -> None:
    path = tmp_path / "part.h5"
    with path.open("wb") as file:
        file.truncate(1 << 42)
    with pytest.raises(RecordError, match=r"may have 4\.0 GB"):
        read_superelement(path)
