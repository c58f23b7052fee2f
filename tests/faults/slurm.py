"""Sweeps as array jobs of a real Slurm, some tasks put back into the queue, killed or cancelled:
the file of a local sweep comes out.
"""

import contextlib
import json
import os
import random
import re
import signal
import subprocess
import time
from dataclasses import dataclass
from pathlib import Path

import h5py

from common import Done, run_process
from faults.runs import FaultError, Outcome
from faults.slurm_daemons import run_slurm
from headstock.pipeline.storage.provenance import PROJECT

SCENE, SWEEP = PROJECT / "machines" / "three_axis.toml", "workspace"
TASKS, RANKS = 3, 2
ENDINGS = (
    "undisturbed",
    "one task put back into the queue",
    "one task killed",
    "one task cancelled",
)
TIME_LIMIT, POLL_SECONDS, SETTLE_SECONDS = 1200.0, 0.02, 10.0
# temporary files of the jobs, too, go where they end with the trials
# kernels of BLAS that the caller has chosen decide about last digits
PASSED_ON = "--export=HOME,USER,LOGNAME,PATH,TMPDIR,OPENBLAS_CORETYPE"
FILES = ("sweep.h5", "sweep.json")


@dataclass(frozen=True)
class SlurmPlaces:
    """Folder of the trials, and the variables its commands run with."""

    root: Path
    variables: dict[str, str]

    def run(self, *words: str) -> Done:
        """Run a command to its end."""
        return run_process(words, env=self._environment(), timeout=TIME_LIMIT)

    def start_sweep(self, folder: str) -> "subprocess.Popen[str]":
        """Start the sweep as an array job."""
        counts = ["--tasks", str(TASKS), "--ranks", str(RANKS)]
        options = ["--on", "slurm", *counts, f"--sbatch={PASSED_ON}"]
        return subprocess.Popen(
            [*sweep_words(self.root / folder), *options],
            env=self._environment(), stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
            errors="replace",
        )  # fmt: skip

    def _environment(self) -> dict[str, str]:
        own = {"HEADSTOCK_STORE": str(self.root / "store"), "HEADSTOCK_THREADS": "1"}
        return {**os.environ, **own, **self.variables}


def sweep_words(folder: Path) -> list[str]:
    """The command line of the sweep into a folder."""
    return [str(PROJECT / "headstock"), "sweep", str(SCENE), SWEEP, "-o", str(folder)]


def disturb_slurm(runs: int, *, seed: int, root: Path) -> Outcome:
    """Start Slurm, sweep on it again and again, hold each file against that of a local sweep, and
    stop Slurm."""
    outcome, chance = Outcome(), random.Random(seed)
    before = list_processes()
    root.chmod(0o755)
    (root / "slurm").mkdir()
    with run_slurm(root / "slurm", cpus=TASKS * RANKS) as slurm:
        places = SlurmPlaces(root, slurm.variables)
        for trial in range(runs):
            ending = ENDINGS[trial % len(ENDINGS)]
            try:
                _sweep_once(places, f"trial-{trial + 1}", ending, chance.randint(1, TASKS))
                outcome.note_trial(ending)
            except FaultError as error:
                outcome.note_trial("fault")
                outcome.faults.append(f"trial {trial + 1}, {ending}: {error}")
        outcome.notes.append(places.run("sbatch", "--version").stdout.strip())
    outcome.faults += [
        f"still running after Slurm was stopped: {name}" for name in _wait_for_leavers(before)
    ]
    return outcome


def list_processes() -> dict[int, str]:
    """Command lines of all processes that run, by number."""
    found: dict[int, str] = {}
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            words = path.read_bytes().replace(b"\0", b" ").decode(errors="replace").strip()
        except OSError:
            continue  # it has ended
        if words:
            found[int(path.parent.name)] = words
    return found


def _sweep_once(places: SlurmPlaces, folder: str, ending: str, task: int) -> None:
    process = places.start_sweep(folder)
    try:
        if ending != ENDINGS[0]:
            _disturb(places, folder, process, ending, task)
        said, _ = process.communicate(timeout=TIME_LIMIT)
    finally:
        process.kill()
    fails = ending in ENDINGS[2:]
    if process.returncode != int(fails):
        raise FaultError(f"the sweep ended with {process.returncode}: {said[-1500:]}")
    if fails:
        _check_complaint(said, task)
        _complete(places, folder, task)
    if ending != ENDINGS[0]:
        _check_kept(places, folder, task, requeued=not fails)
    _compare(places, folder)


def _disturb(
    places: SlurmPlaces, folder: str, process: "subprocess.Popen[str]", ending: str, task: int
) -> None:
    """Wait until a task has finished a pose, then end it before it has finished all."""
    journals = places.root / folder / "poses"
    end = time.monotonic() + TIME_LIMIT
    pattern = f"*-{task}of{TASKS}-*.journal"
    while not any(path.stat().st_size > 1000 for path in journals.glob(pattern)):
        if process.poll() is not None or time.monotonic() > end:
            raise FaultError(f"task {task} wrote no pose")
        time.sleep(POLL_SECONDS)
    # stopped, it stays unfinished until it is ended
    _signal_task(places, folder, task, signal.SIGSTOP)
    if ending == ENDINGS[2]:
        _signal_task(places, folder, task, signal.SIGKILL)
        return
    words = ("scontrol", "requeue") if ending == ENDINGS[1] else ("scancel",)
    done = places.run(*words, f"{_job_number(places, folder)}_{task}")
    if done.returncode:
        raise FaultError(f"{' '.join(words)} of task {task}: {done.stderr.strip()}")


def _signal_task(places: SlurmPlaces, folder: str, task: int, number: signal.Signals) -> None:
    for process, words in list_processes().items():
        if f"--part {task}/{TASKS}" in words and str(places.root / folder) in words:
            with contextlib.suppress(ProcessLookupError):
                os.kill(process, number)


def _job_number(places: SlurmPlaces, folder: str) -> str:
    path = places.root / folder / "slurm" / "submission.json"
    return str(json.loads(path.read_text())["job"])


def _check_complaint(said: str, task: int) -> None:
    """The command names the task, no other, and its log."""
    named = [number for number in range(1, TASKS + 1) if f"task {number} (" in said]
    if named != [task] or f"_{task}.log" not in said:
        raise FaultError(f"task {task} was ended, and the sweep said: {said[-1500:]}")


def _check_kept(places: SlurmPlaces, folder: str, task: int, *, requeued: bool) -> None:
    """The task that was begun twice computed only what it had not finished the first time."""
    name = f"{_job_number(places, folder)}_{task}.log"
    log = (places.root / folder / "slurm" / name).read_text(errors="replace")
    if requeued and "REQUEUE" not in log:
        raise FaultError(f"task {task} was not put back into the queue: {log[-1500:]}")
    computed = re.findall(rf"part {task} of {TASKS}: (\d+) poses? computed", log)
    with h5py.File(places.root / folder / FILES[0], "r") as file:
        share = len(range(task - 1, len(file["positions"]), TASKS))
    if not computed or not 0 < int(computed[-1]) < share:
        begun = f"task {task} of {share} poses, begun again"
        raise FaultError(f"{begun}, did not go on where it was: {log[-1500:]}")


def _complete(places: SlurmPlaces, folder: str, task: int) -> None:
    """The same command again submits that task only."""
    process = places.start_sweep(folder)
    said, _ = process.communicate(timeout=TIME_LIMIT)
    if process.returncode or f"1 task ({task})" not in said:
        raise FaultError(f"the second sweep ended with {process.returncode}: {said[-1500:]}")


def _compare(places: SlurmPlaces, folder: str) -> None:
    """Every file is that of a local sweep, byte for byte."""
    local = places.root / "local"
    if not local.is_dir():
        done = places.run(*sweep_words(local))
        if done.returncode:
            raise FaultError(f"the local sweep ended with {done.returncode}: {done.stderr[-1500:]}")
    for name in FILES:
        if (local / name).read_bytes() != (places.root / folder / name).read_bytes():
            raise FaultError(f"{name} differs from that of a local sweep")


def _wait_for_leavers(before: dict[int, str]) -> list[str]:
    end = time.monotonic() + SETTLE_SECONDS
    while left := [words for number, words in list_processes().items() if number not in before]:
        if time.monotonic() > end:
            break
        time.sleep(POLL_SECONDS)
    return left
