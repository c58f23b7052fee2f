"""what the store holds is believed only when it is whole and its key says the same of
everything (more in test_store).
"""

import dataclasses
from pathlib import Path

import h5py
import pytest

from faults.file_checks import check_files
from faults.file_fuzz import box_superelement
from faults.runs import finish_run, make_places, read_numbers
from headstock.geometry.parts.components import Component, Material
from headstock.geometry.parts.solids import Box
from headstock.pipeline.storage import content_keys
from headstock.pipeline.storage.content_keys import mesh_key, superelement_key
from headstock.pipeline.storage.store import (
    USER_BLOCK,
    Store,
    _entry_path,
    _seal_entry,
    read_entry,
    write_entry,
)
from headstock.reduction.superelement import Superelement

pytestmark = pytest.mark.hard("H47")

KEY = "cd" + 62 * "1"
COLUMN = Component("column", Box((0.1, 0.1, 0.5)), Material("steel", 2.1e11, 0.3, 7850.0))


def test_another_version_of_a_library_or_of_our_own_code_is_another_key(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def keys() -> tuple[str, str]:
        return mesh_key(COLUMN, (), ()), superelement_key(COLUMN, (), ())

    before = keys()
    monkeypatch.setattr(content_keys, "library_versions", lambda names: dict.fromkeys(names, "99"))
    newer = keys()
    monkeypatch.setattr(content_keys, "code_fingerprint", lambda package: "changed")
    changed = keys()
    assert len({before[0], newer[0], changed[0]}) == len({before[1], newer[1], changed[1]}) == 3


def test_an_entry_of_another_kind_with_a_right_digest_is_computed_anew(tmp_path: Path) -> None:
    store = Store(tmp_path)
    write_entry(store, KEY, box_superelement())
    path = _entry_path(store, "superelement", KEY)
    with h5py.File(path, "r+") as file:
        file["record"].move("stiffness", "stiffmess")
    content = path.read_bytes()[USER_BLOCK:]
    path.write_bytes(_seal_entry("superelement", KEY, content) + content)
    read = read_entry(store, KEY, Superelement)
    assert read.value is None
    assert read.warning is not None and "computed anew" in read.warning


def test_an_entry_copied_over_another_is_not_delivered(tmp_path: Path) -> None:
    store, other = Store(tmp_path), "ef" + 62 * "2"
    write_entry(store, KEY, box_superelement())
    write_entry(store, other, dataclasses.replace(box_superelement(), name="other"))
    place = _entry_path(store, "superelement", KEY)
    place.write_bytes(_entry_path(store, "superelement", other).read_bytes())
    read = read_entry(store, KEY, Superelement)
    assert read.value is None
    assert (
        read.warning is not None
        and "holds another entry" in read.warning
        and "computed anew" in read.warning
    )
    write_entry(store, KEY, box_superelement())
    assert read_entry(store, KEY, Superelement).warning is None


def test_a_key_that_is_rewritten_inside_an_entry_is_noticed(tmp_path: Path) -> None:
    store, other = Store(tmp_path), "ef" + 62 * "2"
    write_entry(store, other, box_superelement())
    forged = (
        _entry_path(store, "superelement", other).read_bytes().replace(other.encode(), KEY.encode())
    )
    place = _entry_path(store, "superelement", KEY)
    place.parent.mkdir(parents=True)
    place.write_bytes(forged)
    assert read_entry(store, KEY, Superelement).value is None


def test_a_key_holds_the_solid_to_twelve_digits() -> None:
    longer = dataclasses.replace(COLUMN, solid=Box((0.1, 0.1, 0.500000000001)))
    assert mesh_key(longer, (), ()) != mesh_key(COLUMN, (), ())


@pytest.mark.trials
@pytest.mark.fem
@pytest.mark.process
def test_a_run_over_a_poisoned_store_finds_the_same_and_mends_it(tmp_path: Path) -> None:
    places = make_places(tmp_path)
    assert finish_run(places, "steel")[0] == 0
    expected = read_numbers(places.results)
    for path in places.store.rglob("*.h5"):
        damaged = bytearray(path.read_bytes())
        damaged[len(damaged) // 2] ^= 1
        path.write_bytes(damaged)
    for warned in (True, False):
        assert finish_run(places, "steel")[0] == 0
        assert read_numbers(places.results).equal(expected)
        assert ("is damaged" in (places.results / "summary.json").read_text()) == warned
    assert check_files(places.store) == []
