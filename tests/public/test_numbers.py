"""Every number of a run by its name, on the command line, in files and in Python."""

import hashlib
import json
import shutil
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
from cross_slide import SCENE

import headstock as hs
from common import Shell, approx, read_json, run_once, run_process

FIRST = "frequency(pose=left,mode=1)"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return run_once(tmp_path_factory.mktemp("numbers"), SCENE)


def test_a_table_lists_numbers_with_units_of_the_report(folder: Path, shell: Shell) -> None:
    printed = shell(f"numbers {folder}").out
    assert FIRST in printed and "µm/kN" in printed and "not in ±" in printed
    printed = shell(f"numbers {folder} frequency").out
    assert FIRST in printed and "compliance(" not in printed


def test_files_hold_numbers_in_si_units(folder: Path, shell: Shell) -> None:
    shell(f"numbers {folder} 'compliance(*direction=x)' --csv n.csv --json n.json")
    rows, entries = shell.rows("n.csv"), shell.json("n.json")
    compliances = read_json(folder / "summary.json")["static"]["tcp"]["compliance_um_per_kN"]
    assert [row["name"] for row in rows] == [entry["name"] for entry in entries]
    assert [float(row["value"]) for row in rows] == [entry["value"] for entry in entries]
    (entry,) = [entry for entry in entries if "point=tcp" in entry["name"]]
    assert entry["value"] == approx(1e-9 * compliances[0][0], rel=1e-12)
    assert entry["unit"] == "m/N"
    assert entry["±"] is None and entry["not in ±"]
    assert {"± known", "± by source"} <= entry.keys()


@pytest.mark.parametrize("pattern", ["frequncy", "frequency(pose=nowhere*)", "compliance[0]"])
def test_a_pattern_without_a_match_lists_the_names(
    folder: Path, pattern: str, shell: Shell
) -> None:
    said = shell(f"numbers {folder} '{pattern}'", code=2).err
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
    folder: Path, shell: Shell
) -> None:
    old = Path(shutil.copytree(folder, shell.folder / "old"))
    with h5py.File(old / "results.h5", "a") as file:
        file.attrs["version"] = 2
        del file["numbers"]
    summary = read_json(old / "summary.json")
    digest = hashlib.sha256((old / "results.h5").read_bytes()).hexdigest()
    summary["files"]["results.h5"]["sha256"] = digest
    (old / "summary.json").write_text(json.dumps(summary))
    said = shell("numbers old", code=2).err
    assert "version 2" in said and "headstock run" in said


@pytest.mark.parametrize(
    ("line", "labels"),
    [
        ("sweep scene.toml line", {""}),
        ("study scene.toml drive", {"point 1", "point 2"}),
        ("compare scene.toml --variants stiff", {"as written", "stiff"}),
    ],
)
def test_studies_sweeps_and_comparisons_have_numbers_too(
    line: str, labels: set[str], shell: Shell
) -> None:
    shell.write(SCENE)
    shell(f"{line} -o out")
    shell("numbers out 'frequency(*mode=1)' --json n.json")
    entries = shell.json("n.json")
    assert {entry.get("of", "") for entry in entries} == labels
    assert all(entry["value"] > 1.0 and entry["unit"] == "Hz" for entry in entries)
    shell("numbers out nothing", code=2)


def test_a_run_in_the_folder_of_a_study_shows_its_own_numbers(shell: Shell) -> None:
    shell.write(SCENE)
    shell("study scene.toml drive -o out")
    shell("run scene.toml -o out --no-figures")
    shell("numbers out frequency --json n.json")
    assert shell.json("n.json") and not any("of" in entry for entry in shell.json("n.json"))
