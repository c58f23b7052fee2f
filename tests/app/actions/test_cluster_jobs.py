"""``--on slurm`` with stand-ins for Slurm's programs: the file of a local sweep comes out,
faults are named.
"""

import os
import subprocess
import time
from pathlib import Path

import pytest
from slurm_stand_ins import write_stand_ins

import headstock.studies.sweeps.slurm
from common import Shell
from headstock.studies.sweeps.slurm import (
    FOLDER,
    HOST_VARIABLE,
    SCRIPT_FILE,
    SlurmError,
    read_states,
    require_slurm,
    submit,
)

ROOT = Path(__file__).resolve().parent.parent.parent.parent
SCENE = ROOT / "tests" / "data" / "slide.toml"
SWEEP = f"sweep {SCENE} line -o far"


class Cluster(Shell):
    """Commands beside stand-ins for Slurm's programs, which are on PATH in ``bin``."""

    def calls(self) -> list[str]:
        """Words with which `sbatch` was called."""
        path = self.folder / "bin" / "calls"
        return path.read_text().splitlines() if path.exists() else []

    def tell(self, name: str, words: str) -> None:
        """What a stand-in is to do."""
        (self.folder / "bin" / name).write_text(words)


@pytest.fixture
def slurm(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> Cluster:
    write_stand_ins(tmp_path / "bin")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}:{os.environ['PATH']}")
    monkeypatch.setenv("HEADSTOCK_STORE", str(tmp_path / "store"))
    monkeypatch.delenv(HOST_VARIABLE, raising=False)
    # the stand-in computes before it answers
    monkeypatch.setattr(headstock.studies.sweeps.slurm, "TOOL_SECONDS", 900.0)
    return Cluster(tmp_path, capfd)


def test_tasks_together_give_the_local_file_and_a_lost_task_is_named_and_done_again(
    slurm: Cluster,
) -> None:
    few = "--set analyses.modal.count=4"
    slurm.tell("bad", "2")
    said = slurm(f"{SWEEP} --on slurm --tasks 3 {few}", code=1)
    assert "submitted" in said.out and "3 tasks" in said.out
    assert "3 of 9 poses are not computed" in said.err
    assert "task 2 (cancelled): X -150 mm; X 0 mm; X 150 mm; it left no log" in said.err
    assert "sweep.h5" not in slurm.files("far")
    slurm.tell("bad", "")
    said = slurm(f"{SWEEP} --on slurm --tasks 3 {few}")
    # no part is elastic, so no job goes before the array to reduce it
    assert slurm.calls() == ["--parsable --array=1,2,3", "--parsable --array=2"]
    assert "1 task (2)" in said.out and "9 finished poses collected" in said.out
    slurm(f"sweep {SCENE} line -o here {few}")
    for name in ("sweep.h5", "sweep.json"):
        far, here = ((slurm.folder / place / name).read_bytes() for place in ("far", "here"))
        assert far == here


def test_a_folder_whose_name_would_add_lines_to_the_script_is_refused(slurm: Cluster) -> None:
    folder = slurm.folder / 'x"\n#SBATCH --wrap="touch owned'
    said = slurm(f"sweep {SCENE} line --on slurm -o", folder, code=2)
    assert "the folder of results" in said.err
    assert slurm.calls() == [] and not (folder / SCRIPT_FILE).exists()


def test_an_array_that_is_still_in_the_queue_is_not_submitted_again(slurm: Cluster) -> None:
    line = f"{SWEEP} --on slurm --tasks 2 --no-wait"
    slurm.tell("bad", "later")
    assert "scancel" in slurm(line).out
    calls = slurm.calls()
    assert "still at it" in slurm(line).out
    assert slurm.calls() == calls
    for path in (slurm.folder / "bin").glob("states-*"):
        path.write_text(path.read_text().replace("PENDING", "CANCELLED"))
    slurm(line)
    assert slurm.calls() != calls


def test_elastic_parts_are_reduced_by_a_job_that_has_to_succeed_first(slurm: Cluster) -> None:
    slurm.tell("bad", "later")
    scene = ROOT / "machines" / "three_axis.toml"
    slurm(f"sweep {scene} workspace -o far --on slurm --tasks 2 --no-wait")
    assert slurm.calls() == [
        "--parsable --array=0",
        "--parsable --array=1,2 --dependency=afterok:1 --kill-on-invalid-dep=yes",
    ]


def test_a_plain_sweep_computes_what_the_array_did_not(slurm: Cluster) -> None:
    slurm.tell("bad", "later")
    slurm(f"{SWEEP} --on slurm --no-wait")
    slurm(SWEEP)
    calls = slurm.calls()
    slurm(f"{SWEEP} --on slurm")
    assert slurm.calls() == calls


def test_without_slurm_on_path_the_remedy_is_told(
    slurm: Cluster, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(slurm.folder))
    assert "no sbatch on PATH" in slurm(f"{SWEEP} --on slurm", code=2).err
    assert "far" not in slurm.files()


@pytest.mark.parametrize(
    "options",
    [
        "--on moon",
        """--on slurm --set 'sweeps.line.axes={ X = ["-900 mm", "200 mm", 9] }'""",
        "--on slurm --tasks 0",
        "--partition long",
        "--part 4/3",
    ],
)
def test_bad_scenes_and_options_are_refused_before_anything_is_submitted(
    slurm: Cluster, options: str
) -> None:
    assert slurm(f"{SWEEP} {options}", code=2).err
    assert slurm.calls() == [] and "far" not in slurm.files()


def test_what_sbatch_complains_of_is_told(slurm: Cluster) -> None:
    slurm.tell("refusal", "sbatch: error: invalid partition specified: gone")
    said = slurm(f"{SWEEP} --on slurm --partition gone", code=1)
    assert "specified: gone; --partition" in said.err
    assert "#SBATCH --partition=gone\n" in slurm.text(f"far/{SCRIPT_FILE}")


def test_a_task_whose_scene_or_program_is_another_computes_nothing(slurm: Cluster) -> None:
    said = slurm(f"{SWEEP} --part 1/3 --key 0123", code=1)
    assert "have changed since the job was submitted" in said.err
    assert not (slurm.folder / "far" / "poses").exists()


def start_host(tmp_path: Path) -> tuple["subprocess.Popen[str]", Path]:
    """A shell that stays outside of a private root, and the folder in which it takes requests."""
    shell = f'. "{ROOT}/environment/host_commands.sh"; start_host_commands; echo "$HEADSTOCK_HOST_COMMANDS"; read -r end'
    host = subprocess.Popen(
        ["sh", "-c", shell],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "TMPDIR": str(tmp_path)},
    )
    assert host.stdout is not None
    return host, Path(host.stdout.readline().strip())


def test_programs_that_are_only_on_the_host_are_called_through_the_launcher(
    slurm: Cluster, monkeypatch: pytest.MonkeyPatch
) -> None:
    host, answers = start_host(slurm.folder)
    monkeypatch.setenv(HOST_VARIABLE, str(answers))
    monkeypatch.setenv("PATH", str(slurm.folder / "empty"))
    require_slurm()
    script = slurm.folder / "far away" / SCRIPT_FILE
    (script.parent / FOLDER).mkdir(parents=True)
    script.write_text('echo "task $SLURM_ARRAY_TASK_ID"\n')
    job = submit(script, [2, 1], after="7")
    (call,) = slurm.calls()
    assert call.endswith("--array=1,2 --dependency=afterok:7 --kill-on-invalid-dep=yes")
    states = [state.state for state in read_states(job).values()]
    assert states == ["COMPLETED", "COMPLETED"]
    assert read_states("99") == {}
    slurm.tell("refusal", "sbatch: error: no")
    with pytest.raises(SlurmError, match="sbatch: error: no"):
        submit(script, [1])
    host.communicate("\n", timeout=20)
    assert not answers.exists()


def test_a_launcher_killed_outside_leaves_neither_process_nor_folder(tmp_path: Path) -> None:
    host, answers = start_host(tmp_path)
    assert answers.is_dir()
    host.kill()
    host.communicate(timeout=20)
    end = time.monotonic() + 20.0
    while answers.exists():
        assert time.monotonic() < end
        time.sleep(0.01)


@pytest.mark.trials
def test_another_command_is_one_job_whose_output_and_exit_code_come_back(slurm: Cluster) -> None:
    line = f"run {SCENE} --analysis static --no-figures -o far"
    assert "scancel" in slurm(f"{line} --on slurm --ranks=2 --no-wait").out
    calls = slurm.calls()
    said = slurm(f"{line} --on=slurm --ranks 2").out
    assert slurm.calls() == calls
    assert "2 ranks" in said and "results in far" in said
    assert "summary.json" in slurm.files("far")
    (script,) = (slurm.folder / "results" / "slurm").glob("run-*/*.sbatch")
    assert "#SBATCH --ntasks=2\n" in script.read_text()
    # what fails says so here, too, and a job that was shown is forgotten
    bad = f"run {SCENE} --set materials.x.nu=2 --on slurm"
    assert "materials.x" in slurm(bad, code=2).out
    slurm.tell("bad", "1")
    assert "ended without an exit code (1 cancelled)" in slurm(bad, code=1).err


def test_options_of_a_cluster_without_one_are_refused(slurm: Cluster) -> None:
    said = slurm(f"compare {SCENE} --partition long", code=2).err
    assert "go with --on slurm" in said
