"""Every number of a run by its name, on the command line, in files and in Python."""

import csv
import json
import sys
from pathlib import Path

import numpy as np
import pytest
from cross_slide import SCENE

import headstock as hs
from common import approx, call, run_process
from headstock.app.command_line import main

FIRST = "frequency(pose=left,mode=1)"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("numbers")
    (path / "scene.toml").write_text(SCENE)
    assert main(["run", str(path / "scene.toml"), "-o", str(path / "out"), "--no-figures"]) == 0
    return path / "out"


def test_a_table_lists_numbers_with_units_of_the_report(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    printed = call(capsys, ["numbers", str(folder)]).out
    assert FIRST in printed and "µm/kN" in printed and "not in ±" in printed
    printed = call(capsys, ["numbers", str(folder), "frequency"]).out
    assert FIRST in printed and "compliance(" not in printed


def test_files_hold_numbers_in_si_units(folder: Path, tmp_path: Path) -> None:
    table, listing = tmp_path / "n.csv", tmp_path / "n.json"
    arguments = ["numbers", str(folder), "compliance(*direction=x)"]
    assert main([*arguments, "--csv", str(table), "--json", str(listing)]) == 0
    rows = list(csv.DictReader(table.read_text().splitlines()))
    entries = json.loads(listing.read_text())
    summary = json.loads((folder / "summary.json").read_text())
    wanted = 1e-9 * summary["static"]["tcp"]["compliance_um_per_kN"][0][0]
    assert [row["name"] for row in rows] == [entry["name"] for entry in entries]
    assert [float(row["value"]) for row in rows] == [entry["value"] for entry in entries]
    (entry,) = [entry for entry in entries if "point=tcp" in entry["name"]]
    assert entry["value"] == approx(wanted, rel=1e-12) and entry["unit"] == "m/N"
    assert entry["±"] is None and entry["not in ±"]
    assert {"± known", "± by source"} <= entry.keys()


@pytest.mark.parametrize("pattern", ["frequncy", "frequency(pose=nowhere*)", "compliance[0]"])
def test_a_pattern_without_a_match_lists_the_names(
    folder: Path, pattern: str, capsys: pytest.CaptureFixture[str]
) -> None:
    said = call(capsys, ["numbers", str(folder), pattern], 2).err
    assert repr(pattern) in said and "(pose=left" in said


def test_numbers_of_python_are_those_of_the_file(folder: Path) -> None:
    numbers = hs.open(folder).numbers
    listed = {str(key): number.value for key, number in numbers.items()}
    assert numbers[FIRST].unit == "Hz" and numbers[FIRST].value == listed[FIRST]
    with pytest.raises(KeyError, match="frequency"):
        numbers["frequency(pose=left,mode=99)"]
    frame = numbers.select("frequency").to_pandas()
    assert list(frame["mode"]) == list(range(1, len(frame) + 1))
    np.testing.assert_array_equal(frame["value"], [listed[name] for name in frame["name"]])
    assert {"kind", "pose", "unit", "±", "not in ±"} <= set(frame.columns)


def test_numbers_open_without_a_solver(folder: Path) -> None:
    program = (
        "import sys; from pathlib import Path; from headstock.pipeline.numbers.folders import read_run_numbers;"
        f"found = read_run_numbers(Path({str(folder)!r})); print(len(found));"
        "print([name for name in sys.modules if name.startswith(('headstock.solvers', 'headstock.reduction',"
        " 'headstock.pipeline.answers', 'dolfinx', 'scipy'))])"
    )
    told = run_process([sys.executable, "-c", program], check=True).stdout.split("\n")
    assert int(told[0]) > 5 and told[1] == "[]"


def test_a_folder_of_an_earlier_version_is_refused_with_the_remedy(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    import hashlib
    import shutil

    import h5py

    old = tmp_path / "old"
    shutil.copytree(folder, old)
    with h5py.File(old / "results.h5", "a") as file:
        file.attrs["version"] = 2
        del file["numbers"]
    summary = json.loads((old / "summary.json").read_text())
    digest = hashlib.sha256((old / "results.h5").read_bytes()).hexdigest()
    summary["files"]["results.h5"]["sha256"] = digest
    (old / "summary.json").write_text(json.dumps(summary))
    said = call(capsys, ["numbers", str(old)], 2).err
    assert "version 2" in said and "headstock run" in said


@pytest.mark.parametrize(
    ("command", "labels"),
    [
        (("sweep", "line"), {""}),
        (("study", "drive"), {"point 1", "point 2"}),
        (("compare", "--variants", "stiff"), {"as written", "stiff"}),
    ],
    ids=lambda value: value[0] if isinstance(value, tuple) else "",
)
def test_studies_sweeps_and_comparisons_have_numbers_too(
    command: tuple[str, ...], labels: set[str], tmp_path: Path
) -> None:
    (tmp_path / "scene.toml").write_text(SCENE)
    name, *options = command
    out, listing = tmp_path / "out", tmp_path / "n.json"
    assert main([name, str(tmp_path / "scene.toml"), *options, "-o", str(out)]) == 0
    assert main(["numbers", str(out), "frequency(*mode=1)", "--json", str(listing)]) == 0
    entries = json.loads(listing.read_text())
    assert {entry.get("of", "") for entry in entries} == labels
    assert all(entry["value"] > 1.0 and entry["unit"] == "Hz" for entry in entries)
    assert main(["numbers", str(out), "nothing"]) == 2


def test_a_run_in_the_folder_of_a_study_shows_its_own_numbers(tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text(SCENE)
    scene, out, listing = tmp_path / "scene.toml", tmp_path / "out", tmp_path / "n.json"
    assert main(["study", str(scene), "drive", "-o", str(out)]) == 0
    assert main(["run", str(scene), "-o", str(out), "--no-figures"]) == 0
    assert main(["numbers", str(out), "frequency", "--json", str(listing)]) == 0
    assert not any("of" in entry for entry in json.loads(listing.read_text()))
