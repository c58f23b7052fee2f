"""Files that others made: their size is looked at first, they are read apart, and what they cannot
hold is named.
"""

import hashlib
import json
import os
import shutil
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

import headstock as hs
from common import Shell, read_json
from fixture_machines import machine, write_scene

SECONDS = 4.0  # of the processor, on a busy machine
BLOCK = machine("""
machine = "block"
names = { mount = "spring" }
name = "block"
components.block.solid = { box = ["40 mm", "60 mm", "90 mm"] }
components.block.interfaces = { foot = { face = "z-" } }
joints.spring.stiffness = { x = "5 N/um", y = "5 N/um", z = "9 N/um", rx = "1e5 N m/rad", ry = "1e5 N m/rad", rz = "1e5 N m/rad" }
points.tcp.tool = "block.foot"
analyses.modal.count = 3
""")
BOX = 'solid = { box = ["40 mm", "60 mm", "90 mm"] }'
RIGID = 'fidelity = "rigid"\n'


def with_sizes(folder: Path, name: str) -> Path:
    """The block with element sizes from a file."""
    sizes = f'fidelity = "elastic"\nmesh = {{ sizes = "{name}" }}\n'
    return write_scene(folder, BLOCK, (RIGID, sizes))


def with_mesh(folder: Path, name: str) -> Path:
    """The block as a mesh from a file."""
    mesh = f'solid = {{ mesh = "{name}", unit = "1 mm" }}'
    foot = ('face = "z-"', 'face = "set:foot"')
    return write_scene(folder, BLOCK, (BOX, mesh), (RIGID, ""), foot)


def refusal(path: Path) -> str:
    start = time.process_time()
    with pytest.raises(hs.SceneError) as caught:
        hs.check(path)
    assert time.process_time() - start < SECONDS
    assert caught.value.problems[0].line
    return str(caught.value)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("big.pos", "may have 200 MB: write a coarser view"),
        ("big.xdmf", "may have 1.0 GB"),
        ("big.inp", "is no text"),
        ("big.bdf", "is no text"),
    ],
)
def test_three_gigabytes_are_refused_unread(tmp_path: Path, name: str, expected: str) -> None:
    (tmp_path / name).touch()
    os.truncate(tmp_path / name, 3_000_000_000)  # without a byte of it on the disk
    said = refusal((with_sizes if name == "big.pos" else with_mesh)(tmp_path, name))
    assert name in said and expected in said


def test_element_sizes_of_megabytes_are_read_apart_and_named_where_they_are_none(
    tmp_path: Path,
) -> None:
    row = "SS(0,0,0,0.1,0,0,0,0.1,0,0,0,0.1){0.01,0.01,0.01,0.02};\n"
    path = tmp_path / "sizes.pos"
    scene = with_sizes(tmp_path, path.name)
    path.write_text('View "x" {\n' + row * 6000 + "};\n")
    hs.check(scene)
    path.write_text(row * 6000 + row.replace("0.02", "-1"))
    assert "must be finite and above zero" in refusal(scene)
    path.write_text("S" * 400_000)
    assert "holds no view of scalar tetrahedra" in refusal(scene)


def test_a_line_of_megabytes_in_an_xdmf_file_takes_no_time(tmp_path: Path) -> None:
    numbers = " ".join(["0.123456789"] * 400_000)
    (tmp_path / "line.xdmf").write_text(f"<Xdmf><Domain>{numbers}</Domain></Xdmf>")
    assert "no solid cells" in refusal(with_mesh(tmp_path, "line.xdmf"))


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run")
    hs.run(write_scene(folder, BLOCK), output=folder / "out")
    return folder / "out"


@pytest.fixture
def folder(finished: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(finished, tmp_path / "out"))


def alter(folder: Path, change: Callable[[dict[str, Any]], object]) -> None:
    summary = read_json(folder / "summary.json")
    change(summary)
    (folder / "summary.json").write_text(json.dumps(summary))


def leaves(value: object, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    if path:
        yield path
    pairs = dict(enumerate(value)) if isinstance(value, list) else value
    for key, inner in pairs.items() if isinstance(pairs, dict) else ():
        yield from leaves(inner, (*path, key))


def test_an_altered_summary_is_a_named_error_or_a_report(folder: Path) -> None:
    text = (folder / "summary.json").read_text()
    named = 0
    # all else that is shown comes from `results.h5`
    places = [
        place for place in leaves(json.loads(text)) if place[0] in ("format", "files", "stages")
    ]
    for number, place in enumerate(places):
        summary = json.loads(text)
        table = summary
        for key in place[:-1]:
            table = table[key]
        if number % 3 == 0:
            del table[place[-1]]
        else:
            table[place[-1]] = [None, "x", 10**40, [], {"a": [{}]}, float("nan")][number % 6]
        (folder / "summary.json").write_text(json.dumps(summary))
        try:
            hs.open(folder)
        except hs.HeadstockError as error:
            named += "summary.json" in str(error)
    assert len(places) > 30
    assert named > len(places) / 3


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda summary: summary["totals"].update(mass_kg=float("nan")), "holds NaN"),
        (lambda summary: summary.update(stages={}), "stages is a dict, not a list"),
        (lambda summary: summary["stages"].append(3), "is 3, not a table"),
        (lambda summary: summary["stages"][-1].update(seconds="1"), "seconds is '1', not a number"),
        (lambda summary: summary["stages"][-1].update(reason="\x1b[2J"), "control character"),
        (lambda summary: summary["stages"][-1].update(peak_rss_mb=10**40), "more than any result"),
        (lambda summary: summary["files"].pop("results.h5"), "results.h5"),
    ],
)  # fmt: skip
def test_report_and_open_name_what_was_altered(
    folder: Path, shell: Shell, change: Callable[[dict[str, Any]], object], expected: str
) -> None:
    alter(folder, change)
    with pytest.raises(hs.HeadstockError) as caught:
        hs.open(folder)
    assert expected in str(caught.value)
    assert "headstock run SCENE" in str(caught.value)
    assert expected in shell.refuses("report", folder)


def test_a_summary_nested_beyond_reason_is_named(folder: Path) -> None:
    (folder / "summary.json").write_text('{"a":' * 100_000)
    with pytest.raises(hs.HeadstockError, match="is not a summary"):
        hs.open(folder)


def reseal(folder: Path) -> None:
    digest = hashlib.sha256((folder / "results.h5").read_bytes()).hexdigest()
    alter(folder, lambda summary: summary["files"]["results.h5"].update(sha256=digest))


@pytest.mark.parametrize("place", ["record/text", "labels", "joints/spring/stiffness", "bomb"])
def test_results_that_unpack_to_gigabytes_are_refused_by_name(
    folder: Path, place: str, shell: Shell
) -> None:
    with h5py.File(folder / "results.h5", "a") as file:
        if place in file:
            del file[place]
        file.create_dataset(place, (6 << 30,), np.uint8, compression="gzip", chunks=(1 << 20,))
        file[place][:3] = 1
    reseal(folder)
    with pytest.raises(hs.HeadstockError, match=f"/{place} claims 6442450944 values"):
        hs.open(folder)
    assert "claims" in shell.refuses("report", folder)


def test_a_record_of_other_values_than_its_types_is_named(folder: Path) -> None:
    with h5py.File(folder / "results.h5", "a") as file:
        text = file["record/text"][()].tobytes()
        assert b'["labels",' in text
        del file["record/text"]
        changed = text.replace(b'["labels",', b'["name",3],["labels",', 1)
        file["record/text"] = np.frombuffer(changed, dtype=np.uint8)
    reseal(folder)
    with pytest.raises(hs.HeadstockError, match=r"record/text\.name is 3, not a str"):
        hs.open(folder)
