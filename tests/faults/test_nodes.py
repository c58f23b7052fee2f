"""Ranks on two nodes of a real Slurm, as root: ``./headstock test -m faults
tests/faults/test_nodes.py``; the launcher enters a root that has one.
"""

import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from common import approx, read_json, read_leaves
from faults.nodes import SIZES_MM, TwoNodes, fail_node_under_study, run_two_nodes
from faults.runs import SCENE, Numbers, read_numbers
from faults.slurm_daemons import DAEMONS
from fixture_machines import targets
from headstock.pipeline.storage.provenance import PROJECT

pytestmark = [
    pytest.mark.faults,
    pytest.mark.workers,
    pytest.mark.skipif(
        os.geteuid() != 0 or None in map(shutil.which, DAEMONS),
        reason="no Slurm here, or not root: name this file to the launcher",
    ),
]
SPLIT_EQUAL = 1e-9  # a component that ranks share is factorised in another order
DEALT_EQUAL = 1e-8
# estimated errors, and what a limit makes of them
ESTIMATE_EQUAL = 0.01
ESTIMATES = ("error", "from_limit", "order")
# numbers that say what a run took, not what it found
COSTS = (
    *("second", "_mb", "_s", "cpu", "time", "speed", "provenance", "stages", "totals", "versions"),
    "files",
)
SPRUNG = SCENE.replace(
    'kind = "rigid"',
    """kind = "spring"
stiffness = { x = "10 N/um", y = "12 N/um", z = "40 N/um", rx = "1 MN m/rad", ry = "1 MN m/rad", rz = "1 MN m/rad" }""",
)
TARGETS = targets(200, 240, clamp="joints.clamp.stiffness.x: 2 N/um, 50 N/um")


@pytest.fixture(scope="module")
def two() -> Iterator[TwoNodes]:
    with run_two_nodes() as nodes:
        yield nodes


def finish(two: TwoNodes, words: list[str], output: str, **options: Any) -> str:
    """Run a command to a good end with a store of its own; what it printed."""
    done = two.run(words, store=f"store-{output}", **options)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def run_machine(two: TwoNodes, output: str, *, nodes: int, ranks: int, split: bool) -> Numbers:
    words = [*two.words("run", output), "--ranks", str(ranks)]
    variables = {"HEADSTOCK_SPLIT_DOFS": "0"} if split else {}
    finish(two, words, output, nodes=nodes, **variables)
    return read_numbers(two.root / output)


def launched(two: TwoNodes, before: tuple[int, ...]) -> list[int]:
    """How many job steps each node has begun since."""
    return [now - old for now, old in zip(two.launches(), before, strict=True)]


def read_found(path: Path) -> dict[str, float]:
    """Numbers of a JSON file by their place in it, without what they took."""
    found = read_leaves(read_json(path), lambda key: any(cost in key for cost in COSTS))
    return {place: float(leaf) for place, leaf in found.items() if isinstance(leaf, int | float)}


def assert_equal(found: Numbers, expected: Numbers, share: float) -> None:
    for one, other in (
        (found.compliance, expected.compliance),
        (found.frequencies_hz, expected.frequencies_hz),
    ):
        np.testing.assert_allclose(one, other, rtol=0.0, atol=share * np.abs(other).max())


def test_shared_memory_alone_does_not_reach_the_other_node_and_the_launcher_adds_tcp(
    two: TwoNodes,
) -> None:
    words = [*two.words("run", "transports"), "--ranks", "2"]
    alone = two.run(words, nodes=2, store="store-transports", OMPI_MCA_btl="self,sm")
    assert alone.returncode != 0
    assert "MPI_ERR_INTERN" in alone.stderr
    before = two.launches()
    finish(two, words, "transports", nodes=2)
    assert launched(two, before) == [1, 1]


def test_a_part_split_over_two_nodes_is_that_of_one_node_and_of_one_rank(two: TwoNodes) -> None:
    over_nodes = run_machine(two, "split-2", nodes=2, ranks=3, split=True)
    on_one = run_machine(two, "split-1", nodes=1, ranks=3, split=True)
    assert_equal(over_nodes, on_one, SPLIT_EQUAL)
    assert_equal(over_nodes, run_machine(two, "one", nodes=1, ranks=1, split=False), SPLIT_EQUAL)


def test_a_study_dealt_to_two_nodes_is_that_of_one_node_byte_for_byte(two: TwoNodes) -> None:
    before = two.launches()
    for nodes in (2, 1):
        words = [*two.words("study", f"study-{nodes}"), "--ranks", "2"]
        finish(two, words, f"study-{nodes}", nodes=nodes)
        assert nodes == 1 or min(launched(two, before)) > 0
    found, expected = ({point.key: point for point in two.points(f"study-{n}")} for n in (2, 1))
    assert len(two.points("study-2")) == len(found) == len(SIZES_MM)
    assert found == expected


def test_a_study_whose_node_fails_goes_on_without_a_lost_or_doubled_point(two: TwoNodes) -> None:
    finished = fail_node_under_study(two, "failed")
    points = two.points("failed")
    assert 0 < len(finished) < len(SIZES_MM)
    assert points[: len(finished)] == finished
    assert len({point.key for point in points}) == len(points) == len(SIZES_MM)
    finish(two, two.words("study", "alone"), "alone", nodes=1)
    found, alone = ({point.key: point for point in each} for each in (points, two.points("alone")))
    assert found == alone


def test_a_sweep_in_an_array_job_of_two_nodes_leaves_the_file_of_a_local_one(two: TwoNodes) -> None:
    words = [two.words("sweep", "")[0], "sweep", str(two.root / "swept.toml"), "line", "-o"]
    # of the environment the job takes what its script names
    passed = "--sbatch=--export=HOME,USER,LOGNAME,PATH,TMPDIR,OPENBLAS_CORETYPE"
    options = ["--on", "slurm", "--tasks", "1", "--ranks", "2", "--sbatch=--nodes=2", passed]
    before = two.launches()
    finish(two, [*words, str(two.root / "swept-2"), *options], "swept-2", nodes=1)
    assert min(launched(two, before)) > 0
    finish(two, [*words, str(two.root / "swept-1")], "swept-1", nodes=1)
    two_nodes, one = (two.root / name / "sweep.h5" for name in ("swept-2", "swept-1"))
    assert two_nodes.read_bytes() == one.read_bytes()


@pytest.mark.parametrize(
    "words",
    [
        "run scene.toml --no-figures -o {output}",
        "study scene.toml meshes -o {output}",
        "converge scene.toml --most-dofs 20000 -o {output}",
        "compare scene.toml --variants iron -o {output}",
        "effects scene.toml",
        "identify sprung.toml targets.toml -o {output}",
    ],
    ids=lambda words: words.split()[0],
)
def test_a_command_submitted_to_two_nodes_finds_what_one_process_finds(
    two: TwoNodes, words: str
) -> None:
    command = words.split()[0]
    (two.root / "sprung.toml").write_text(SPRUNG)
    (two.root / "targets.toml").write_text(TARGETS)
    options = ["--on", "slurm", "--ranks", "2", "--sbatch=--nodes=2"]
    before, found = two.launches(), []
    for name, more in (("job", options), ("here", [])):
        line = words.format(output=f"{command}-{name}").split()
        asked = [str(PROJECT / "headstock"), *line, "--json", f"{command}-{name}.json"]
        said = finish(two, [*asked, *more], f"{command}-{name}", nodes=1, folder=two.root)
        assert ("submitted" in said) == bool(more)
        found.append(read_found(two.root / f"{command}-{name}.json"))
        assert not more or launched(two, before) == [1, 1]
    job, here = found
    assert len(here) > 3
    assert job.keys() == here.keys()
    for place, number in here.items():
        share = ESTIMATE_EQUAL if any(word in place for word in ESTIMATES) else DEALT_EQUAL
        assert job[place] == approx(number, rel=share, abs=1e-12), place


def test_bad_input_on_two_nodes_ends_with_its_message_and_code(two: TwoNodes) -> None:
    words = [*two.words("study", "bad"), "--ranks", "2"]
    words[words.index("meshes")] = "nothing"
    done = two.run(words, nodes=2, store="store-bad")
    assert done.returncode == 2
    assert "nothing" in done.stderr
    assert "MPI_ABORT" not in done.stderr
