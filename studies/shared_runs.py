"""Runs of many scenes dealt out to ranks, once these have shared the components of all of them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from headstock.pipeline.planning.budgets import BASE_MB
from headstock.pipeline.planning.plan import Plan
from headstock.pipeline.planning.planner import plan_scene
from headstock.pipeline.planning.resources import node_memory_bytes
from headstock.pipeline.stages.shared_components import expect_job, prepare_components, start_run
from headstock.pipeline.storage.store import Store
from headstock.scene.scene import Scene
from headstock.solvers.mpi import MPI
from headstock.solvers.shared_work import share_work


@dataclass(frozen=True, eq=False)
class PlannedRun:
    """A scene with what its run takes."""

    scene: Scene
    plan: Plan


def plan_run(scene: Scene) -> PlannedRun:
    """A scene with its plan.

    Raises:
        HeadstockError: There is none.
    """
    return PlannedRun(scene, plan_scene(scene))


def share_runs[T](
    runs: Sequence[PlannedRun],
    work: Callable[[int], T],
    *,
    comm: MPI.Comm,
    store: Store,
    observer: Callable[[int, T], None] = lambda number, result: None,
) -> list[T]:
    """Reduce the components of all scenes, equal ones once, and then work on each scene on one
    rank; collective.

    Args:
        runs: The same on every rank, at least one.
        work: On the scene of a number, on this rank alone.
        comm: Ranks that share components and scenes.
        store: Where superelements are kept.
        observer: Called on rank 0 with the number of each scene that is done and its result.

    Returns:
        What ``work`` made of each; empty on other ranks.

    Raises:
        SharedFailure: A component or a scene failed, on every rank of several; on rank 0 the cause
            says why. A single rank gets the error itself.
    """
    prepare_components([start_run(run.scene, comm, store, plan=run.plan) for run in runs])
    machines = [[stage for stage in run.plan.stages if stage.component is None] for run in runs]
    return share_work(
        comm,
        [expect_job(stages) for stages in machines],
        lambda number, settle: work(number),
        folder=store.root,
        memory_mb=node_memory_bytes() / 1e6,
        idle_mb=BASE_MB,
        observer=observer,
    )
