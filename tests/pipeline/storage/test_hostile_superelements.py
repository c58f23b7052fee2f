"""a superelement file that reaches for other files, or whose numbers or names cannot be true,
is refused by name before it is used.
"""

import hashlib
import json
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from built_superelements import bar
from cases import cases
from common import present
from headstock.geometry.errors import printable
from headstock.pipeline.results.files import read_view
from headstock.pipeline.storage.outputs import OutputError
from headstock.pipeline.storage.records import RecordError, require_plain
from headstock.pipeline.storage.superelements import (
    parse_superelement,
    read_superelement,
    write_superelement,
)

pytestmark = [pytest.mark.hard("H46"), pytest.mark.workers]

SECRET = b"TOPSECRET-PASSWORD-1234567890-abcdefghijklmnopqrstuvwxyz-ABCDEFGHIJ\n"
Change = Callable[[h5py.File, Path], None]


def hostile(tmp_path: Path, change: Change) -> Path:
    """The bar's file after a change, beside a secret, a pipe and another HDF5 file."""
    (tmp_path / "secret.txt").write_bytes(SECRET)
    os.mkfifo(tmp_path / "pipe")
    with h5py.File(tmp_path / "other.h5", "w") as other:
        other["w"] = np.array([b"SECRET-IN-OTHER-H5"])
    path = tmp_path / "part.h5"
    write_superelement(path, bar())
    with h5py.File(path, "r+") as file:
        change(file, tmp_path)
    return path


def external(name: str, shape: tuple[int, ...], kind: str, target: str, size: int) -> Change:
    def change(file: h5py.File, folder: Path) -> None:
        if name in file:
            del file[name]
        file.create_dataset(
            name, shape=shape, dtype=kind, external=[(str(folder / target), 0, size)]
        )

    return change


def virtual(file: h5py.File, folder: Path) -> None:
    del file["warnings"]
    layout = h5py.VirtualLayout((1,), dtype="S18")
    layout[:] = h5py.VirtualSource(folder / "other.h5", "w", (1,), dtype="S18")
    file.create_virtual_dataset("warnings", layout)


def link(name: str, target: object) -> Change:
    def change(file: h5py.File, folder: Path) -> None:
        if name in file:
            del file[name]
        file[name] = h5py.ExternalLink(str(folder / "other.h5"), "/w") if target is None else target

    return change


def put(name: str, value: object) -> Change:
    def change(file: h5py.File, _: Path) -> None:
        if name in file:
            del file[name]
        file[name] = value

    return change


def scale(factor: float, *names: str) -> Change:
    def change(file: h5py.File, _: Path) -> None:
        for name in names:
            file[name][...] = factor * file[name][...]

    return change


def attribute(name: str, value: object, group: str = "/") -> Change:
    def change(file: h5py.File, _: Path) -> None:
        file[group].attrs[name] = value

    return change


def entry(name: str, place: Sequence[int], value: float) -> Change:
    def change(file: h5py.File, _: Path) -> None:
        file[name][tuple(place)] = value

    return change


CHANGES: dict[str, Callable[..., Change]] = {
    change.__name__: change for change in (put, scale, attribute, entry)
}


def rename(old: str, new: str) -> Change:
    return lambda file, _: file.move(old, new)


def refer(file: h5py.File, _: Path) -> None:
    file.create_dataset("unread", data=file.ref, dtype=h5py.ref_dtype)


def refer_beside(file: h5py.File, _: Path) -> None:
    file.attrs.create("unread", file.ref, dtype=h5py.ref_dtype)


def twice(file: h5py.File, _: Path) -> None:
    file["loads/again"] = file["loads"]


def packed(file: h5py.File, _: Path) -> None:
    del file["recovery/points"]
    file.create_dataset("recovery/points", data=present(bar().recovery).points, compression="lzf")


REACHING: dict[str, tuple[Change, str]] = {
    "external words": (external("warnings", (1,), "S64", "secret.txt", 64), "other files"),
    "external numbers": (external("center_of_mass", (3,), "u1", "secret.txt", 3), "other files"),
    "external pipe": (external("warnings", (1,), "S64", "pipe", 64), "other files"),
    "external inside": (external("loads/push/vector", (8,), "u1", "secret.txt", 8), "other files"),
    "external unread": (external("unread", (8,), "u1", "secret.txt", 8), "other files"),
    "virtual": (virtual, "other files"),
    "external link": (link("warnings", None), "is a link"),
    "external link unread": (link("unread", None), "is a link"),
    "soft loop": (link("warnings", h5py.SoftLink("/warnings")), "is a link"),
    "soft link": (link("inertia", h5py.SoftLink("/mass")), "is a link"),
    "group in itself": (twice, "there twice"),
    "filter of a plug-in": (packed, "packed by filters"),
    "compound": (
        put("center_of_mass", np.zeros(3, dtype=[("a", "f8"), ("b", "f8")])),
        "values of type",
    ),
    "references": (refer, "values of type"),
    "words of any length": (
        put("warnings", np.array(["a"], dtype=h5py.string_dtype())),
        "values of type",
    ),
    "a type of its own": (put("unread", np.dtype("f8")), "neither a group nor a data set"),
    "attribute array": (attribute("mass_kg", np.ones(3)), "one number or word"),
    "attribute of references": (refer_beside, "one number or word"),
}
NAMED: dict[str, tuple[Change, str]] = {
    "page in a name": (
        rename("attachments/foot", "attachments/%3Cimg src=x onerror=alert(1)%3E"),
        "is no name",
    ),
    "script in the part's name": (attribute("name", "<script>alert(1)</script>"), "is no name"),
    "folders in a name": (rename("loads/push", "loads/a%0Ab"), "is no name"),
    "title of the terminal": (attribute("name", "\x1b]0;x\x07"), "is no name"),
    "bidirectional name": (rename("loads/push", "loads/a%E2%80%AEb"), "is no name"),
    "endless name": (attribute("name", "a" * 1000), "is no name"),
    "label": (put("labels", np.array([[b"foot", b"\x1b[2J"]] * 8)), "is no name"),
    "labels that are no pairs": (put("labels", np.array([[b"foot"]] * 8)), "pairs of words"),
    "warning": (
        put("warnings", np.array([b"\x1b]0;PWN\x07\x1b[2J\nheadstock: all fine"])),
        "control characters",
    ),
    "free dof": (put("free_dofs", np.array([b"a\x00\x1bb"])), "is no name"),
}


@pytest.mark.process
def test_the_file_before_it_is_changed_is_accepted(tmp_path: Path) -> None:
    assert (
        read_superelement(hostile(tmp_path, lambda file, folder: None)).warnings == bar().warnings
    )


@pytest.mark.parametrize("name", REACHING)
def test_a_file_that_reaches_for_others_or_holds_odd_types_is_refused_before_any_value_is_read(
    tmp_path: Path, name: str
) -> None:
    change, message = REACHING[name]
    path = hostile(tmp_path, change)
    with h5py.File(path, "r") as file, pytest.raises(RecordError, match=message):
        require_plain(file)
    with pytest.raises(RecordError, match=message) as caught:
        parse_superelement("part.h5", path.read_bytes())
    assert "SECRET" not in str(caught.value)


def refuse(path: Path, message: str) -> None:
    with pytest.raises(RecordError, match=message) as caught:
        parse_superelement("part.h5", path.read_bytes())
    assert str(caught.value).startswith("part.h5: ")
    assert printable(str(caught.value)) == str(caught.value)


@cases
def test_a_file_whose_numbers_cannot_be_true_is_refused_by_name(
    tmp_path: Path, how: str, given: tuple[Any, ...], message: str
) -> None:
    refuse(hostile(tmp_path, CHANGES[how](*given)), message)


@pytest.mark.parametrize("name", NAMED)
def test_a_file_whose_names_cannot_be_true_is_refused_by_name(tmp_path: Path, name: str) -> None:
    change, message = NAMED[name]
    refuse(hostile(tmp_path, change), message)


@pytest.mark.process
@pytest.mark.parametrize("name", ["external words", "external pipe", "warning"])
def test_the_child_that_reads_first_refuses_them_too(tmp_path: Path, name: str) -> None:
    change, message = {**REACHING, **NAMED}[name]
    with pytest.raises(RecordError, match=message):
        read_superelement(hostile(tmp_path, change))


def test_results_of_strangers_show_no_other_files_in_a_report(tmp_path: Path) -> None:
    path = tmp_path / "results.h5"
    with h5py.File(path, "w") as file:
        file.attrs["format"] = "headstock results"
        file["view"] = h5py.ExternalLink(str(tmp_path / "other.h5"), "/")
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    totals = dict.fromkeys(("mass_kg", "full_dofs", "reduced_dofs", "seconds", "peak_rss_mb"), 0)
    content = {"format": 2, "name": "x", "status": "done", "totals": totals}
    content |= {name: {} for name in ("versions", "components", "static")}
    content |= {name: [] for name in ("stages", "modal", "warnings", "failures")}
    content["files"] = {"results.h5": {"sha256": digest}}
    (tmp_path / "summary.json").write_text(json.dumps(content))
    with pytest.raises(OutputError, match="is a link"):
        read_view(tmp_path)


def test_what_a_terminal_would_obey_is_replaced_and_all_else_stays() -> None:
    assert printable("\x1b]0;x\x07 a\nb\u202e\u2028 ± µm → é 漢") == "?]0;x? a?b?? ± µm → é 漢"
