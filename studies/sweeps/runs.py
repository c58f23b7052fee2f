"""Running a sweep: components reduced once, poses dealt out to the ranks in turn, each finished
pose kept in a journal.
"""

import dataclasses
import hashlib
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mpi4py import MPI

from headstock.pipeline.planning.planner import plan_scene
from headstock.pipeline.stages.run_state import MachineParts, Observer, RunState
from headstock.pipeline.stages.shared_components import make_superelements
from headstock.pipeline.storage.content_keys import (
    PACKAGES,
    REDUCTION_LIBRARIES,
    canonical_json,
    code_fingerprint,
    file_digests,
    library_versions,
)
from headstock.pipeline.storage.outputs import OutputError
from headstock.pipeline.storage.store import Store, default_store_root
from headstock.reduction.superelement import Superelement
from headstock.scene.requests import Analyses
from headstock.scene.scene import Scene
from headstock.scene.studies import Sweep, sweep_pose
from headstock.solvers.ranks import make_on_root, share_from_root
from headstock.studies.sweeps.journals import PoseResult, encode_result, open_journal, read_journals
from headstock.studies.sweeps.lumped_poses import (
    POSES_AT_ONCE,
    LumpedPoses,
    share_mechanism,
    solve_lumped_poses,
)
from headstock.studies.sweeps.machine_poses import share_machine, solve_machine_pose

# of no influence on what is found in a pose
IRRELEVANT_SECTIONS = ("name", "studies", "sweeps", "variants", "compare", "poses")
SWEPT_ANALYSES = ("static", "modal", "frf", "lobes")
POLL_SECONDS = 0.005


@dataclass(frozen=True)
class Part:
    """Which share of the poses a job computes: the first of one unless it is one of several
    jobs.
    """

    number: int = 1
    of: int = 1


@dataclass(frozen=True, eq=False)
class SweepJob:
    """A sweep as it was when it was started.

    Attributes:
        scene: With only the analyses that are swept.
        sweep: Its poses.
        folder: Of the results.
        part: Share of the poses that this job computes.
        retry: Poses that failed before are computed again.
    """

    scene: Scene
    sweep: Sweep
    folder: Path
    part: Part = Part()
    retry: bool = False


@dataclass(frozen=True, eq=False)
class SweepOutcome:
    """What is known when a sweep's poses have been computed.

    Attributes:
        key: Of everything a pose's result depends on.
        results: One per pose, in order; None for poses that another part computes.
        computed: How many this job computed, on all ranks.
        parts: What the machine is made of; complete on rank 0.
        superelements: By component name, without their recovery.
    """

    key: str
    results: tuple[PoseResult | None, ...]
    computed: int
    parts: MachineParts
    superelements: dict[str, Superelement]

    def complete(self) -> list[PoseResult]:
        """One result per pose.

        Raises:
            OutputError: A pose is missing: another part has not computed it.
        """
        found = [result for result in self.results if result is not None]
        if len(found) < len(self.results):
            raise OutputError(
                f"{len(self.results) - len(found)} of {len(self.results)} poses are not computed yet"
            )
        return found


def select_analyses(scene: Scene) -> Scene:
    """The scene with only the analyses that are swept, whatever poses they name."""
    kept = {name: getattr(scene.analyses, name) for name in SWEPT_ANALYSES}
    return dataclasses.replace(scene, analyses=Analyses(**kept))


def sweep_key(scene: Scene) -> str:
    """SHA-256 of everything a pose's result depends on but its positions: the scene, its files and
    this program.
    """
    content = {
        "scene": {key: value for key, value in scene.raw.items() if key not in IRRELEVANT_SECTIONS},
        "files": dict(file_digests(scene.path.parent, scene.raw)),
        "algorithm": [code_fingerprint(package) for package in PACKAGES],
        "libraries": library_versions(REDUCTION_LIBRARIES),
    }
    return hashlib.sha256(canonical_json(content).encode()).hexdigest()


def run_sweep(
    job: SweepJob, *, comm: MPI.Comm, observer: Observer = lambda record: None
) -> SweepOutcome:
    """Compute every pose that is in no journal yet; collective.

    Poses are dealt out in turn, so that every rank gets some of each region, rank 0 too. An error
    in one pose is that pose's result. What one rank raises ends the job through the caller
    (``comm.Abort``).

    Args:
        job: The same on every rank.
        comm: Collective.
        observer: Called with each component's stage as it ends, on rank 0.

    Raises:
        OutputError: A journal cannot be written.
        HeadstockError: A component cannot be reduced.
    """
    key = make_on_root(comm, lambda: sweep_key(job.scene))
    waiting = make_on_root(comm, lambda: _find_waiting(job, key))
    parts, superelements = _make_components(job, comm, observer)
    mine = waiting[comm.rank :: comm.size]
    if mine:
        with open_journal(
            job.folder, key, f"{job.part.number}of{job.part.of}-{comm.rank}"
        ) as journal:
            for result in _solve_poses(job, parts, superelements, mine):
                journal.append(encode_result(result))
    _wait_for_all(comm)
    known = read_journals(job.folder, key) if comm.rank == 0 else {}
    results = tuple(known.get(positions.tobytes()) for positions in job.sweep.positions)
    return SweepOutcome(key, results, len(waiting), parts, superelements)


def _find_waiting(job: SweepJob, key: str) -> list[int]:
    known = read_journals(job.folder, key)
    done = {name for name, result in known.items() if not (job.retry and result.state == "failed")}
    waiting = [
        number
        for number, positions in enumerate(job.sweep.positions)
        if positions.tobytes() not in done
    ]
    return [number for number in waiting if number % job.part.of == job.part.number - 1]


def _make_components(
    job: SweepJob, comm: MPI.Comm, observer: Observer
) -> tuple[MachineParts, dict[str, Superelement]]:
    """Reduce every component, or take it from the store; every rank gets all superelements, without
    what pictures need.
    """
    plan = make_on_root(comm, lambda: plan_scene(job.scene))
    state = RunState(job.scene, plan, comm, Store(default_store_root()))
    light = {
        name: dataclasses.replace(superelement, recovery=None)
        for name, superelement in make_superelements(state, observer=observer).items()
    }
    return state.parts, share_from_root(comm, light if state.is_root else None)


def _solve_poses(
    job: SweepJob, parts: MachineParts, superelements: dict[str, Superelement], numbers: list[int]
) -> Iterator[PoseResult]:
    if not job.scene.is_lumped:
        shared = share_machine(parts, superelements)
        for number in numbers:
            yield solve_machine_pose(
                shared, sweep_pose(job.sweep, number), job.sweep.positions[number]
            )
        return
    mechanism: LumpedPoses = share_mechanism(parts, superelements)
    for start in range(0, len(numbers), POSES_AT_ONCE):
        chunk = numbers[start : start + POSES_AT_ONCE]
        poses = [sweep_pose(job.sweep, number) for number in chunk]
        yield from solve_lumped_poses(mechanism, poses, job.sweep.positions[np.array(chunk)])


def _wait_for_all(comm: MPI.Comm) -> None:
    """Wait until every rank has come here, asleep: a barrier would spin and take a core from those
    that still compute.
    """
    request = comm.Ibarrier()
    while not request.Test():
        time.sleep(POLL_SECONDS)
