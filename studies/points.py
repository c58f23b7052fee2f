"""Points of a study, a sweep, a fit or a comparison: which are left to compute, who computes them, and
runs of changed scenes as points: planned, or refused in words.
"""

import contextlib
import tempfile
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from headstock.geometry.errors import HeadstockError
from headstock.pipeline.planning.plan import Plan
from headstock.pipeline.planning.planner import plan_scene
from headstock.pipeline.stages.shared_components import (
    deal_out,
    expect_job,
    load_elastic,
    prepare_components,
    start_run,
)
from headstock.pipeline.storage.provenance import SceneChoice
from headstock.pipeline.storage.store import Store, default_store_root
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.findings import SceneError
from headstock.scene.scene import Scene, keep_analyses
from headstock.solvers.mpi import MPI
from headstock.solvers.ranks import make_on_root
from headstock.solvers.shared_work import Job

REPEATS = 3  # of a quick run
type Settle = Callable[[], None]  # called between steps of a point, gives BLAS the cores that idle


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


def try_plan(load: Callable[[], Scene]) -> PlannedRun | str:
    """Return the run of a scene with its plan, or why there is none."""
    try:
        return plan_run(load())
    except SceneError as error:
        return error.problems[0].message
    except HeadstockError as error:
        return str(error)


def list_waiting[Name: Hashable, Result](
    names: Sequence[Name],
    finished: Mapping[Name, Result],
    *,
    again: Callable[[Result], bool] = lambda result: False,
) -> list[int]:
    """Return the numbers of the points that are left to compute, the first of equal ones.

    Args:
        names: Of each point, of everything its result depends on.
        finished: Results by name that an earlier run has left.
        again: Whether the point of a result is computed again.
    """
    first = {name: number for number, name in reversed(list(enumerate(names)))}
    return sorted(
        number for name, number in first.items() if name not in finished or again(finished[name])
    )


def compute_points[Point, Result](
    points: Sequence[Point],
    work: Callable[[Point, MPI.Comm, Settle], Result],
    *,
    comm: MPI.Comm,
    folder: Path,
    together: bool = False,
    plan: Callable[[Point], PlannedRun | str] = lambda point: "",
    store: Store | None = None,
    observer: Callable[[Point, Result], None] = lambda point, result: None,
) -> list[Result]:
    """Compute points, each on one rank as ranks become free, or one after the other on all; collective.

    Args:
        points: The same on every rank.
        work: Makes the result of a point, on the ranks it is given.
        folder: On storage that all ranks read and write.
        together: All ranks compute each point; results are then on every rank.
        plan: Of the run of a point, by which the longest are begun first and memory is kept; why
            there is none. Called where points are dealt out.
        store: Where the components of all runs are put before they are dealt out, equal ones once;
            None where each point makes its own.
        observer: Called on rank 0 with each point that is done and its result.

    Returns:
        One result per point, in order; empty on other ranks.

    Raises:
        SharedFailure: A component or a point failed, on every rank of several; on rank 0 the cause says why. A
            single rank gets the error itself.
    """
    if together or comm.size == 1 or not points:
        results = []
        for point in points:
            results.append(work(point, comm, lambda: None))
            if comm.rank == 0:
                observer(point, results[-1])
        return results
    planned = make_on_root(comm, lambda: [plan(point) for point in points])
    runs = [run for run in planned if isinstance(run, PlannedRun)]
    if store is None:
        load_elastic(stage for run in runs for stage in run.plan.stages)
    else:
        prepare_components([start_run(run.scene, comm, store, plan=run.plan) for run in runs])

    def expect(run: PlannedRun | str) -> Job:
        stages = () if isinstance(run, str) else run.plan.stages
        return expect_job([stage for stage in stages if store is None or stage.component is None])

    return deal_out(
        [expect(run) for run in planned],
        lambda number, settle: work(points[number], MPI.COMM_SELF, settle),
        comm=comm,
        folder=folder,
        observer=lambda number, result: observer(points[number], result),
    )


def compute_changes[Name, Result](
    runs: Mapping[Name, PlannedRun | str],
    work: Callable[[Name, PlannedRun], Result],
    *,
    comm: MPI.Comm,
    folder: Path,
    store: Store | None = None,
) -> dict[Name, Result | str]:
    """Work on runs of a scene and of changes of it, each on one rank; collective.

    Args:
        runs: The same on every rank, the scene as written first; why there is none of a change.
        work: On one of them.
        folder: On storage that all ranks read and write.
        store: Where the components of all are put first; None where each run makes its own.

    Returns:
        What became of each, or why nothing did; empty on other ranks.

    Raises:
        HeadstockError: The scene as written failed; on several ranks the cause of a
            ``SharedFailure``.
    """
    planned = {name: run for name, run in runs.items() if isinstance(run, PlannedRun)}
    written = next(iter(runs))
    if store is not None and comm.size == 1:
        prepare_components(
            [start_run(run.scene, comm, store, plan=run.plan) for run in planned.values()]
        )

    def try_run(name: Name, comm: MPI.Comm, settle: Settle) -> Result | str:
        try:
            return work(name, planned[name])
        except HeadstockError as error:
            if name == written:
                raise
            return str(error)

    done = compute_points(
        list(planned), try_run, comm=comm, folder=folder, plan=planned.__getitem__, store=store
    )
    tried = dict(zip(planned, done, strict=False))  # on other ranks there are none
    return {
        name: run if isinstance(run, str) else tried[name] for name, run in runs.items() if done
    }


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


@contextlib.contextmanager
def scratch_store(*, cold: bool) -> Iterator[tuple[Path, Store]]:
    """Provide a folder for files that are thrown away, and the user's store, or an empty one that is
    thrown away, too.
    """
    with tempfile.TemporaryDirectory(prefix="headstock-study-") as folder:
        root = Path(folder)
        yield root / "out", Store(root / "store" if cold else default_store_root())
