"""What the fault-injection tests share: a small elastic scene in two variants, its run as a
process, the numbers it leaves, the tally.
"""

import contextlib
import json
import multiprocessing
import os
import signal
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import h5py
import numpy as np

from fixture_machines import stored_scene
from headstock.geometry.frames import FloatArray

VARIANTS = ("steel", "iron")
SCENE = stored_scene("runs")
TIME_LIMIT = 1800.0  # of what takes seconds: for machines where a dozen other programs run
EQUAL = 1e-12
PROGRAM = (sys.executable, "-P", "-m", "headstock.app.command_line")


class FaultError(Exception):
    """Something torn, wrong or left behind."""


@dataclass
class Outcome:
    """Tally of trials, filled in while they run."""

    trials: int = 0
    happened: Counter[str] = field(default_factory=Counter)
    faults: list[str] = field(default_factory=list)
    slowest_seconds: float = 0.0
    peak_mb: float = 0.0
    notes: list[str] = field(default_factory=list)

    def note_trial(self, ending: str, *, seconds: float = 0.0) -> None:
        """Count a trial by how it ended."""
        self.trials += 1
        self.happened[ending] += 1
        self.slowest_seconds = max(self.slowest_seconds, seconds)


@dataclass(frozen=True)
class Places:
    """Folders of the runs: results, store, temporary files, and the scene."""

    root: Path
    cache: Path | None = None

    @property
    def scene(self) -> Path:
        """The scene file."""
        return self.root / "scene.toml"

    @property
    def results(self) -> Path:
        """The output folder of every run."""
        return self.root / "results"

    @property
    def store(self) -> Path:
        """The store of every run."""
        return self.root / "store"

    @property
    def temporary(self) -> Path:
        """``TMPDIR`` of every run."""
        return self.root / "tmp"


@dataclass(frozen=True, eq=False)
class Numbers:
    """What a run found: compliance ``(6, 6)`` [SI] and natural frequencies ``(n,)`` [Hz]."""

    compliance: FloatArray
    frequencies_hz: FloatArray

    def equal(self, other: "Numbers") -> bool:
        """Whether two runs found the same to ``EQUAL``, relative to the largest number of each
        kind.
        """
        return all(
            a.shape == b.shape and bool(np.all(np.abs(a - b) <= EQUAL * np.abs(b).max()))
            for a, b in zip(vars(self).values(), vars(other).values(), strict=True)
        )


def in_own_process[**P, T](work: Callable[P, T], *arguments: P.args, **options: P.kwargs) -> T:
    """What a function returns in a new process, which has neither the threads nor the memory of
    this one."""
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        return pool.submit(work, *arguments, **options).result()


def make_places(root: Path, *, cache: Path | None = None) -> Places:
    """Folders and the scene."""
    places = Places(root, cache)
    for folder in (places.store, places.temporary):
        folder.mkdir(parents=True, exist_ok=True)
    places.scene.write_text(SCENE)
    return places


def start_command(words: Sequence[str], variables: Mapping[str, str]) -> "subprocess.Popen[str]":
    """Start a command of the program as the leader of a process group; words before its own name
    Python, or what starts Python.
    """
    return subprocess.Popen(
        words,
        env={**variables, "OMP_NUM_THREADS": "1"},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
        start_new_session=True,
    )


def start_run(places: Places, variant: str) -> "subprocess.Popen[str]":
    """Start ``headstock run`` of a variant."""
    command = [*PROGRAM, "run", str(places.scene), "-o", str(places.results)]
    folders = {"HEADSTOCK_STORE": str(places.store), "TMPDIR": str(places.temporary)}
    if places.cache is not None:
        folders["XDG_CACHE_HOME"] = str(places.cache)
    return start_command([*command, "--variant", variant], {**os.environ, **folders})


def finish_run(places: Places, variant: str) -> tuple[int, str]:
    """Run a variant to its end; its exit code and what it said on standard error."""
    process = start_run(places, variant)
    said = wait_for_end(process)
    return process.returncode, said


def wait_for_end(process: "subprocess.Popen[str]", *, seconds: float = TIME_LIMIT) -> str:
    """Wait until the leader of a process group ends; what it said on standard error."""
    try:
        _, said = process.communicate(timeout=seconds)
    except subprocess.TimeoutExpired:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        raise FaultError(f"it did not end in {seconds:g} s") from None
    return said


def read_numbers(results: Path) -> Numbers:
    """Numbers of ``results.h5``, after a check that ``summary.json`` holds the same."""
    from_file = read_results(results / "results.h5")
    if not from_file.equal(read_summary_numbers(results / "summary.json")):
        raise FaultError(f"results.h5 and summary.json in {results} are of different runs")
    return from_file


def read_results(path: Path) -> Numbers:
    """Numbers of a ``results.h5``."""
    try:
        with h5py.File(path, "r") as file:
            pose = next(iter(file["modal"]))
            return Numbers(
                file[f"static/{pose}/tcp/compliance"][()], file[f"modal/{pose}/frequencies_hz"][()]
            )
    except (OSError, KeyError, RuntimeError) as error:
        raise FaultError(f"{path} is torn: {error}") from error


def read_summary_numbers(path: Path) -> Numbers:
    """Numbers of a ``summary.json``."""
    try:
        summary = json.loads(path.read_text())
        return Numbers(
            np.array(summary["static"]["tcp"]["compliance_6x6"], dtype=float),
            np.array(summary["modal"][0]["frequencies_hz"], dtype=float),
        )
    except (OSError, KeyError, ValueError) as error:
        raise FaultError(f"{path} is torn: {error}") from error
