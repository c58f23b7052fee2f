"""Starts of a fit, trials of effects and variants of a comparison, dealt out to two ranks, are those
of one.
"""

from pathlib import Path
from typing import Any

import pytest

from common import Done, approx, read_json, read_leaves, run_command
from fixture_machines import machine, targets, write_scene

pytestmark = pytest.mark.process

SCENE = machine("""
machine = "block"
names = { block = "column" }
name = "A column on springs"
components.column.fidelity = "segmented"
components.column.solid = { box = ["50 mm", "50 mm", "200 mm"] }
components.column.mesh = { size = "25 mm" }
components.column.segments = { along = "z", count = 4 }
components.column.interfaces = { foot = { face = "z-" }, tip = { face = "z+", coupling = "average" } }
joints.mount.stiffness = { x = "100 N/um", y = "80 N/um", z = "200 N/um", rx = "1 MN m/rad", ry = "1 MN m/rad", rz = "1 MN m/rad" }
""")
SPRING = "joints.mount.stiffness.{}: 20 N/um, {} N/um"
BOUNDS = {axis: SPRING.format(axis, high) for axis, high in (("x", 500), ("y", 500), ("z", 900))}
TARGETS = "[fit]\nstarts = 4\n" + targets(400, 600, 1400, **BOUNDS)


@pytest.fixture
def column(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder, with the column and targets."""
    monkeypatch.chdir(tmp_path)
    write_scene(tmp_path, SCENE)
    write_scene(tmp_path, TARGETS, name="targets")
    return tmp_path


def run_both(folder: Path, line: str, *, well: bool = True) -> tuple[list[Done], list[Any]]:
    """How a command ends on one rank and on two, and the files of ``--json``."""
    ends, found = [], []
    for ranks in (1, 2):
        output = "" if line.startswith("effects") else f"-o out{ranks}"
        words = f"{line} {output} --json {ranks}.json".split()
        ends.append(run_command(ranks, folder, *words))
        if well:
            assert ends[-1].returncode == 0, ends[-1].stderr
            found.append(read_json(folder / f"{ranks}.json"))
    return ends, found


def assert_same(one: Any, two: Any, *, but: tuple[str, ...] = ()) -> None:
    """The same but for rounding, and for what is named."""
    mine, other = (read_leaves(each, but.__contains__) for each in (one, two))
    assert len(mine) > 3
    assert other == approx(mine, rel=1e-10, abs=1e-12)


@pytest.mark.trials
def test_the_starts_of_a_fit_dealt_out_to_ranks_are_those_of_one(column: Path) -> None:
    (_, end), (one, two) = run_both(column, "identify scene.toml targets.toml")
    assert len(one["starts"]) == 4 and one["starts"][0]["evaluations"] > 2
    assert_same(one, two, but=("seconds", "provenance"))
    assert end.stdout.count("\n  start  ") == 4 and end.stdout.count("Parameters (") == 1
    files = [(column / f"out{ranks}" / "calibrated.toml").read_text() for ranks in (1, 2)]
    assert files[0] == files[1]


@pytest.mark.trials
def test_the_trials_of_effects_dealt_out_to_ranks_are_those_of_one(column: Path) -> None:
    (_, end), (one, two) = run_both(column, "effects scene.toml")
    tried = {trial["effect"]: trial for trial in one["effects"]}
    assert tried["gravity"]["largest_change"] > 0.0 and tried["friction"]["obstacle"]
    assert all(trial["seconds_with"] > 0.0 for trial in two["effects"] if not trial["obstacle"])
    changes = [
        {f"{each['kind']} {each['tried']}": each for each in found.pop("models")}
        for found in (one, two)
    ]
    assert changes[0]["elasticity rigid"]["worth"] > 0.01
    times = ("seconds_with", "seconds_without", "time_share", "time_noise", "provenance")
    assert_same(one, two, but=times)
    # what to do depends on what it costs
    prices = ("price_as_written", "price_as_tried", "time_saved_share", "worth_over_price")
    assert_same(*changes, but=(*prices, "action", "verdict"))
    for title in ("Summary of effects", "Summary of models"):
        assert end.stdout.count(title) == 1


@pytest.mark.trials
def test_the_variants_of_a_comparison_dealt_out_to_ranks_are_those_of_one(column: Path) -> None:
    line = "compare scene.toml --fidelity rigid,segmented,elastic"
    (_, end), (one, two) = run_both(column, line)
    assert len(one["columns"]) == 3
    # the components are in the store before a variant begins
    effort = ("seconds", "cpu_seconds", "import_seconds", "peak_rss_mb", "elastic_stored")
    assert_same(one, two, but=("provenance", "effort", *effort))
    assert end.stdout.count("done in") == 1


TINY = ('size = "25 mm"', 'size = "25 um"')


@pytest.mark.parametrize(
    ("line", "change"),
    [
        ("identify scene.toml targets.toml", TINY),
        ("compare scene.toml", TINY),
        ("effects scene.toml", TINY),
        ("effects scene.toml", ('material = "steel"', 'material = "stel"')),
    ],
)
@pytest.mark.trials
def test_what_fails_ends_two_ranks_with_the_message_of_one(
    column: Path, line: str, change: tuple[str, str]
) -> None:
    segments = 'segments = { along = "z", count = 4 }\n'
    write_scene(column, SCENE, ('fidelity = "segmented"\n', ""), (segments, ""), change)
    (one, two), _ = run_both(column, line, well=False)
    assert one.returncode == two.returncode != 0
    assert one.stderr.strip() and two.stderr.startswith(one.stderr.rstrip("\n"))
    assert "MPI_ABORT" not in two.stderr
