"""Running a sweep: components reduced once, poses dealt out to the ranks in turn, each finished
pose kept in a journal.
"""

import dataclasses
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.tool_travel import NO_FEED
from headstock.pipeline.planning.planner import plan_scene
from headstock.pipeline.stages.run_state import MachineParts, Observer
from headstock.pipeline.stages.shared_components import make_superelements, start_run
from headstock.pipeline.storage.content_keys import hash_dependencies
from headstock.pipeline.storage.outputs import OutputError
from headstock.reduction.motions.tool_deviation import trace_feed
from headstock.reduction.superelement import Superelement
from headstock.scene.analyses.lobes import LobesRequest, refuse_still_feed
from headstock.scene.scene import Scene
from headstock.scene.studies import Sweep, describe_positions, sweep_pose
from headstock.solvers.mpi import MPI
from headstock.solvers.ranks import make_on_root, share_from_root
from headstock.studies.points import list_waiting
from headstock.studies.sweeps.journals import (
    PoseResult,
    encode_result,
    identify_pose,
    open_journal,
    read_journals,
)
from headstock.studies.sweeps.poses import (
    POSES_AT_ONCE,
    share_machine,
    share_mechanism,
    solve_lumped_poses,
    solve_machine_pose,
)
from headstock.studies.sweeps.results import SweepResults, collect_results

SWEPT_ANALYSES = ("static", "modal", "frf", "lobes")
POLL_SECONDS = 0.005
POSES_NAMED = 3  # in a remark


@dataclass(frozen=True)
class Part:
    """Share of the poses that a job computes: the first of one unless it is one of several."""

    number: int = 1
    of: int = 1


@dataclass(frozen=True, eq=False)
class SweepJob:
    """A sweep as it was when it was started.

    Attributes:
        scene: With only the analyses that are swept.
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
    remarks: tuple[str, ...]
    parts: MachineParts
    superelements: dict[str, Superelement]

    def complete(self) -> list[PoseResult]:
        """One result per pose.

        Raises:
            OutputError: A pose is missing: another part has not computed it.
        """
        results = [result for result in self.results if result is not None]
        if len(results) < len(self.results):
            raise OutputError(
                f"{len(self.results) - len(results)} of {len(self.results)} poses are not computed yet"
            )
        return results


def select_analyses(scene: Scene) -> Scene:
    """The scene with only the analyses that are swept, whatever poses they name."""
    return dataclasses.replace(scene, analyses=scene.analyses.keep(SWEPT_ANALYSES))


def sweep_key(scene: Scene) -> str:
    """SHA-256 of everything a pose's result depends on but its positions: the scene, its files and
    this program.
    """
    return hash_dependencies(scene.path.parent, scene.raw, without=("poses",))


def gather_sweep(job: SweepJob, outcome: SweepOutcome) -> SweepResults:
    """Return arrays over the poses of a sweep; modes have no names yet."""
    return collect_results(
        job.scene,
        job.sweep,
        outcome.complete(),
        outcome.superelements,
        key=outcome.key,
        remarks=outcome.remarks,
    )


def run_sweep(
    job: SweepJob, *, comm: MPI.Comm, observer: Observer = lambda record: None
) -> SweepOutcome:
    """Compute every pose that is in no journal yet; collective.

    Poses are dealt out in turn, so that every rank gets some of each region, rank 0 too. An error
    in one pose is that pose's result. What one rank raises ends the job through the caller
    (``comm.Abort``).

    Args:
        job: The same on every rank.
        observer: Called with each component's stage as it ends, on rank 0.

    Raises:
        OutputError: A journal cannot be written.
        HeadstockError: A component cannot be reduced.
    """
    key = make_on_root(comm, lambda: sweep_key(job.scene))
    parts, superelements = _make_components(job, comm, observer)
    feed, remarks = make_on_root(comm, lambda: _find_feed(job, superelements))
    names = list(map(identify_pose, job.sweep.positions, feed))
    waiting = make_on_root(comm, lambda: _find_waiting(job, key, names))
    mine = waiting[comm.rank :: comm.size]
    if mine:
        with open_journal(
            job.folder, key, f"{job.part.number}of{job.part.of}-{comm.rank}"
        ) as journal:
            for result in _solve_poses(job, parts, superelements, feed, mine):
                journal.append(encode_result(result))
    _wait_for_all(comm)
    finished = read_journals(job.folder, key) if comm.rank == 0 else {}
    results = tuple(map(finished.get, names))
    return SweepOutcome(key, results, len(waiting), remarks, parts, superelements)


def _find_feed(
    job: SweepJob, superelements: Mapping[str, Superelement]
) -> tuple[FloatArray, tuple[str, ...]]:
    """Direction of the feed in every pose ``(n, 3)``, NaN where nobody asks or the tool does not
    move across its axis, and what is said of it.

    Raises:
        SceneError: The tool moves nowhere along the path.
    """
    sweep, request = job.sweep, job.scene.analyses.get(LobesRequest)
    count = len(sweep.positions)
    if request is None or not request.asks_for_feed:
        return np.tile(NO_FEED, (count, 1)), ()
    poses = [sweep_pose(sweep, number) for number in range(count)]
    traced = trace_feed(job.scene.machine, superelements, request.at, poses)
    if not np.isfinite(traced.directions).any():
        raise refuse_still_feed(job.scene, request)
    along_axis = [
        number
        for number, feed in enumerate(traced.directions)
        if np.isfinite(feed).all() and len(request.travels(feed)) < len(request.directions)
    ]
    directions = traced.directions.copy()
    directions[along_axis] = np.nan
    remarks = (
        ("the way has a corner, so the feed is that of the move that ends there", traced.corners),
        ("the tool stands still in its work, so the feed is that of the way through its place", traced.standing),
        ("the tool is fed along its axis, so there is no limit depth", along_axis),
    )  # fmt: skip
    return directions, tuple(
        f"lobes along the feed: in {_list_poses(sweep, numbers)} {what}"
        for what, numbers in remarks
        if numbers
    )


def _list_poses(sweep: Sweep, numbers: Sequence[int]) -> str:
    """``pose 3 (X 10 mm)``, or how many and the first ones."""
    shown = ", ".join(
        f"{number + 1} ({describe_positions(sweep, number)})" for number in numbers[:POSES_NAMED]
    )
    if len(numbers) == 1:
        return f"pose {shown}"
    return f"{len(numbers)} poses, {shown}{', ...' if len(numbers) > POSES_NAMED else ''},"


def _find_waiting(job: SweepJob, key: str, names: list[bytes]) -> list[int]:
    waiting = list_waiting(
        names,
        read_journals(job.folder, key),
        again=lambda result: job.retry and result.state == "failed",
    )
    return [number for number in waiting if number % job.part.of == job.part.number - 1]


def _make_components(
    job: SweepJob, comm: MPI.Comm, observer: Observer
) -> tuple[MachineParts, dict[str, Superelement]]:
    """Reduce every component, or take it from the store; every rank gets all superelements, without
    what pictures need.
    """
    plan = make_on_root(comm, lambda: plan_scene(job.scene))
    state = start_run(job.scene, comm, plan=plan)
    light = {
        name: dataclasses.replace(superelement, recovery=None)
        for name, superelement in make_superelements(state, observer=observer).items()
    }
    return state.parts, share_from_root(comm, light if state.is_root else None)


def _solve_poses(
    job: SweepJob,
    parts: MachineParts,
    superelements: dict[str, Superelement],
    feed: FloatArray,
    numbers: list[int],
) -> Iterator[PoseResult]:
    if not job.scene.is_lumped:
        shared = share_machine(parts, superelements)
        for number in numbers:
            yield solve_machine_pose(
                shared, sweep_pose(job.sweep, number), job.sweep.positions[number], feed[number]
            )
        return
    mechanism = share_mechanism(parts, superelements)
    for start in range(0, len(numbers), POSES_AT_ONCE):
        chunk = numbers[start : start + POSES_AT_ONCE]
        poses = [sweep_pose(job.sweep, number) for number in chunk]
        yield from solve_lumped_poses(mechanism, poses, job.sweep.positions[chunk], feed[chunk])


def _wait_for_all(comm: MPI.Comm) -> None:
    """Wait until every rank has come here, asleep: a barrier would spin and take a core from those
    that still compute.
    """
    request = comm.Ibarrier()
    while not request.Test():
        time.sleep(POLL_SECONDS)
