"""Scene files damaged at random: each loads, or is refused with a list of problems; none costs much
time or memory.
"""

import random
import time
import traceback
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

from faults.mutations import mutate_text
from faults.runs import FaultError, Outcome, in_own_process
from headstock.geometry.errors import HeadstockError
from headstock.geometry.parts.solids import MeshFile, StepFile
from headstock.pipeline.planning.planner import plan_scene
from headstock.pipeline.planning.resources import peak_memory_mb
from headstock.pipeline.storage.provenance import PROJECT
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.findings import SceneError

MACHINES = PROJECT / "machines"
SECONDS_ALLOWED = 1.0
MB_ALLOWED = 256.0
CHUNK = 2000
SETTINGS = (
    "components.column.fidelity=rigid",
    "joints.clamp.kind=[1",
    "a.b.c=1",
    "=",
    "limits.memory=1 GB",
    "components.x",
    "poses.p.X=1e400 m",
)


def run_scene_fuzz(runs: int, *, seed: int, root: Path) -> Outcome:
    """Load and plan damaged copies of the shipped scenes, in child processes of ``CHUNK`` scenes
    each.

    A fault is anything but success or a named error, more than ``SECONDS_ALLOWED`` of processor
    time, or a process that grows beyond ``MB_ALLOWED`` (interpreter and libraries included)."""
    outcome = Outcome()
    for first in range(0, runs, CHUNK):
        count = min(CHUNK, runs - first)
        outcome.trials += count
        try:
            found = in_own_process(_fuzz, root, seed, first, count)
        except BrokenProcessPool as error:
            last = (root / "number").read_text() if (root / "number").exists() else "?"
            outcome.faults.append(f"scene {last} ended the process: {error}")
            continue
        outcome.happened.update(found.happened)
        outcome.faults += found.faults
        outcome.slowest_seconds = max(outcome.slowest_seconds, found.slowest_seconds)
        outcome.peak_mb = max(outcome.peak_mb, found.peak_mb)
    if outcome.peak_mb > MB_ALLOWED:
        outcome.faults.append(
            f"a process grew to {outcome.peak_mb:.0f} MB, {MB_ALLOWED:.0f} are allowed"
        )
    return outcome


def damaged_scene(number: int, seed: int, texts: tuple[str, ...]) -> str:
    """Text of a damaged scene, the same for the same number and seed."""
    chance = random.Random(f"{seed}/{number}")
    return mutate_text(chance.choice(texts), texts, chance)


def shipped_texts() -> tuple[str, ...]:
    """The scenes that are damaged."""
    texts = tuple(path.read_text() for path in sorted(MACHINES.glob("*.toml")))
    if not texts:
        raise FaultError(f"no scenes in {MACHINES}")
    return texts


def try_scene(path: Path, overrides: tuple[str, ...]) -> str:
    """Load and plan a scene; how it ended, in words."""
    try:
        scene = load_scene(path, overrides=overrides)
    except SceneError as error:
        if not error.problems or len(str(error)) > 100_000:
            raise FaultError(
                f"{len(error.problems)} problems in {len(str(error))} characters"
            ) from error
        return "refused"
    if any(
        isinstance(component.solid, StepFile | MeshFile)
        for component in scene.machine.components.values()
    ):
        return "loaded"
    try:
        plan_scene(scene)
    except HeadstockError:
        return "loaded, over budget"
    return "loaded and planned"


def _fuzz(root: Path, seed: int, first: int, count: int) -> Outcome:
    outcome, texts = Outcome(), shipped_texts()
    path = root / "scene.toml"
    for number in range(first, first + count):
        (root / "number").write_text(str(number))
        path.write_text(damaged_scene(number, seed, texts), errors="surrogatepass")
        overrides = (SETTINGS[number % len(SETTINGS)],) if number % 20 == 0 else ()
        start = time.process_time()
        try:
            outcome.note_trial(try_scene(path, overrides), seconds=time.process_time() - start)
        except Exception as error:
            where = traceback.extract_tb(error.__traceback__)[-1]
            text = str(error)[:300]
            outcome.faults.append(
                f"scene {number}: {type(error).__name__}: {text} ({Path(where.filename).name}:{where.lineno})"
            )
        seconds = time.process_time() - start
        if seconds > SECONDS_ALLOWED:
            outcome.faults.append(f"scene {number} took {seconds:.2f} s")
    outcome.peak_mb = peak_memory_mb()
    return outcome
