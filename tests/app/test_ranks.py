"""Several ranks give what one gives, and one failing rank ends them all."""

import json
import time
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from common import approx, run_alone, run_command, run_on_ranks
from fixture_machines import machine, write_scene
from headstock.pipeline import runner
from headstock.reduction.components import elastic
from headstock.solvers.errors import ConvergenceError

SCENE = machine("""
machine = "bar"
names = { bar = "column", clamp = "mount" }
name = "A column on springs"
components.column.solid = { box = ["50 mm", "50 mm", "200 mm"] }
components.column.mesh = { size = "25 mm" }
components.column.reduction = { modes = 6 }
joints.mount.kind = "spring"
joints.mount.stiffness = { x = "100 N/um", y = "100 N/um", z = "200 N/um", rx = "1 MN m/rad", ry = "1 MN m/rad", rz = "1 MN m/rad" }
analyses.static = { at = "tcp" }
analyses.modal = { count = 10 }
""")
FAILING_RANK = """
import sys
from mpi4py import MPI
from headstock.app.command_line import main
from headstock.reduction.components import elastic

whole = elastic.assemble_elasticity

def fail_on_one_rank(*arguments, **options):
    if MPI.COMM_WORLD.rank == 1:
        raise RuntimeError("the cosmic ray hit")
    return whole(*arguments, **options)

elastic.assemble_elasticity = fail_on_one_rank
sys.exit(main(sys.argv[1:]))
"""
# the analysis on rank 0, or the assembly on all ranks, does not converge
FAILING_STAGE = """
import sys
from headstock.app.command_line import main
from headstock.pipeline import runner
from headstock.reduction.components import elastic
from headstock.solvers.errors import ConvergenceError

def fail(*arguments, **options):
    raise ConvergenceError("nothing converged")

if sys.argv.pop(1) == "modal":
    runner.HANDLERS["modal"] = fail
else:
    elastic.assemble_elasticity = fail
sys.exit(main(sys.argv[1:]))
"""


def fail_to_converge(*_: object, **__: object) -> None:
    """As `FAILING_STAGE` fails."""
    raise ConvergenceError("nothing converged")


@pytest.fixture
def scene_file(tmp_path: Path) -> Path:
    path = write_scene(tmp_path, SCENE, name="column")
    return path


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """The summary of the column's run on one rank."""
    folder = tmp_path_factory.mktemp("alone")
    (folder / "column.toml").write_text(SCENE)
    words = ("run", str(folder / "column.toml"), "-o", str(folder / "out"), "--no-figures")
    done = run_alone(folder, *words)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("  modal ") == 1 and "PORD" not in done.stdout
    return json.loads((folder / "out" / "summary.json").read_text())


def test_what_is_wrong_with_a_scene_is_said_once_without_a_report_of_a_crash_and_ends_all_ranks_with_2(
    scene_file: Path, tmp_path: Path
) -> None:
    scene_file.write_text(
        SCENE.replace('material = "steel"', 'material = "stel"').replace("nu = 0.3", "nu = 0.7")
    )
    done = run_command(2, tmp_path, "run", str(scene_file), "-o", str(tmp_path / "out"))
    assert done.returncode == 2
    assert done.stderr.count("unknown material 'stel'") == 1
    assert done.stderr.count("materials.steel.nu") == 1
    assert "MPI_ABORT" not in done.stderr
    assert "prterun" not in done.stderr


@pytest.mark.parametrize("split_dofs", [pytest.param("1000000", marks=pytest.mark.trials), "0"])
@pytest.mark.parametrize("several", [2, pytest.param(4, marks=pytest.mark.trials)])
def test_frequencies_and_compliance_are_the_same_on_1_2_and_4_ranks(
    alone: Any,
    scene_file: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    several: int,
    split_dofs: str,
) -> None:
    monkeypatch.setenv("HEADSTOCK_SPLIT_DOFS", split_dofs)
    out, asked = tmp_path / "out", ("--ranks", str(several))
    words = ("run", str(scene_file), "-o", str(out), *asked, "--no-figures")
    result = run_command(several, tmp_path, *words)
    assert result.returncode == 0, result.stderr
    assert result.stdout.count("  modal ") == 1
    assert ("PORD" in result.stdout) == (split_dofs == "0")
    other = json.loads((out / "summary.json").read_text())
    assert not any(stage["cached"] for stage in other["stages"])
    assert other["modal"][0]["frequencies_hz"] == approx(
        alone["modal"][0]["frequencies_hz"], rel=1e-8
    )
    for row, reference in zip(
        other["static"]["tcp"]["compliance_6x6"],
        alone["static"]["tcp"]["compliance_6x6"],
        strict=True,
    ):
        assert row == approx(reference, rel=1e-8, abs=1e-8 * max(map(abs, reference)))


@pytest.mark.parametrize("failing", ["modal", pytest.param("assembly", marks=pytest.mark.trials)])
def test_what_fails_on_rank_0_or_on_all_ranks_is_said_once_without_a_report_of_a_crash(
    scene_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, failing: str
) -> None:
    monkeypatch.setenv("HEADSTOCK_SPLIT_DOFS", "0")
    if failing == "modal":
        monkeypatch.setitem(runner.HANDLERS, "modal", fail_to_converge)
    else:
        monkeypatch.setattr(elastic, "assemble_elasticity", fail_to_converge)
    words = ("run", str(scene_file), "-o", str(tmp_path / "out"), "--no-figures")
    said = []
    for done in (
        run_alone(tmp_path, *words),
        run_on_ranks(2, tmp_path, "-c", FAILING_STAGE, failing, *words),
    ):
        said.append(done.stderr)
        assert done.returncode == 1
        assert "MPI_ABORT" not in done.stderr
        assert done.stderr.count("nothing converged") == 1
    assert said[0].strip() in said[1]
    assert not (tmp_path / "out" / "results.h5").exists()


def test_one_failing_rank_ends_the_job_with_an_error_and_no_file(
    scene_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HEADSTOCK_SPLIT_DOFS", "0")
    start = time.monotonic()
    result = run_on_ranks(
        2, tmp_path, "-c", FAILING_RANK, "run", str(scene_file), "-o", str(tmp_path / "out")
    )
    assert time.monotonic() - start < 60.0
    assert result.returncode != 0
    assert "rank 1" in result.stderr and "cosmic ray" in result.stderr
    assert list((tmp_path / "out").iterdir()) == []


@pytest.mark.trials
def test_a_split_part_that_is_refused_ends_the_job_with_the_message_of_one_rank(
    scene_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HEADSTOCK_SPLIT_DOFS", "0")
    thin = SCENE.replace('["50 mm", "50 mm", "200 mm"]', '["1 mm", "50 mm", "200 mm"]')
    scene_file.write_text(thin.replace('size = "25 mm"', 'size = "10 mm", order = 1'))
    messages = []
    for ranks in (1, 2):
        words = ("run", str(scene_file), "-o", str(tmp_path / "out"), "--no-figures")
        done = run_command(ranks, tmp_path, *words)
        assert done.returncode == 1
        messages.append(done.stderr)
    assert messages[0].startswith("ModelError: component column: its elements are of order 1")
    assert messages[1] == messages[0]


TWO_BODIES = """
[components.arm]
solid = { box = ["150 mm", "40 mm", "40 mm"] }
at = ["0 mm", "0 mm", "300 mm"]
material = "steel"
mesh = { size = "22 mm" }
reduction = { modes = 5 }
[components.arm.interfaces]
root = { face = "x-" }
[joints.flange]
between = ["column.tip", "arm.root"]
kind = "rigid"
"""


def test_components_dealt_out_to_ranks_give_the_bytes_of_one_rank(
    scene_file: Path, tmp_path: Path
) -> None:
    scene_file.write_text(f"{SCENE}{TWO_BODIES}")
    files = {}
    for ranks in (1, 2):
        words = ("run", str(scene_file), "-o", str(tmp_path / f"{ranks}"), "--no-figures")
        done = run_command(ranks, tmp_path, *words)
        assert done.returncode == 0, done.stderr
        files[ranks] = _arrays(tmp_path / f"{ranks}" / "results.h5")
    assert len(files[1]) > 20
    assert files[1] == files[2]


def _arrays(path: Path) -> dict[str, bytes]:
    """Numbers in a file of results by name."""
    found: dict[str, bytes] = {}

    def keep(name: str, item: h5py.Dataset | h5py.Group) -> None:
        if isinstance(item, h5py.Dataset) and item.dtype.kind in "fi":
            found[name] = np.asarray(item[()]).tobytes()

    with h5py.File(path) as file:
        file.visititems(keep)
    return found


STUDY = """
[studies.sizes]
watch = ["modal.frequencies_hz[0]"]
[studies.sizes.families.all]
vary = { "components.column.mesh.size" = ["50 mm", "25 mm", "2 mm"], "components.column.reduction.modes" = [4, 6] }
[limits]
elements = 5000
"""


@pytest.mark.trials
def test_the_points_of_a_study_dealt_out_to_ranks_are_those_of_one_rank(
    scene_file: Path, tmp_path: Path
) -> None:
    scene_file.write_text(f"{SCENE}{STUDY}")  # the finest mesh is refused
    found = {}
    for ranks in (1, 2):
        words = ("study", str(scene_file), "sizes", "-o", str(tmp_path / f"{ranks}"))
        done = run_command(ranks, tmp_path, *words)
        assert done.returncode == 1, done.stderr
        lines = (tmp_path / f"{ranks}" / "points.jsonl").read_text().splitlines()
        found[ranks] = {str(record["varied"]): record for record in map(json.loads, lines)}
    assert len(found[1]) == 6
    assert {record["status"] for record in found[1].values()} == {"done", "failed"}
    for varied, expected in found[1].items():
        record = found[2][varied]
        assert (record["status"], record["error"]) == (expected["status"], expected["error"])
        found_hz, expected_hz = (
            [hz for modes in made["summary"].get("modal", []) for hz in modes["frequencies_hz"]]
            for made in (record, expected)
        )
        # the one of 4 modes may be cut from a stored one of 6, which rounds otherwise
        assert found_hz == approx(expected_hz, rel=1e-10)


@pytest.mark.trials
def test_a_component_that_fails_ends_all_ranks_with_the_message_of_one(
    scene_file: Path, tmp_path: Path
) -> None:
    arm = TWO_BODIES.replace('"22 mm"', '"60 mm", order = 1').replace('"40 mm"', '"2 mm"')
    scene_file.write_text(f"{SCENE}{arm}")
    said = []
    for ranks in (1, 2):
        words = ("run", str(scene_file), "-o", str(tmp_path / f"{ranks}"), "--no-figures")
        done = run_command(ranks, tmp_path, *words)
        assert done.returncode == 1
        said.append(done.stderr.split("\n")[0])
    assert "component arm" in said[0]
    assert said[1] == said[0]


def test_ranks_leave_a_model_without_an_answer_together(tmp_path: Path, scene_file: Path) -> None:
    mount = SCENE[SCENE.index('kind = "spring"') :]
    mount = mount[: mount.index("[")]
    scene_file.write_text(SCENE.replace(mount, 'kind = "rigid"\n\n'))
    change = ("--effort", "--change", "components.column.mesh.size=50 mm")
    done = run_command(
        2, tmp_path, "compare", str(scene_file), "-o", str(tmp_path / "two"), *change
    )
    assert done.returncode == 0, done.stdout + done.stderr
    summary = json.loads((tmp_path / "two" / "compare.json").read_text())
    assert "no dof is left" in summary["not_computed"]["rigid"]
    assert list(summary["effort"]["variants"]["elastic"]) == ["first", "changed"]


@pytest.mark.trials
def test_a_map_shared_out_over_ranks_is_that_of_one(tmp_path: Path) -> None:
    spans = 'sweeps.plane.axes={ X = ["-300 mm", "300 mm", 5], Y = ["-80 mm", "80 mm", 3], Z = ["200 mm", "240 mm", 3] }'
    scene = Path(__file__).resolve().parents[2] / "machines" / "tripteor.toml"
    found = []
    for ranks in (1, 3):
        folder = tmp_path / str(ranks)
        chosen = ("--analysis", "map", "--set", spans)
        done = run_command(
            ranks, tmp_path, "run", str(scene), *chosen, "--no-figures", "-o", str(folder)
        )
        assert done.returncode == 0, done.stdout + done.stderr
        found.append(json.loads((folder / "summary.json").read_text())["map"])
    assert found[0] == found[1] and len(found[0]["quantities"]["f1_hz"]) == 5


@pytest.mark.trials
def test_finer_and_finer_meshes_on_two_ranks_say_what_they_say_on_one(
    scene_file: Path, tmp_path: Path
) -> None:
    found = []
    for ranks in (1, 2):
        folder = tmp_path / f"converge{ranks}"
        words = ("converge", str(scene_file), "-o", str(folder), "--most-dofs", "9000")
        done = run_command(ranks, tmp_path, *words)
        assert done.returncode == 0, done.stdout + done.stderr
        found.append(json.loads((folder / "convergence.json").read_text()))
    one, two = found
    assert len(one["meshes"]) >= 2
    assert [mesh["dofs"] for mesh in one["meshes"]] == [mesh["dofs"] for mesh in two["meshes"]]
    for place in range(len(one["meshes"])):
        # a square column: of two equal frequencies either may be the first
        mine, other = (sorted(each["values"][place] for each in run["numbers"]) for run in found)
        assert mine == approx(other, rel=1e-8)
