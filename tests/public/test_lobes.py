"""Stability lobes: every speed drawn has its limit, or is hatched."""

import json
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import headstock as hs
from common import Shell, approx

ROOT = Path(__file__).resolve().parents[2]
SCENES = ROOT / "validation" / "references" / "milling_limits"
LIMITS = tomllib.loads((SCENES / "limits.toml").read_text())


Columns = dict[str, NDArray[np.str_]]


def run_lobes(shell: Shell, name: str, out: str = "out", **changes: object) -> Columns:
    """Columns of the table of limits of a scene, by heading; all directions in a row."""
    keys = [f"--set=analyses.lobes.{key}={json.dumps(value)}" for key, value in changes.items()]
    shell(f"run {SCENES / name}.toml -o {out} --analysis lobes --no-figures", *keys)
    rows = shell.rows(f"{out}/tables/limits_reference.csv")
    return {head: np.array([row[head] for row in rows]) for head in rows[0]}


def depths(table: Columns) -> NDArray[np.float64]:
    """Limit depths of cut [mm]."""
    return number(table["limit depth [mm]"])


def number(column: NDArray[np.str_]) -> NDArray[np.float64]:
    return np.array([float(text) if text else np.nan for text in column])


@pytest.mark.parametrize("name", sorted(LIMITS))
def test_limits_are_the_converged_border_and_none_is_unsafe(name: str, shell: Shell) -> None:
    table = run_lobes(shell, name)
    true = np.concatenate([own["limit_mm"] for own in LIMITS[name].values()])
    directions = np.concatenate([[key] * len(own["rpm"]) for key, own in LIMITS[name].items()])
    found, errors = depths(table), number(table["± [mm]"])
    order = np.argsort(directions, kind="stable"), np.argsort(table["travel"], kind="stable")
    found, errors, true = found[order[1]], errors[order[1]], true[order[0]]
    assert len(found) == len(true) > 9
    np.testing.assert_allclose(found, true, rtol=0.01)
    limited = table["limited"][order[1]] == "True"
    assert (found[limited] - true[limited] < errors[limited] + 1e-4 * true[limited]).all()
    assert np.isfinite(errors[limited]).all() and np.isnan(errors[~limited]).all()


def test_limits_do_not_depend_on_up_to(shell: Shell) -> None:
    low, high = (
        depths(run_lobes(shell, "two_along", str(hz), up_to=f"{hz} Hz")) for hz in (500, 5000)
    )
    np.testing.assert_allclose(low, high, rtol=2e-3)
    lobes = shell.json("500/summary.json")["lobes"]["reference"]
    assert lobes["modes_to_hz"] == approx(1529.0, rel=1e-3)


def test_picture_table_terminal_and_summary_have_one_border(shell: Shell) -> None:
    found = depths(run_lobes(shell, "half_down"))
    (direction,) = shell.json("out/summary.json")["lobes"]["reference"]["directions"]
    np.testing.assert_allclose(direction["series"]["limit_depth_mm"], found, rtol=1e-12)
    assert direction["lowest"]["limit_depth_mm"] == approx(found.min())
    page = shell.text("out/report.html")
    svg = page[page.index("Travel x: limit depth of cut") :].partition("</svg>")[0]
    # the line runs through the dots of the limits: heights are proportional to depths
    dots = re.findall(r'<circle cx="[^"]+" cy="([^"]+)" r="2"', svg)
    assert len(dots) == len(found)
    heights = np.array(dots, dtype=float)
    slope, foot = np.polyfit(found, heights, 1)
    np.testing.assert_allclose(heights, slope * found + foot, atol=0.1)
    assert slope < 0.0
    shell("report out")
    assert hs.open("out")


def test_speeds_that_are_not_looked_at_are_empty_and_hatched(shell: Shell) -> None:
    known = np.isfinite(depths(run_lobes(shell, "half_down", checked=0.3)))
    assert known.sum() == 4 and known[[0, -1]].all()
    assert "hatched: nothing is known" in shell.text("out/report.html")


def test_a_range_without_a_limit_is_no_error(shell: Shell) -> None:
    speeds = ["20000 rpm", "21000 rpm", 3]
    table = run_lobes(shell, "slot", speeds=speeds, deepest="0.2 mm")
    assert set(table["limited"]) == {"False"}
    np.testing.assert_allclose(depths(table), 0.2)


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


def test_up_milling_on_one_side_mirrors_up_milling_on_the_other(shell: Shell) -> None:
    right, left = (
        depths(run_lobes(shell, "two_up", side, part_side=side, directions=["x"]))
        for side in ("right", "left")
    )
    np.testing.assert_allclose(right, left, rtol=2e-3)
