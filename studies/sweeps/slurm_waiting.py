"""Waiting for an array job, and what became of its tasks."""

import time
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path

from headstock.scene.sweep_poses import Sweep, describe_positions
from headstock.studies.sweeps.slurm_jobs import COMPONENTS_TASK, Submission, log_file
from headstock.studies.sweeps.slurm_tools import SlurmError, TaskState, read_states

GOOD_END = "COMPLETED"
# a task that was put back into the queue shows one of the others for a moment
ENDS = (
    GOOD_END, "FAILED", "CANCELLED", "TIMEOUT", "OUT_OF_MEMORY", "NODE_FAIL", "BOOT_FAIL", "DEADLINE", "PREEMPTED", "REVOKED",
)  # fmt: skip
SHORTEST_SECONDS, LONGEST_SECONDS, GROWTH = 1.0, 15.0, 0.05
MOST_SILENCES = 20
POSES_NAMED = 3
LAST_LETTERS = 300


def is_waiting(states: Mapping[int, TaskState]) -> bool:
    """Whether a task is in the queue or runs."""
    return any(state.state not in ENDS for state in states.values())


def wait_for_array(submission: Submission, on_change: Callable[[str], None]) -> dict[int, TaskState]:
    """Wait until no task is in the queue or runs.

    Args:
        submission: The array job.
        on_change: Told how many tasks are in which state, whenever that changes.

    Returns:
        The last state seen of each task.

    Raises:
        SlurmError: Slurm has not answered for minutes.
    """
    begin, silences, told, ended = time.monotonic(), 0, "", False
    last: dict[int, TaskState] = {}
    while True:
        try:
            states = read_states(submission.job)
            silences = 0
        except SlurmError as error:
            silences += 1
            if silences > MOST_SILENCES:
                raise SlurmError(
                    f"job {submission.job} can no longer be watched: {error}; the same command again goes on"
                ) from error
            states = last
        last |= states
        if states and (text := describe_states(last)) != told:
            told = text
            on_change(text)
        if not is_waiting(states) and not silences:
            # seen twice, because a task that goes back into the queue may look ended in between
            if ended or all(state.state == GOOD_END for state in last.values()):
                return last
            ended = True
        else:
            ended = False
        time.sleep(min(LONGEST_SECONDS, SHORTEST_SECONDS + GROWTH * (time.monotonic() - begin)))


def describe_states(states: Mapping[int, TaskState]) -> str:
    """How many tasks are in which state, and why some wait."""
    counts = Counter(_describe_state(state) for state in states.values())
    return ", ".join(f"{count} {text}" for text, count in sorted(counts.items()))


def describe_missing(
    folder: Path, sweep: Sweep, submission: Submission, missing: Mapping[int, list[int]], states: Mapping[int, TaskState]
) -> str:
    """Which tasks lack which poses, how they ended and where they wrote why."""
    lines = [f"{sum(len(poses) for poses in missing.values())} of {len(sweep.positions)} poses are not computed:"]
    if submission.components_job:
        log = log_file(folder, submission.components_job, COMPONENTS_TASK)
        if submission.components_job and not any(log_file(folder, submission.job, task).exists() for task in missing):
            lines.append(f"  job {submission.components_job} (components){_describe_log(log)}")
    for task, poses in missing.items():
        state = states[task].state.lower() if task in states else "forgotten by Slurm"
        named = "; ".join(describe_positions(sweep, number) for number in poses[:POSES_NAMED])
        more = f" and {len(poses) - POSES_NAMED} more" if len(poses) > POSES_NAMED else ""
        lines.append(f"  task {task} ({state}): {named}{more}{_describe_log(log_file(folder, submission.job, task))}")
    lines.append("finished poses are kept; the same command again submits only these tasks")
    return "\n".join(lines)


def _describe_state(state: TaskState) -> str:
    waits = state.state == "PENDING" and state.reason not in ("", "None")
    return f"{state.state.lower()} ({state.reason})" if waits else state.state.lower()


def _describe_log(log: Path) -> str:
    try:
        lines = log.read_text(errors="replace").split("\n")
    except OSError:
        return f"; it left no log {log}"
    last = next((line.strip() for line in reversed(lines) if line.strip()), "")
    return f"; log {log}: {last[:LAST_LETTERS]}" if last else f"; log {log} is empty"
