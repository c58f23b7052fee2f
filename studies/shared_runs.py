"""Runs of a scene and of changes of it: planned, or refused in words; dealt out to ranks; timed."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from headstock.geometry.errors import HeadstockError
from headstock.pipeline.planning.plan import Plan
from headstock.pipeline.planning.planner import plan_scene
from headstock.pipeline.stages.shared_components import (
    deal_out,
    expect_job,
    prepare_components,
    start_run,
)
from headstock.pipeline.storage.provenance import SceneChoice
from headstock.pipeline.storage.store import Store
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.findings import SceneError
from headstock.scene.scene import Scene, keep_analyses
from headstock.solvers.mpi import MPI
from headstock.solvers.ranks import make_on_root

REPEATS = 3  # of a quick run


@dataclass(frozen=True, eq=False)
class PlannedRun:
    """A scene with what its run takes."""

    scene: Scene
    plan: Plan


def plan_run(scene: Scene) -> PlannedRun:
    """Return a scene with its plan.

    Raises:
        HeadstockError: There is none.
    """
    return PlannedRun(scene, plan_scene(scene))


def load_choice(choice: SceneChoice, settings: Sequence[str] = ()) -> Scene:
    """Return the scene of a choice with the analyses chosen.

    Args:
        choice: File, variant, overrides and analyses.
        settings: Further ``key=value`` overrides.

    Raises:
        SceneError: It has problems.
    """
    scene = load_scene(
        choice.path, variant=choice.variant, overrides=[*choice.overrides, *settings]
    )
    return keep_analyses(scene, choice.analyses) if choice.analyses else scene


def plan_change(choice: SceneChoice, settings: Sequence[str]) -> PlannedRun | str:
    """Return the run of a scene with overrides, or why there is none.

    Args:
        settings: ``key=value`` overrides; without any, errors are raised.
    """
    try:
        return plan_run(load_choice(choice, settings))
    except (SceneError, HeadstockError) as error:
        if not settings:
            raise
        return error.problems[0].message if isinstance(error, SceneError) else str(error)


def repeat_quick[T](
    run: Callable[[int], T],
    seconds: Callable[[T], float],
    *,
    quick: float,
    least: int = 1,
    comm: MPI.Comm,
) -> list[T]:
    """Run something, ``REPEATS`` times where the first took less than ``quick`` seconds; collective.

    Args:
        run: Takes the number of the repeat, from 0.
        seconds: Of a run, on rank 0 [s].
        least: Runs of what is not quick.
    """
    runs = [run(0)]
    is_quick = make_on_root(comm, lambda: seconds(runs[0]) < quick)
    return runs + [run(number) for number in range(1, REPEATS if is_quick else least)]


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
    return deal_out(
        [expect_job(stages) for stages in machines],
        lambda number, settle: work(number),
        comm=comm,
        folder=store.root,
        observer=observer,
    )
