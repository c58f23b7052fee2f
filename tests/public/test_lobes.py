"""Stability lobes: every speed drawn has its limit, or is hatched."""

import csv
import json
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import headstock as hs
from common import approx
from headstock.app.command_line import main

ROOT = Path(__file__).resolve().parents[2]
SCENES = ROOT / "validation" / "references" / "milling_limits"
LIMITS = tomllib.loads((SCENES / "limits.toml").read_text())


@pytest.fixture(autouse=True)
def _own_store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def run_lobes(name: str, folder: Path, **changes: object) -> dict[str, NDArray[np.str_]]:
    """Columns of the table of limits of a scene, by heading; all directions in a row."""
    keys = [f"--set=analyses.lobes.{key}={json.dumps(value)}" for key, value in changes.items()]
    scene = str(SCENES / f"{name}.toml")
    assert (
        main(["run", scene, "-o", str(folder), "--analysis", "lobes", "--no-figures", *keys]) == 0
    )
    with (folder / "tables" / "limits_reference.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    return {head: np.array([row[head] for row in rows]) for head in rows[0]}


def number(column: NDArray[np.str_]) -> NDArray[np.float64]:
    return np.array([float(text) if text else np.nan for text in column])


@pytest.mark.parametrize("name", sorted(LIMITS))
def test_limits_are_the_converged_border_and_none_is_unsafe(name: str, tmp_path: Path) -> None:
    table = run_lobes(name, tmp_path / "out")
    true = np.concatenate([own["limit_mm"] for own in LIMITS[name].values()])
    directions = np.concatenate([[key] * len(own["rpm"]) for key, own in LIMITS[name].items()])
    found, errors = number(table["limit depth [mm]"]), number(table["± [mm]"])
    order = np.argsort(directions, kind="stable"), np.argsort(table["travel"], kind="stable")
    found, errors, true = found[order[1]], errors[order[1]], true[order[0]]
    assert len(found) == len(true) > 9
    np.testing.assert_allclose(found, true, rtol=0.01)
    limited = table["limited"][order[1]] == "True"
    assert (found[limited] - true[limited] < errors[limited] + 1e-4 * true[limited]).all()
    assert np.isfinite(errors[limited]).all() and np.isnan(errors[~limited]).all()


def test_limits_do_not_depend_on_up_to(tmp_path: Path) -> None:
    low, high = (
        number(run_lobes("two_along", tmp_path / str(hz), up_to=f"{hz} Hz")["limit depth [mm]"])
        for hz in (500, 5000)
    )
    np.testing.assert_allclose(low, high, rtol=2e-3)
    summary = json.loads((tmp_path / "500" / "summary.json").read_text())
    assert summary["lobes"]["reference"]["modes_to_hz"] == approx(1529.0, rel=1e-3)


def test_picture_table_terminal_and_summary_have_one_border(tmp_path: Path) -> None:
    table = run_lobes("half_down", tmp_path / "out")
    found = number(table["limit depth [mm]"])
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    (direction,) = summary["lobes"]["reference"]["directions"]
    np.testing.assert_allclose(direction["series"]["limit_depth_mm"], found, rtol=1e-12)
    assert direction["lowest"]["limit_depth_mm"] == approx(found.min())
    page = (tmp_path / "out" / "report.html").read_text()
    svg = page[page.index("Travel x: limit depth of cut") :].partition("</svg>")[0]
    # the line runs through the dots of the limits: heights are proportional to depths
    dots = re.findall(r'<circle cx="[^"]+" cy="([^"]+)" r="2"', svg)
    assert len(dots) == len(found)
    heights = np.array(dots, dtype=float)
    slope, foot = np.polyfit(found, heights, 1)
    np.testing.assert_allclose(heights, slope * found + foot, atol=0.1)
    assert slope < 0.0
    assert main(["report", str(tmp_path / "out")]) == 0
    assert hs.open(tmp_path / "out")


def test_speeds_that_are_not_looked_at_are_empty_and_hatched(tmp_path: Path) -> None:
    table = run_lobes("half_down", tmp_path / "out", checked=0.3)
    known = np.isfinite(number(table["limit depth [mm]"]))
    assert known.sum() == 4 and known[[0, -1]].all()
    page = (tmp_path / "out" / "report.html").read_text()
    assert "hatched: nothing is known" in page


def test_a_range_without_a_limit_is_no_error(tmp_path: Path) -> None:
    table = run_lobes(
        "slot", tmp_path / "out", speeds=["20000 rpm", "21000 rpm", 3], deepest="0.2 mm"
    )
    assert set(table["limited"]) == {"False"}
    np.testing.assert_allclose(number(table["limit depth [mm]"]), 0.2)


@pytest.mark.parametrize(
    ("changes", "key", "text"),
    [
        ({"speeds": ["1 rpm", "10 rpm", 3]}, "analyses.lobes.speeds", "begin at"),
        ({"speeds": ["1000 rpm", "9000 rpm", 1]}, "analyses.lobes.speeds[2]", "2 and 5000"),
        ({"mill.teeth": 0}, "analyses.lobes.mill.teeth", "1 and 40"),
        ({"mill.helix": "90 deg"}, "analyses.lobes.mill.helix", "75"),
        ({"low_immersion": 0.1}, "analyses.lobes.low_immersion", "remove the key"),
    ],
)
def test_what_cannot_be_computed_is_refused_by_its_key(
    changes: dict[str, object], key: str, text: str
) -> None:
    keys = {f"analyses.lobes.{name}": value for name, value in changes.items()}
    with pytest.raises(hs.SceneError, match=re.escape(key)) as caught:
        hs.load(SCENES / "slot.toml", set=keys)
    assert text in str(caught.value)


def test_up_milling_on_one_side_mirrors_up_milling_on_the_other(tmp_path: Path) -> None:
    right, left = (
        number(
            run_lobes("two_up", tmp_path / side, part_side=side, directions=["x"])[
                "limit depth [mm]"
            ]
        )
        for side in ("right", "left")
    )
    np.testing.assert_allclose(right, left, rtol=2e-3)
