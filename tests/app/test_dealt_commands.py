"""Starts of a fit, trials of effects and variants of a comparison, dealt out to two ranks, are those
of one.
"""

import json
from pathlib import Path
from typing import Any

import pytest

from common import approx, run_command
from fixture_machines import machine, write_scene

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
TARGETS = """
[fit]
starts = 4
[cases.column]
frequencies = ["400 Hz", "600 Hz", "1400 Hz"]
[parameters.x]
keys = ["joints.mount.stiffness.x"]
bounds = ["20 N/um", "500 N/um"]
[parameters.y]
keys = ["joints.mount.stiffness.y"]
bounds = ["20 N/um", "500 N/um"]
[parameters.z]
keys = ["joints.mount.stiffness.z"]
bounds = ["20 N/um", "900 N/um"]
"""


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    path = write_scene(tmp_path, SCENE, name="column")
    (tmp_path / "targets.toml").write_text(TARGETS)
    return path


def run_both(folder: Path, *words: str) -> list[tuple[int, str, str, Any]]:
    """Exit code, output, errors and the file of ``--json`` on one rank and on two."""
    found = []
    for ranks in (1, 2):
        listing = folder / f"{ranks}.json"
        output = () if words[0] == "effects" else ("-o", str(folder / f"out{ranks}"))
        done = run_command(ranks, folder, *words, *output, "--json", str(listing))
        listed = json.loads(listing.read_text()) if listing.is_file() else None
        found.append((done.returncode, done.stdout, done.stderr, listed))
    return found


def assert_same(one: Any, two: Any, *, but: tuple[str, ...] = ()) -> None:
    """The same but for rounding, and for what is named."""
    if isinstance(one, dict):
        assert one.keys() == two.keys()
        for key in one.keys() - {*but}:
            assert_same(one[key], two[key], but=but)
    elif isinstance(one, list):
        assert len(one) == len(two)
        for mine, other in zip(one, two, strict=True):
            assert_same(mine, other, but=but)
    else:
        expected = approx(one, rel=1e-10, abs=1e-12) if isinstance(one, float) else one
        assert two == expected


@pytest.mark.trials
def test_the_starts_of_a_fit_dealt_out_to_ranks_are_those_of_one(
    scene: Path, tmp_path: Path
) -> None:
    one, two = run_both(tmp_path, "identify", str(scene), str(tmp_path / "targets.toml"))
    assert (one[0], two[0]) == (0, 0), one[2] + two[2]
    assert len(one[3]["starts"]) == 4 and one[3]["starts"][0]["evaluations"] > 2
    assert_same(one[3], two[3], but=("seconds", "provenance"))
    assert two[1].count("\n  start  ") == 4 and two[1].count("Parameters (") == 1
    files = [(tmp_path / f"out{ranks}" / "calibrated.toml").read_text() for ranks in (1, 2)]
    assert files[0] == files[1]


@pytest.mark.trials
def test_the_trials_of_effects_dealt_out_to_ranks_are_those_of_one(
    scene: Path, tmp_path: Path
) -> None:
    one, two = run_both(tmp_path, "effects", str(scene))
    assert (one[0], two[0]) == (0, 0), one[2] + two[2]
    tried = {trial["effect"]: trial for trial in one[3]["effects"]}
    assert tried["gravity"]["largest_change"] > 0.0 and tried["friction"]["obstacle"]
    assert all(trial["seconds_with"] > 0.0 for trial in two[3]["effects"] if not trial["obstacle"])
    changes = [
        {(each["kind"], each["tried"]): each for each in found[3].pop("models")}
        for found in (one, two)
    ]
    assert changes[0]["elasticity", "rigid"]["worth"] > 0.01
    times = ("seconds_with", "seconds_without", "time_share", "time_noise", "provenance")
    assert_same(one[3], two[3], but=times)
    # what to do depends on what it costs
    prices = ("price_as_written", "price_as_tried", "time_saved_share", "worth_over_price")
    assert_same(*changes, but=(*prices, "action", "verdict"))
    assert two[1].count("Summary of effects") == two[1].count("Summary of models") == 1


@pytest.mark.trials
def test_the_variants_of_a_comparison_dealt_out_to_ranks_are_those_of_one(
    scene: Path, tmp_path: Path
) -> None:
    one, two = run_both(tmp_path, "compare", str(scene), "--fidelity", "rigid,segmented,elastic")
    assert (one[0], two[0]) == (0, 0), one[2] + two[2]
    assert len(one[3]["columns"]) == 3
    # the components are in the store before a variant begins
    effort = ("seconds", "cpu_seconds", "import_seconds", "peak_rss_mb", "elastic_stored")
    assert_same(one[3], two[3], but=("provenance", "effort", *effort))
    assert two[1].count("done in") == 1


@pytest.mark.parametrize(
    ("words", "old", "new"),
    [
        *(
            (words, 'size = "25 mm"', 'size = "25 um"')
            for words in ("identify", "compare", "effects")
        ),
        ("effects", 'material = "steel"', 'material = "stel"'),
    ],
)
@pytest.mark.trials
def test_what_fails_ends_two_ranks_with_the_message_of_one(
    scene: Path, tmp_path: Path, words: str, old: str, new: str
) -> None:
    text = SCENE.replace('fidelity = "segmented"\n', "").replace(old, new)
    scene.write_text(text.replace('segments = { along = "z", count = 4 }\n', ""))
    files = [str(tmp_path / "targets.toml")] if words == "identify" else []
    one, two = run_both(tmp_path, words, str(scene), *files)
    assert one[0] == two[0] != 0
    assert one[2].strip() and two[2].startswith(one[2].rstrip("\n"))
    assert "MPI_ABORT" not in two[2]
