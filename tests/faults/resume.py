"""Sweeps and studies killed at random times and started again: they end with the content of one
that was left alone.
"""

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from common import read_datasets
from faults.runs import PROGRAM, FaultError, Outcome, start_command, wait_for_end
from fixture_machines import stored_scene
from headstock.pipeline.storage.journals import read_journal
from headstock.studies.sweeps.journals import _pose_form

SCENE = stored_scene("resume")
NAMES = {"sweep": "line", "study": "grid"}
# what is run in turn; the last on two ranks, of which one is killed
KINDS = ("sweep", "study", "sweep on 2 ranks")
POLL_SECONDS = 0.005
EQUAL, SINGLE = 1e-10, 1e-4  # of numbers, and of shapes in single precision

Content = dict[str, Any]


def kill_and_resume(
    runs: int, *, seed: int, root: Path, kinds: Sequence[str] = KINDS, scene: str = SCENE
) -> Outcome:
    """Kill a sweep or a study with signal 9 and start it again, until it ends; then begin anew.

    Args:
        runs: How many are killed.
        seed: Of the random times.
        root: Empty folder to work in.
        kinds: Which of ``KINDS`` are killed in turn.
        scene: With the sweep and the study.

    Raises:
        FaultError: Not even an undisturbed one works.
    """
    chance, outcome = random.Random(seed), Outcome()
    (root / "scene.toml").write_text(scene)
    kinds = [kind for kind in kinds if shutil.which("mpirun") or "ranks" not in kind]
    expected = {kind: _leave_alone(root, kind) for kind in kinds}
    for trial in range(runs):
        kind = kinds[trial % len(kinds)]
        folder = root / kind.replace(" ", "-")
        try:
            finished_before = _count_finished(folder)
            delay = chance.uniform(0.0, expected[kind][1])
            ending = _kill_one(start_resumable(root, folder, kind), folder, delay)
            outcome.note_trial(f"{kind}: {ending}")
            if _count_finished(folder) < finished_before:
                raise FaultError("finished ones were lost")
            if ending == "had ended before the kill" or chance.random() < 0.3:
                _finish(root, folder, kind, expected[kind][0])
        except FaultError as error:
            outcome.faults.append(f"kill {trial + 1} ({kind}): {error}")
    for kind in kinds:
        try:
            _finish(root, root / kind.replace(" ", "-"), kind, expected[kind][0])
        except FaultError as error:
            outcome.faults.append(f"at the end ({kind}): {error}")
    return outcome


def read_content(folder: Path) -> Content:
    """What a sweep or a study found, without what it cost: names and their arrays, words or JSON.

    Raises:
        FaultError: A file is missing or torn.
    """
    try:
        if (folder / "sweep.h5").is_file():
            with h5py.File(folder / "sweep.h5") as file:
                found: Content = {str(name): str(value) for name, value in file.attrs.items()}
            return found | read_datasets(folder / "sweep.h5", lambda item: item[()])
        records = [json.loads(line) for line in (folder / "points.jsonl").read_text().splitlines()]
        listing = json.loads((folder / "study.json").read_text())
    except (OSError, ValueError) as error:
        raise FaultError(f"{folder} is torn: {error}") from error
    kept: Content = {"rows": str(len(listing["rows"]))}
    for record in records:
        answers = [record["summary"][name] for name in ("modal", "static")]
        kept[record["key"]] = json.dumps([record["status"], *answers])
    return kept


def find_difference(found: Content, expected: Content) -> str:
    """The first name whose content differs, by more than ``EQUAL`` of its largest number where it
    has numbers; empty for none.
    """
    if found.keys() != expected.keys():
        return f"other names: {sorted(found.keys() ^ expected.keys())[:3]}"
    for name, value in expected.items():
        other = found[name]
        words = isinstance(value, str) or isinstance(other, str)
        numbers = not words and value.dtype.kind == "f"
        if not numbers or np.shape(value) != np.shape(other):
            if not np.array_equal(value, other):
                return f"{name} differs"
            continue
        limit = SINGLE if value.dtype == np.float32 else EQUAL
        largest = max(float(np.nanmax(np.abs(value), initial=0.0)), 1e-300)
        error = float(np.nanmax(np.abs(value - other), initial=0.0)) / largest
        if error > limit or not np.array_equal(np.isnan(value), np.isnan(other)):
            return f"{name} differs by {error:.2g} of its largest number"
    return ""


def _leave_alone(root: Path, kind: str) -> tuple[Content, float]:
    """Content of an undisturbed one, and its seconds once everything is loaded."""
    folder, seconds = root / "alone", 0.0
    for _ in range(2):
        shutil.rmtree(folder, ignore_errors=True)
        start = time.perf_counter()
        _require_done(start_resumable(root, folder, kind))
        seconds = time.perf_counter() - start
    return read_content(folder), seconds


def _finish(root: Path, folder: Path, kind: str, expected: Content) -> None:
    """Let it end, hold its content against that of an undisturbed one, and clear the folder."""
    _require_done(start_resumable(root, folder, kind))
    difference = find_difference(read_content(folder), expected)
    if difference:
        raise FaultError(f"the content is not that of an undisturbed one: {difference}")
    shutil.rmtree(folder)


def start_resumable(
    root: Path,
    folder: Path,
    kind: str,
    *,
    variant: str | None = None,
    environment: Mapping[str, str] = os.environ,
) -> "subprocess.Popen[str]":
    """Start a sweep or a study of ``scene.toml`` in a folder, with the store beside it, as the
    leader of a process group.
    """
    command = kind.split()[0]
    program = [*PROGRAM, command, str(root / "scene.toml"), NAMES[command]]
    program += ["--variant", variant] if variant else []
    if "ranks" in kind:
        program = ["mpirun", "--oversubscribe", "--bind-to", "none", "-n", "2", *program]
    store = {"HEADSTOCK_STORE": str(root / "store")}
    return start_command([*program, "-o", str(folder)], {**environment, **store})


def _require_done(process: "subprocess.Popen[str]") -> None:
    said = wait_for_end(process)
    if process.returncode:
        raise FaultError(f"it ended with {process.returncode}: {said[-500:]}")


def _kill_one(process: "subprocess.Popen[str]", folder: Path, delay: float) -> str:
    """Kill a process or, under mpirun, one of the ranks it started."""
    end = time.monotonic() + delay
    while process.poll() is None and time.monotonic() < end:
        time.sleep(POLL_SECONDS)
    if process.poll() is not None:
        process.communicate()
        return "had ended before the kill"
    ranks = [pid for pid in _processes_of(folder) if pid != process.pid]
    os.kill(ranks[0] if ranks else process.pid, signal.SIGKILL)
    wait_for_end(process)
    return "killed"


def _processes_of(folder: Path) -> list[int]:
    """Python processes that were told to write into a folder."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                words = (entry / "cmdline").read_bytes().split(b"\0")
            except OSError:
                continue
            if str(folder).encode() in words and words[0] == sys.executable.encode():
                found.append(int(entry.name))
    return found


def _count_finished(folder: Path) -> int:
    """Poses of all journals, or lines of a study: what is finished never becomes less."""
    try:
        if (folder / "points.jsonl").is_file():
            return (folder / "points.jsonl").read_bytes().count(b"\n")
        journals = folder.glob("poses/*.journal")
        return sum(len(read_journal(path, _pose_form(_key_of(path)))) for path in journals)
    except OSError:
        return 0


def _key_of(journal: Path) -> str:
    return journal.read_bytes().partition(b"\n")[0].rpartition(b" ")[2].decode("ascii", "replace")
