"""Outputs are compared number by number: what a run decides passes, and nothing else does
(benchmarks/same_numbers.py).
"""

import base64
import importlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from common import SHIPPED

BENCHMARKS = Path(__file__).resolve().parent.parent / "benchmarks"
FREQUENCIES = [128.2, 326.9, 785.0]
TABLE = b"part,x\ncolumn,0.5\n"


@pytest.fixture
def trees(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.syspath_prepend(BENCHMARKS)
    return importlib.import_module("output_trees")


@pytest.fixture
def same_numbers(trees: Any) -> Any:
    return importlib.import_module("same_numbers")


def vtk_array(*numbers: float) -> str:
    content = np.array([8 * len(numbers)], "<u8").tobytes() + np.array(numbers).tobytes()
    return base64.b64encode(content).decode()


def write_outputs(folder: Path) -> Path:
    """A file of each kind, as a run writes them."""
    (folder / "tables").mkdir(parents=True)
    summary = {
        "status": "done",
        "stages": [{"stage": "mesh", "seconds": 1.25, "peak_rss_mb": 200.1, "reason": "elastic"}],
        "modal": {"frequencies_hz": FREQUENCIES, "compliance": [[1.0, 2e-6], [2e-6, None]]},
        "residual": 1e-13,
        "provenance": {"date": "2026-01-02T03:04:05+00:00"},
    }
    (folder / "summary.json").write_text(json.dumps(summary))
    (folder / "tables" / "modes.csv").write_text(
        "mode,frequency [Hz],seconds,name\n1,128.2,0.5,bends X\n2,326.9,0.6,\n"
    )
    (folder / "1.out.txt").write_text(
        "  mesh   column   1.02 s  1 491 dofs\n\ndone in 5.23 s at 2026-01-02 03:04\nx 426.71018258694535\n"
    )
    (folder / "report.html").write_text(
        f'<p><data value="128.18917122252645">128.2</data> Hz, <data value="1.5">1.50</data> s</p>\n'
        f'<a href="data:text/csv;charset=utf-8;base64,{coded(TABLE)}">CSV</a>\n'
        '<section id="cost">2 s</section><script type="application/json">{"at": [0.5, 1.0]}</script>'
    )
    head = '<DataArray type="Float64" Name="points" format="binary">'
    array = f"{head}{vtk_array(1, 2)}</DataArray>"
    (folder / "modes.vtu").write_text(f"<VTKFile><Points>{array}</Points></VTKFile>")
    with h5py.File(folder / "results.h5", "w") as file:
        file["modal/shapes"] = np.array([[1.0, -0.5], [0.25, 1e-9]])
        file["modal/shapes"].attrs["unit"] = "m"
        file.create_dataset("labels", data=np.array([b"x", b"y"]))
        file.attrs["scale"] = 2.0
        file.create_group("provenance").attrs["date"] = "2026-01-02"
    return folder


def replace_text(name: str, old: str, new: str) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        text = (folder / name).read_text()
        assert old in text
        (folder / name).write_text(text.replace(old, new))

    return change


def change_results(change: Callable[[h5py.File], object]) -> Callable[[Path], None]:
    def change_file(folder: Path) -> None:
        with h5py.File(folder / "results.h5", "r+") as file:
            change(file)

    return change_file


def set_attribute(place: str, key: str, value: object) -> Callable[[Path], None]:
    return change_results(lambda file: file[place].attrs.__setitem__(key, value))


def coded(table: bytes) -> str:
    return base64.b64encode(table).decode()


SUMMARY, MODES, OUT, PAGE = "summary.json", "tables/modes.csv", "1.out.txt", "report.html"
OFF = repr(326.9 + 785 * 1e-9)
LONG = "426.71018258694535"
SHAPES = "modal/shapes"
PASSES = {
    "nothing": lambda folder: None,
    "seconds in JSON": replace_text(SUMMARY, '"seconds": 1.25', '"seconds": 99.5'),
    "memory in JSON": replace_text(SUMMARY, "200.1", "321.9"),
    "date in JSON": replace_text(SUMMARY, "2026-01-02T", "2027-05-06T"),
    "seconds in CSV": replace_text(MODES, "0.5", "0.9"),
    "seconds in text": replace_text(OUT, "1.02 s", "11.7 s"),
    "date in text": replace_text(OUT, "2026-01-02 03:04", "2027-11-12 13:14"),
    "widths of columns": replace_text(OUT, "mesh   column", "mesh  column"),
    "seconds in report": replace_text(PAGE, '"1.5">1.50', '"2.25">2.25'),
    "section of costs": replace_text(PAGE, "2 s</section>", "two seconds</section>"),
    "date in HDF5": set_attribute("provenance", "date", "2027-01-02"),
    "number at 1e-11": replace_text(SUMMARY, "326.9", repr(326.9 + 785 * 1e-11)),
    "small number of a large array": replace_text(SUMMARY, "2e-06", "2.00001e-06"),
    "rounding error": replace_text(SUMMARY, '"residual": 1e-13', '"residual": 4e-13'),
    "number in text at 1e-12": replace_text(OUT, LONG, "426.71018258694578"),
}
# a text in a file, what takes its place, and the place that is named
TEXTS = {
    "number in JSON at 1e-9": (SUMMARY, "326.9", OFF, "/modal/frequencies_hz/[1]"),
    "null in JSON": (SUMMARY, "785.0", "null", "/modal/frequencies_hz/[2]"),
    "length in JSON": (SUMMARY, ", 785.0", "", "/modal/frequencies_hz/"),
    "text in JSON": (SUMMARY, "elastic", "rigid", "/stages/0/reason/ line 1"),
    "key in JSON": (SUMMARY, '"status"', '"state"', "/state/"),
    "real residual": (SUMMARY, '"residual": 1e-13', '"residual": 1e-6', "/residual/"),
    "number in CSV": (MODES, "128.2", "128.2000001", " column 1 frequency [Hz][0]"),
    "text in CSV": (MODES, "bends X", "bends Y", " column 3 name line 1"),
    "head of CSV": (MODES, "[Hz]", "[rad/s]", " head line 1"),
    "word in text": (OUT, "column", "bed", ": line 1"),
    "count in text": (OUT, "1 491", "1 492", ": line 1"),
    "number in text": (OUT, "426.71018", "426.71019", ": line 3"),
    "value in report": (PAGE, "128.189171", "128.189181", ": page line 1"),
    "table in report": (PAGE, coded(TABLE), coded(TABLE.replace(b"5", b"6")), ": table 0 column 1 x"),
    "data of report": (PAGE, "[0.5, 1.0]", "[0.5, 1.00001]", ": data 0/at/[1]"),
    "array of VTU": ("modes.vtu", vtk_array(1, 2), vtk_array(1, 2 + 1e-9), ":/Points/0 points[1]"),
}  # fmt: skip
FAILS: dict[str, tuple[Callable[[Path], object], str]] = {
    name: (replace_text(file, old, new), file + place)
    for name, (file, old, new, place) in TEXTS.items()
}
FAILS |= {
    "number in HDF5": (
        change_results(lambda file: file[SHAPES].__setitem__((0, 0), 1.0 + 1e-9)),
        "results.h5:/modal/shapes[0][0]",
    ),
    "attribute in HDF5": (
        set_attribute(SHAPES, "unit", "mm"),
        "results.h5:/modal/shapes@unit line 1",
    ),
    "number of an attribute": (set_attribute("/", "scale", 2.0 + 1e-8), "results.h5:/@scale"),
    "missing file": (lambda folder: (folder / "modes.vtu").unlink(), "modes.vtu"),
    "another file": (lambda folder: (folder / "more.json").write_text("{}"), "more.json"),
}


def found(trees: Any, folder: Path, change: Callable[[Path], object]) -> list[Any]:
    base, now = write_outputs(folder / "base"), write_outputs(folder / "now")
    change(now)
    result: list[Any] = trees.differences(trees.read_tree(base), trees.read_tree(now))
    return result


@pytest.mark.parametrize("name", PASSES)
def test_what_differs_between_two_runs_of_the_same_code_passes(
    trees: Any, tmp_path: Path, name: str
) -> None:
    assert found(trees, tmp_path, PASSES[name]) == []


@pytest.mark.parametrize("name", FAILS)
def test_any_other_change_is_found_and_its_place_named(
    trees: Any, tmp_path: Path, name: str
) -> None:
    change, place = FAILS[name]
    assert place in {difference.place for difference in found(trees, tmp_path, change)}


def test_single_precision_is_compared_with_its_own_digits(trees: Any) -> None:
    base = np.array([1.0, 0.5], dtype=np.float32)
    assert trees.compare_leaves("", base, np.nextafter(base, np.float32(2))) is None
    assert trees.compare_leaves("", base, base * np.float32(1 + 1e-6)) is not None


def test_not_a_number_equals_itself_only(trees: Any) -> None:
    base = np.array([1.0, np.nan, np.inf])
    assert trees.compare_leaves("", base, base.copy()) is None
    assert trees.compare_leaves("", base, np.array([1.0, 2.0, np.inf])).share == np.inf
    assert trees.compare_leaves("", base, np.array([1.0, np.nan, -np.inf])).share == np.inf


def test_a_worse_difference_stands_before_a_smaller_one(trees: Any) -> None:
    base = {"a": np.array([1.0]), "b": np.array([1.0])}
    now = {"a": np.array([1.0 + 1e-8]), "b": np.array([1.0 + 1e-6])}
    assert [difference.place for difference in trees.differences(base, now)] == ["b", "a"]


def test_paths_of_the_two_trees_are_the_same_place(trees: Any, tmp_path: Path) -> None:
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "1.err.txt").write_text(f"{tmp_path / name}/scene.toml: no such key")
    folders = (tmp_path / "one", tmp_path / "two")
    read = [trees.read_tree(folder, {str(folder): "FOLDER"}) for folder in folders]
    assert trees.differences(*read) == []


def verdict(same_numbers: Any, folder: Path, expected: dict[str, str], **failure: Any) -> Any:
    case = same_numbers.Case("column", ("run column.toml",))
    sides = tuple(same_numbers.Side(folder / name, folder / name) for name in ("base", "now"))
    base = same_numbers.Outcome(folder / "base", 1.0, **failure)
    return same_numbers.judge(
        case, base, same_numbers.Outcome(folder / "now", 1.0), sides=sides, expected=expected
    )


def test_a_judged_difference_passes_and_is_printed_with_its_reason(
    same_numbers: Any, tmp_path: Path
) -> None:
    write_outputs(tmp_path / "base")
    replace_text("summary.json", "elastic", "rigid")(write_outputs(tmp_path / "now"))
    plain = verdict(same_numbers, tmp_path, {})
    assert not plain.same and any("summary.json/stages/0/reason/" in line for line in plain.details)
    judged = verdict(same_numbers, tmp_path, {"column/*.json/stages/*": "a better word"})
    assert judged.same and judged.details == (
        "expected: summary.json/stages/0/reason/ line 1 (a better word)",
    )


def test_a_case_that_fails_is_no_equal_case(same_numbers: Any, tmp_path: Path) -> None:
    write_outputs(tmp_path / "base")
    write_outputs(tmp_path / "now")
    assert verdict(same_numbers, tmp_path, {}).same
    assert not verdict(same_numbers, tmp_path, {}, failure="exit code 1").same
    unknown = verdict(
        same_numbers, tmp_path, {}, failure="exit code 2: No such command", lacks=True
    )
    assert unknown.lacks and "the base lacks this" in unknown.line


def test_every_case_has_a_name_of_its_own_and_every_shipped_scene_is_run(same_numbers: Any) -> None:
    names = [case.name for case in same_numbers.CASES]
    assert len(set(names)) == len(names)
    steps = " ".join(step for case in same_numbers.CASES if not case.full for step in case.steps)
    scenes = [path.name for path in SHIPPED]
    assert scenes and [name for name in scenes if f"run machines/{name}" not in steps] == []
