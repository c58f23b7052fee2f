"""Array jobs: the script as it is written, what is missing by task, and what Slurm says of the
tasks.
"""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import headstock.studies.sweeps.slurm
from headstock.scene.studies import make_grid
from headstock.studies.sweeps.slurm import (
    FOLDER,
    ScriptValueError,
    SlurmError,
    SlurmJob,
    SlurmOptions,
    Submission,
    TaskState,
    describe_missing,
    list_missing_poses,
    log_file,
    read_submission,
    render_script,
    wait_for_array,
    write_submission,
)

SWEEP = make_grid("line", {"X": "m"}, {"X": np.linspace(-0.2, 0.2, 9, dtype=np.float64)})
SUBMISSION = Submission("key", "17", "16", 3, (1, 2, 3))
SCRIPT = """\
#!/bin/sh
# Sweep line in 3 array tasks, each with a journal of its own in poses/. Task 0 only
# reduces the components; it comes first. Written by `headstock sweep --on slurm`, which submits and collects.
#SBATCH --job-name=headstock-line
#SBATCH --array=1-3
#SBATCH --nodes=1
#SBATCH --ntasks=2
#SBATCH --cpus-per-task=1
#SBATCH --chdir="/data/mine"
#SBATCH --output="/data/100%% mine/slurm/%A_%a.log"
#SBATCH --open-mode=append
#SBATCH --requeue
#SBATCH --export=HOME,USER,LOGNAME,PATH
#SBATCH --partition=long
#SBATCH --time=0:30:00
#SBATCH --account=ours
export HEADSTOCK_STORE='/data/the store'
export HEADSTOCK_THREADS=1
exec /opt/headstock/headstock sweep /data/a.toml line -o '/data/100% mine' --set 'joints.drive.stiffness.axial="40 N/um"' --ranks 2 \
--key abc --part "$SLURM_ARRAY_TASK_ID/3"
"""


JOB = SlurmJob(
    launcher=("/opt/headstock/headstock",),
    words=("sweep", "/data/a.toml", "line", "-o", "/data/100% mine", "--set", 'joints.drive.stiffness.axial="40 N/um"'),
    folder=Path("/data/100% mine"),
    options=SlurmOptions(3, 2, "long", "0:30:00", ("--account=ours",)),
    start_folder=Path("/data/mine"),
    environment={"HEADSTOCK_STORE": "/data/the store"},
    sweep="line",
    key="abc",
)  # fmt: skip


def test_the_script_says_everything_a_task_needs() -> None:
    assert render_script(JOB) == SCRIPT


ROW = '/data/x"\n#SBATCH --wrap="touch /tmp/owned'
WRAP = "\n#SBATCH --wrap=id"


@pytest.mark.parametrize(
    "change",
    [
        {"folder": Path(ROW)},
        {"folder": Path('/data/x" --wrap="id')},
        {"folder": Path("/data/it's")},
        {"start_folder": Path(ROW)},
        {"start_folder": Path("/data/`id`")},
        {"words": ("sweep", "/data/a\n.toml")},
        {"launcher": ("/opt/a\x1b[2J/headstock",)},
        {"sweep": f"line{WRAP}"},
        {"key": "a\nb"},
        {"words": ("sweep", "/data/a.toml", "--set", "name=a\nb")},
        {"environment": {"HEADSTOCK_STORE": f"/data{WRAP}"}},
        {"options": SlurmOptions(partition=f"long{WRAP}")},
        {"options": SlurmOptions(partition='"long"')},
        {"options": SlurmOptions(time_limit="1:00\r#SBATCH --wrap=id")},
        {"options": SlurmOptions(extra=(f"--account=a{WRAP}",))},
        {"options": SlurmOptions(extra=("--account=a\u2028b",))},
    ],
    ids=lambda change: str(change)[:60],
)
def test_a_value_that_would_add_lines_to_the_script_is_refused_by_name(
    change: dict[str, Any],
) -> None:
    with pytest.raises(ScriptValueError, match="no place in"):
        render_script(dataclasses.replace(JOB, **change))


def test_every_missing_pose_belongs_to_the_task_that_computes_it() -> None:
    assert list_missing_poses(SWEEP, (), 3) == {1: [0, 3, 6], 2: [1, 4, 7], 3: [2, 5, 8]}
    done = {SWEEP.positions[number].tobytes() for number in (0, 1, 2, 3, 5, 6, 8)}
    assert list_missing_poses(SWEEP, done, 3) == {2: [4, 7]}
    assert list_missing_poses(SWEEP, done, 9) == {5: [4], 8: [7]}


def test_a_submission_is_found_again_for_the_same_sweep_only(tmp_path: Path) -> None:
    assert read_submission(tmp_path, "key") is None
    (tmp_path / FOLDER).mkdir()
    write_submission(tmp_path, SUBMISSION)
    assert read_submission(tmp_path, "key") == SUBMISSION
    assert read_submission(tmp_path, "other") is None


def wait(
    monkeypatch: pytest.MonkeyPatch, *answers: "dict[int, str] | SlurmError"
) -> tuple[dict[int, TaskState], list[str]]:
    """Wait while squeue gives these answers, one after the other."""
    left = list(answers)
    reported: list[str] = []

    def answer(_: str) -> dict[int, TaskState]:
        found = left.pop(0)
        if isinstance(found, SlurmError):
            raise found
        return {task: TaskState(*text.split(" ")) for task, text in found.items()}

    changes = {"read_states": answer, "SHORTEST_SECONDS": 0.0, "MOST_SILENCES": 2}
    for name, value in changes.items():
        monkeypatch.setattr(headstock.studies.sweeps.slurm, name, value)
    states = wait_for_array(SUBMISSION, reported.append)
    assert not left
    return states, reported


def test_waiting_ends_when_every_task_has(monkeypatch: pytest.MonkeyPatch) -> None:
    states, reported = wait(
        monkeypatch,
        {1: "PENDING Resources", 2: "PENDING Resources"},
        {1: "RUNNING None", 2: "PENDING Resources"},
        {1: "RUNNING None", 2: "PENDING Resources"},
        {1: "COMPLETED None", 2: "COMPLETED None"},
    )
    assert {state.state for state in states.values()} == {"COMPLETED"}
    assert reported == ["2 pending (Resources)", "1 pending (Resources), 1 running", "2 completed"]


SILENCE = SlurmError("squeue ended with 1: Unable to contact slurm controller")
RUNS, ENDS = {1: "RUNNING None"}, {1: "COMPLETED None"}


@pytest.mark.parametrize(
    ("answers", "state"),
    [
        ([{1: "NODE_FAIL None"}, {1: "PENDING BeginTime"}, RUNS, ENDS], "COMPLETED"),
        ([RUNS, {}, {}], "RUNNING"),
        ([RUNS, SILENCE, ENDS], "COMPLETED"),
    ],
    ids=["put back into the queue", "forgotten by Slurm", "a controller that restarts"],
)
def test_a_task_is_waited_for_until_it_has_ended(
    monkeypatch: pytest.MonkeyPatch, answers: list[dict[int, str] | SlurmError], state: str
) -> None:
    assert wait(monkeypatch, *answers)[0][1].state == state


def test_a_controller_that_is_gone_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(SlurmError, match=r"job 17 .*squeue ended with 1"):
        wait(monkeypatch, SILENCE, SILENCE, SILENCE)


def test_what_is_missing_is_told_with_state_and_log(tmp_path: Path) -> None:
    (tmp_path / FOLDER).mkdir()
    log_file(tmp_path, "17", 2).write_text("begun\nslurmstepd: error: CANCELLED\n\n")
    states = {1: TaskState("COMPLETED", ""), 2: TaskState("CANCELLED", "")}
    second, third, first = (log_file(tmp_path, *task) for task in (("17", 2), ("17", 3), ("16", 0)))
    missing = {2: [1, 4, 7], 3: [8]}
    assert describe_missing(tmp_path, SWEEP, SUBMISSION, missing, states).splitlines() == [
        "4 of 9 poses are not computed:",
        f"  task 2 (cancelled): X -150 mm; X 0 mm; X 150 mm; log {second}: slurmstepd: error: CANCELLED",
        f"  task 3 (forgotten by Slurm): X 200 mm; it left no log {third}",
        "finished poses are kept; the same command again submits only these tasks",
    ]
    second.unlink()
    first.write_text("ModelError: no mesh\n")
    reported = describe_missing(tmp_path, SWEEP, SUBMISSION, {2: [1]}, {})
    assert f"job 16 (components); log {first}: ModelError: no mesh" in reported
