"""Several ranks give what one gives, and one failing rank ends them all."""

import json
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from common import Done, approx, read_datasets, read_json, run_alone, run_command, run_on_ranks
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


# runs command lines one after the other, each with a store of its own; the assembly on all ranks or,
# in the last one, the analysis on rank 0 may not converge
SEVERAL = """
import contextlib, json, os, sys
from mpi4py import MPI
from headstock.app.command_line import main
from headstock.app.terminal.guard import hand_over
from headstock.pipeline import runner
from headstock.pipeline.stages import shared_components
from headstock.reduction.components import elastic
from headstock.solvers.errors import ConvergenceError

def fail(*arguments, **options):
    raise ConvergenceError("nothing converged")

*lines, (last, words, split) = json.loads(sys.argv[1])
for name, line, dofs in lines:
    shared_components.SPLIT_DOFS, os.environ["HEADSTOCK_STORE"] = dofs, f"store_{name}"
    with (
        open(f"{name}.{MPI.COMM_WORLD.rank}", "w") as said,
        contextlib.redirect_stdout(said),
        contextlib.redirect_stderr(said),
    ):
        code = main(line)
        print("code", code)
shared_components.SPLIT_DOFS = split
if last == "modal":
    runner.HANDLERS["modal"] = fail
elif last == "assembly":
    elastic.assemble_elasticity = fail
sys.exit(hand_over(main(words)))
"""
WHOLE = 1_000_000
RUN = "run {0}.toml -o {0} --no-figures"


def fail_to_converge(*_: object, **__: object) -> None:
    """As `SEVERAL` fails."""
    raise ConvergenceError("nothing converged")


def run_several(
    ranks: int, folder: Path, *lines: tuple[str, str, int], last: str = "", code: int = 0
) -> Done:
    """One start of MPI for several command lines, of which the last one ends it."""
    words = [(name, line.format(name).split(), split) for name, line, split in lines]
    words.append((last, RUN.format("column").split(), 0))
    done = run_on_ranks(ranks, folder, "-c", SEVERAL, json.dumps(words))
    assert done.returncode == code, done.stderr
    assert "MPI_ABORT" not in done.stderr and "prterun" not in done.stderr
    return done


def on_both(folder: Path, line: str, *words: str, code: int = 0) -> list[Done]:
    """A command on one rank, and on two."""
    found = []
    for ranks in (1, 2):
        done = run_command(ranks, folder, *line.format(ranks).split(), *words)
        assert done.returncode == code, done.stdout + done.stderr
        found.append(done)
    return found


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder, with the column."""
    monkeypatch.chdir(tmp_path)
    write_scene(tmp_path, SCENE, name="column")
    return tmp_path


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of the column, and of two bodies, on one rank."""
    folder = tmp_path_factory.mktemp("alone")
    for name, text in (("column", SCENE), ("two", SCENE + TWO_BODIES)):
        scene = write_scene(folder, text, name=name)
        done = run_alone(folder, *RUN.format(folder / name).split())
        assert done.returncode == 0, f"{scene}: {done.stderr}"
        assert done.stdout.count("  modal ") == 1 and "PORD" not in done.stdout
    return folder


@pytest.fixture(scope="module")
def together(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What several commands left and said on two ranks."""
    folder = tmp_path_factory.mktemp("together")
    mount = SCENE[SCENE.index('kind = "spring"') :]
    mount = mount[: mount.index("[")]
    write_scene(folder, SCENE, name="column")
    write_scene(folder, SCENE + TWO_BODIES, name="two")
    write_scene(folder, SCENE, (mount, 'kind = "rigid"\n\n'), name="rigid")
    wrong = ('material = "steel"', 'material = "stel"'), ("nu = 0.3", "nu = 0.7")
    write_scene(folder, SCENE, *wrong, name="bad")
    change = "--effort --change components.column.mesh.size=50mm"
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        done = run_several(
            2,
            folder,
            ("bad", RUN, WHOLE),
            ("split", "run column.toml -o split --ranks 2 --no-figures", 0),
            ("two", RUN, WHOLE),
            ("rigid", f"compare {{0}}.toml -o {{0}} {change}", WHOLE),
            last="modal",
            code=1,
        )
    (folder / "modal.0").write_text(done.stderr)
    return folder


def said(folder: Path, name: str, code: int = 0) -> str:
    """What a command printed on rank 0; the other one says nothing but its code."""
    text, other = ((folder / f"{name}.{rank}").read_text() for rank in (0, 1))
    assert text.endswith(f"code {code}\n") and other == f"code {code}\n"
    return text


def require_same(found: Any, expected: Any) -> None:
    """The frequencies and compliances of another run."""
    one, other = (each["modal"][0]["frequencies_hz"] for each in (found, expected))
    assert one == approx(other, rel=1e-8)
    rows = [each["static"]["tcp"]["compliance_6x6"] for each in (found, expected)]
    assert len(rows[1]) == 6
    for row, reference in zip(*rows, strict=True):
        assert row == approx(reference, rel=1e-8, abs=1e-8 * max(map(abs, reference)))


def test_what_is_wrong_with_a_scene_is_said_once_and_ends_all_ranks_with_2(together: Path) -> None:
    text = said(together, "bad", 2)
    assert text.count("unknown material 'stel'") == text.count("materials.steel.nu") == 1


def test_a_part_that_is_split_is_that_of_one_rank(alone: Path, together: Path) -> None:
    text, found = said(together, "split"), read_json(together / "split" / "summary.json")
    assert text.count("  modal ") == 1 and "PORD" in text
    assert found["stages"] and not any(stage["cached"] for stage in found["stages"])
    require_same(found, read_json(alone / "column" / "summary.json"))


@pytest.mark.trials
@pytest.mark.parametrize(("ranks", "split"), [(2, WHOLE), (4, WHOLE), (4, 0)])
def test_frequencies_and_compliance_are_the_same_on_2_and_4_ranks(
    alone: Path, folder: Path, ranks: int, split: int
) -> None:
    run_several(ranks, folder, ("column", f"{RUN} --ranks {ranks}", split))
    assert ("PORD" in (folder / "column.0").read_text()) == (split == 0)
    found, expected = (read_json(each / "column" / "summary.json") for each in (folder, alone))
    require_same(found, expected)


@pytest.mark.parametrize("failing", ["modal", pytest.param("assembly", marks=pytest.mark.trials)])
def test_what_fails_on_rank_0_or_on_all_ranks_is_said_once_without_a_report_of_a_crash(
    folder: Path, together: Path, monkeypatch: pytest.MonkeyPatch, failing: str
) -> None:
    if failing == "modal":
        monkeypatch.setitem(runner.HANDLERS, "modal", fail_to_converge)
        other = (together / "modal.0").read_text()
    else:
        other = run_several(2, folder, last="assembly", code=1).stderr
        monkeypatch.setattr(elastic, "assemble_elasticity", fail_to_converge)
    done = run_alone(folder, *RUN.format("column").split())
    assert done.returncode == 1
    assert done.stderr.count("nothing converged") == other.count("nothing converged") == 1
    assert done.stderr.strip() in other
    for where in (folder, together):
        assert not (where / "column" / "results.h5").exists()


def test_one_failing_rank_ends_the_job_with_an_error_and_no_file(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HEADSTOCK_SPLIT_DOFS", "0")
    start = time.monotonic()
    done = run_on_ranks(2, folder, "-c", FAILING_RANK, *RUN.format("column").split())
    assert time.monotonic() - start < 60.0
    assert done.returncode != 0
    assert "rank 1" in done.stderr and "cosmic ray" in done.stderr
    assert list((folder / "column").iterdir()) == []


@pytest.mark.trials
def test_a_split_part_that_is_refused_ends_the_job_with_the_message_of_one_rank(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HEADSTOCK_SPLIT_DOFS", "0")
    thin = SCENE.replace('["50 mm", "50 mm", "200 mm"]', '["1 mm", "50 mm", "200 mm"]')
    write_scene(folder, thin, ('size = "25 mm"', 'size = "10 mm", order = 1'))
    one, two = on_both(folder, "run scene.toml -o {0} --no-figures", code=1)
    assert one.stderr.startswith("ModelError: component column: its elements are of order 1")
    assert two.stderr == one.stderr


def read_arrays(path: Path) -> dict[str, bytes]:
    """Numbers in a file of results by name."""
    found = read_datasets(path, lambda item: np.asarray(item[()]))
    return {name: array.tobytes() for name, array in found.items() if array.dtype.kind in "fi"}


def test_components_dealt_out_to_ranks_give_the_bytes_of_one_rank(
    alone: Path, together: Path
) -> None:
    said(together, "two")
    one, two = (read_arrays(folder / "two" / "results.h5") for folder in (alone, together))
    assert len(one) > 20
    assert one == two


STUDY = """
[studies.sizes]
watch = ["modal.frequencies_hz[0]"]
[studies.sizes.families.all]
vary = { "components.column.mesh.size" = ["50 mm", "25 mm", "2 mm"], "components.column.reduction.modes" = [4, 6] }
[limits]
elements = 5000
"""


@pytest.mark.trials
def test_the_points_of_a_study_dealt_out_to_ranks_are_those_of_one_rank(folder: Path) -> None:
    write_scene(folder, SCENE + STUDY)  # the finest mesh is refused
    on_both(folder, "study scene.toml sizes -o {0}", code=1)
    found = []
    for ranks in (1, 2):
        records = map(json.loads, (folder / f"{ranks}" / "points.jsonl").read_text().splitlines())
        found.append({str(record["varied"]): record for record in records})
    one, two = found
    assert len(one) == 6
    assert {record["status"] for record in one.values()} == {"done", "failed"}
    for varied, expected in one.items():
        record = two[varied]
        assert (record["status"], record["error"]) == (expected["status"], expected["error"])
        found_hz, expected_hz = (
            [hz for modes in made["summary"].get("modal", []) for hz in modes["frequencies_hz"]]
            for made in (record, expected)
        )
        # the one of 4 modes may be cut from a stored one of 6, which rounds otherwise
        assert found_hz == approx(expected_hz, rel=1e-10)


SENSED = """
[sensors]
a = { component = "column", at = ["25 mm", "0 mm", "60 mm"] }
b = { component = "column", at = ["25 mm", "10 mm", "120 mm"] }
c = { component = "column", at = ["-25 mm", "0 mm", "200 mm"] }
d = { component = "column", at = ["0 mm", "25 mm", "170 mm"] }
"""


@pytest.mark.trials
def test_a_test_is_compared_on_two_ranks_as_on_one(folder: Path) -> None:
    write_scene(folder, SCENE + SENSED)
    assert (
        run_command(1, folder, "export", "scene.toml", "--to", "uff", "-o", "test.uff").returncode
        == 0
    )
    on_both(folder, "correlate scene.toml test.uff -o {0}")
    one, two = (read_json(folder / f"{ranks}" / "correlate.json")["modes"] for ranks in (1, 2))
    assert len(one) >= 6
    for row, expected in zip(two, one, strict=True):
        assert row["mac"] == approx(expected["mac"], rel=1e-8)
        assert row["deviation"] == approx(expected["deviation"], abs=1e-9)


@pytest.mark.trials
def test_a_component_that_fails_ends_all_ranks_with_the_message_of_one(folder: Path) -> None:
    thin = ('"22 mm"', '"60 mm", order = 1'), ('"40 mm"', '"2 mm"')
    write_scene(folder, SCENE + TWO_BODIES, *thin)
    one, two = on_both(folder, "run scene.toml -o {0} --no-figures", code=1)
    assert "component arm" in one.stderr.split("\n")[0]
    assert two.stderr.split("\n")[0] == one.stderr.split("\n")[0]


def test_ranks_leave_a_model_without_an_answer_together(together: Path) -> None:
    said(together, "rigid")
    summary = read_json(together / "rigid" / "compare.json")
    assert "no dof is left" in summary["not_computed"]["rigid"]
    assert list(summary["effort"]["variants"]["elastic"]) == ["first", "changed"]


@pytest.mark.trials
def test_a_map_shared_out_over_ranks_is_that_of_one(folder: Path) -> None:
    spans = 'sweeps.plane.axes={ X = ["-300 mm", "300 mm", 5], Y = ["-80 mm", "80 mm", 3], Z = ["200 mm", "240 mm", 3] }'
    scene = Path(__file__).resolve().parents[2] / "machines" / "tripteor.toml"
    found = []
    for ranks in (1, 3):
        line = f"run {scene} --analysis map --no-figures -o {ranks} --set"
        done = run_command(ranks, folder, *line.split(), spans)
        assert done.returncode == 0, done.stdout + done.stderr
        found.append(read_json(folder / str(ranks) / "summary.json")["map"])
    assert found[0] == found[1] and len(found[0]["quantities"]["f1_hz"]) == 5


@pytest.mark.trials
def test_finer_and_finer_meshes_on_two_ranks_say_what_they_say_on_one(folder: Path) -> None:
    on_both(folder, "converge column.toml -o {0} --most-dofs 9000")
    found = [read_json(folder / str(ranks) / "convergence.json") for ranks in (1, 2)]
    one, two = ([mesh["dofs"] for mesh in each["meshes"]] for each in found)
    assert len(one) >= 2 and one == two
    for place in range(len(one)):
        # a square column: of two equal frequencies either may be the first
        mine, other = (sorted(each["values"][place] for each in run["numbers"]) for run in found)
        assert mine == approx(other, rel=1e-8)
