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
from headstock.app.command_line import main
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


@pytest.fixture
def slurm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of the stand-ins, which are on PATH."""
    folder = tmp_path / "bin"
    write_stand_ins(folder)
    monkeypatch.setenv("PATH", f"{folder}:{os.environ['PATH']}")
    monkeypatch.setenv("HEADSTOCK_STORE", str(tmp_path / "store"))
    monkeypatch.delenv(HOST_VARIABLE, raising=False)
    # the stand-in computes before it answers
    monkeypatch.setattr(headstock.studies.sweeps.slurm, "TOOL_SECONDS", 900.0)
    return folder


def sweep(folder: Path, *words: str) -> int:
    return main(["sweep", str(SCENE), "line", "-o", str(folder), *words])


def test_tasks_together_give_the_local_file_and_a_lost_task_is_named_and_done_again(
    slurm: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (slurm / "bad").write_text("2")
    assert (
        sweep(tmp_path / "far", "--on", "slurm", "--tasks", "3", "--set", "analyses.modal.count=4")
        == 1
    )
    said = capfd.readouterr()
    assert "submitted" in said.out and "3 tasks" in said.out
    assert "3 of 9 poses are not computed" in said.err
    assert "task 2 (cancelled): X -150 mm; X 0 mm; X 150 mm; it left no log" in said.err
    assert not (tmp_path / "far" / "sweep.h5").exists()
    (slurm / "bad").unlink()
    assert (
        sweep(tmp_path / "far", "--on", "slurm", "--tasks", "3", "--set", "analyses.modal.count=4")
        == 0
    )
    # no part is elastic, so no job goes before the array to reduce it
    assert (slurm / "calls").read_text() == "--parsable --array=1,2,3\n--parsable --array=2\n"
    said = capfd.readouterr()
    assert "1 task (2)" in said.out and "9 finished poses collected" in said.out
    assert sweep(tmp_path / "here", "--set", "analyses.modal.count=4") == 0
    for name in ("sweep.h5", "sweep.json"):
        assert (tmp_path / "far" / name).read_bytes() == (tmp_path / "here" / name).read_bytes()


def test_a_folder_whose_name_would_add_lines_to_the_script_is_refused(
    slurm: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / 'x"\n#SBATCH --wrap="touch owned'
    assert sweep(folder, "--on", "slurm") == 2
    assert "the folder of results" in capfd.readouterr().err
    assert not (slurm / "calls").exists()
    assert not (folder / SCRIPT_FILE).exists()


def test_an_array_that_is_still_in_the_queue_is_not_submitted_again(
    slurm: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (slurm / "bad").write_text("later")
    words = ("--on", "slurm", "--tasks", "2", "--no-wait")
    assert sweep(tmp_path / "far", *words) == 0
    calls = (slurm / "calls").read_text()
    assert "scancel" in capfd.readouterr().out
    assert sweep(tmp_path / "far", *words) == 0
    assert "still at it" in capfd.readouterr().out
    assert (slurm / "calls").read_text() == calls
    for path in slurm.glob("states-*"):
        path.write_text(path.read_text().replace("PENDING", "CANCELLED"))
    assert sweep(tmp_path / "far", *words) == 0
    assert (slurm / "calls").read_text() != calls


def test_elastic_parts_are_reduced_by_a_job_that_has_to_succeed_first(
    slurm: Path, tmp_path: Path
) -> None:
    (slurm / "bad").write_text("later")
    machine = str(ROOT / "machines" / "three_axis.toml")
    options = ["-o", str(tmp_path / "far"), "--on", "slurm", "--tasks", "2", "--no-wait"]
    assert main(["sweep", machine, "workspace", *options]) == 0
    first, second = (slurm / "calls").read_text().splitlines()
    assert first == "--parsable --array=0"
    assert second == "--parsable --array=1,2 --dependency=afterok:1 --kill-on-invalid-dep=yes"


def test_a_plain_sweep_computes_what_the_array_did_not(slurm: Path, tmp_path: Path) -> None:
    (slurm / "bad").write_text("later")
    assert sweep(tmp_path / "far", "--on", "slurm", "--no-wait") == 0
    assert sweep(tmp_path / "far") == 0
    calls = (slurm / "calls").read_text()
    assert sweep(tmp_path / "far", "--on", "slurm") == 0
    assert (slurm / "calls").read_text() == calls


def test_without_slurm_on_path_the_remedy_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv(HOST_VARIABLE, raising=False)
    assert sweep(tmp_path / "far", "--on", "slurm") == 2
    assert "no sbatch on PATH" in capfd.readouterr().err
    assert not (tmp_path / "far").exists()


def test_bad_scenes_and_options_are_refused_before_anything_is_submitted(
    slurm: Path, tmp_path: Path
) -> None:
    for words in (
        ("--on", "moon"),
        ("--on", "slurm", "--set", 'sweeps.line.axes={ X = ["-900 mm", "200 mm", 9] }'),
        ("--on", "slurm", "--tasks", "0"),
        ("--partition", "long"),
        ("--part", "4/3"),
    ):
        assert sweep(tmp_path / "far", *words) == 2
    assert not (slurm / "calls").exists()
    assert not (tmp_path / "far").exists()


def test_what_sbatch_complains_of_is_told(
    slurm: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (slurm / "refusal").write_text("sbatch: error: invalid partition specified: gone")
    assert sweep(tmp_path / "far", "--on", "slurm", "--partition", "gone") == 1
    assert "specified: gone; --partition" in capfd.readouterr().err
    assert "#SBATCH --partition=gone\n" in (tmp_path / "far" / SCRIPT_FILE).read_text()


def test_a_task_whose_scene_or_program_is_another_computes_nothing(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert sweep(tmp_path / "far", "--part", "1/3", "--key", "0123") == 1
    assert "have changed since the job was submitted" in capfd.readouterr().err
    assert not (tmp_path / "far" / "poses").exists()


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
    slurm: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    host, answers = start_host(tmp_path)
    monkeypatch.setenv(HOST_VARIABLE, str(answers))
    monkeypatch.setenv("PATH", str(tmp_path / "empty"))
    require_slurm()
    script = tmp_path / "far away" / SCRIPT_FILE
    (script.parent / FOLDER).mkdir(parents=True)
    script.write_text('echo "task $SLURM_ARRAY_TASK_ID"\n')
    job = submit(script, [2, 1], after="7")
    assert (
        "--array=1,2 --dependency=afterok:7 --kill-on-invalid-dep=yes"
        in (slurm / "calls").read_text()
    )
    assert {task: state.state for task, state in read_states(job).items()} == {
        1: "COMPLETED",
        2: "COMPLETED",
    }
    assert read_states("99") == {}
    (slurm / "refusal").write_text("sbatch: error: no")
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
def test_another_command_is_one_job_whose_output_and_exit_code_come_back(
    slurm: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    words = ["run", str(SCENE), "--analysis", "static", "--no-figures", "-o", "far"]
    assert main([*words, "--on", "slurm", "--ranks=2", "--no-wait"]) == 0
    assert "scancel" in capfd.readouterr().out
    calls = (slurm / "calls").read_text()
    assert main([*words, "--on=slurm", "--ranks", "2"]) == 0
    assert (slurm / "calls").read_text() == calls
    said = capfd.readouterr().out
    assert "2 ranks" in said and "results in far" in said
    assert (tmp_path / "far" / "summary.json").is_file()
    (script,) = (tmp_path / "results" / "slurm").glob("run-*/*.sbatch")
    assert "#SBATCH --ntasks=2\n" in script.read_text()
    # what fails says so here, too, and a job that was shown is forgotten
    bad = ["run", str(SCENE), "--set", "materials.x.nu=2", "--on", "slurm"]
    assert main(bad) == 2
    assert "materials.x" in capfd.readouterr().out
    (slurm / "bad").write_text("1")
    assert main(bad) == 1
    assert "ended without an exit code (1 cancelled)" in capfd.readouterr().err


def test_options_of_a_cluster_without_one_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["compare", str(SCENE), "--partition", "long"]) == 2
    assert "go with --on slurm" in capsys.readouterr().err
