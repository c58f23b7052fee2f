"""Superelements of all components, of one run or of many: those that are not in the store are dealt
out to the ranks, each is meshed and reduced on one.
"""

import importlib
import itertools
import os
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from headstock.pipeline.planning.budgets import BASE_MB
from headstock.pipeline.planning.plan import Plan, Stage, StageRecord
from headstock.pipeline.planning.planner import plan_scene
from headstock.pipeline.planning.reductions import add_kernels, list_missing_kernels
from headstock.pipeline.planning.resources import (
    RanksOnNodes,
    check_memory,
    node_memory_bytes,
)
from headstock.pipeline.stages.components import (
    COMPONENT_STAGES,
    ELASTIC_MODULE,
    StoredRequest,
    load_reduced,
    serving_keys,
    stored_request,
)
from headstock.pipeline.stages.run_state import (
    Announcer,
    Observer,
    ReducedComponent,
    RunState,
    run_stage,
)
from headstock.pipeline.stages.sensors import place_sensors
from headstock.pipeline.storage.store import Store, default_store_root
from headstock.reduction.superelement import Superelement
from headstock.scene.scene import Scene
from headstock.solvers.mpi import MPI
from headstock.solvers.ranks import find_node, make_on_root
from headstock.solvers.shared_work import Job, share_work

# A component of more dofs is split over all ranks: the factors of compact parts come near the 2^31
# entries that CHOLMOD can number
SPLIT_DOFS = int(os.environ.get("HEADSTOCK_SPLIT_DOFS", "1000000"))


def start_run(
    scene: Scene,
    comm: MPI.Comm,
    store: Store | None = None,
    *,
    plan: Plan | None = None,
    reduced: Mapping[str, ReducedComponent] | None = None,
) -> RunState:
    """Return what the stages of a scene read and add to: the one place where it is made.

    Args:
        store: By default the user's.
        plan: Of the scene, where it is already known.
        reduced: Components that are not to be made.

    Raises:
        BudgetError: A mesh or a stage would be larger than allowed.
    """
    known = plan_scene(scene) if plan is None else plan
    place = store or Store(default_store_root())
    return RunState(scene, known, comm, place, reduced=dict(reduced or {}))


@dataclass(frozen=True, eq=False)
class _SharedComponent:
    """What became of a component on the rank that reduced it.

    Attributes:
        reduced: On rank 0; elsewhere only what the store did not keep.
    """

    records: tuple[StageRecord, ...]
    warnings: tuple[str, ...]
    reduced: ReducedComponent | None


def make_superelements(
    state: RunState,
    *,
    only: Collection[str] | None = None,
    announce: Announcer = lambda stage: None,
    observer: Observer = lambda record: None,
) -> dict[str, Superelement]:
    """Run the stages of a plan that turn components into superelements; collective.

    Args:
        state: Of the run; its reduced components are added to it.
        only: Names of components; None for all.
        announce: Called with each stage before it begins, on every rank that works on it.
        observer: Called with the record of each stage as it ends, on rank 0.

    Returns:
        Superelements of all components that are reduced by now, in the order of the plan; complete
        on rank 0 only.

    Raises:
        HeadstockError: A component cannot be meshed or reduced; on several ranks the cause of a
            ``SharedFailure``.
    """
    stages = [
        stage
        for stage in state.plan.stages
        if stage.component is not None and (only is None or stage.component in only)
    ]

    def forecast(stage: Stage) -> None:
        announce(add_kernels(stage, list_missing_kernels(stage, state.plan, state.scene)))

    done = _share_components([state], [stages], forecast) if state.comm.size > 1 else {}
    for stage in stages:
        run_stage(
            state,
            stage,
            COMPONENT_STAGES[stage.kind],
            announce=forecast,
            # the work was done before; what is left is to fetch it
            observer=lambda record: observer(done.get(record.stage, record)),
        )
    make_on_root(
        state.comm, lambda: place_sensors(state, [str(stage.component) for stage in stages])
    )
    return {
        name: state.reduced[name].superelement
        for name in state.plan.components
        if name in state.reduced
    }


def prepare_components(states: Sequence[RunState]) -> None:
    """Put the superelements of many runs into the store, equal ones once; collective.

    Args:
        states: The same runs on every rank, at least one.

    Raises:
        HeadstockError: A component cannot be meshed or reduced; on several ranks the cause of a
            ``SharedFailure``.
    """
    stages = [
        [stage for stage in state.plan.stages if stage.component is not None] for state in states
    ]
    _share_components(states, stages, lambda stage: None)
    for state in states:
        large = {str(stage.component) for stage in state.plan.stages if _is_split(stage)}
        if large:
            make_superelements(state, only=large)


def load_elastic(stages: Iterable[Stage]) -> None:
    """Load the finite elements where a stage reduces with them: PETSc starts on all ranks together."""
    if any(stage.kind == "reduce" for stage in stages):
        importlib.import_module(ELASTIC_MODULE)


def expect_job(stages: Sequence[Stage]) -> Job:
    """Estimate the cost of stages that one rank runs."""
    return Job(
        sum(stage.estimated_seconds or 0.0 for stage in stages),
        max((stage.estimated_memory_mb or 0.0 for stage in stages), default=0.0),
    )


def deal_out[T](
    jobs: Sequence[Job],
    work: Callable[[int, Callable[[], None]], T],
    *,
    comm: MPI.Comm,
    folder: Path,
    observer: Callable[[int, T], None] = lambda number, result: None,
) -> list[T]:
    """Do each job on one rank, as many at once as memory lets; collective, empty on other ranks.

    Args:
        work: Takes the number of a job, and what settles others before each of its stages.
        folder: On storage that all ranks read and write.
        observer: Called on rank 0 with the number of each job that is done and its result.
    """
    return share_work(
        comm,
        jobs,
        work,
        folder=folder,
        memory_mb=node_memory_bytes() / 1e6,
        idle_mb=BASE_MB,
        observer=observer,
    )


@dataclass(frozen=True)
class _Dealt:
    """A component that one rank reduces: the number of its run, and its name there."""

    run: int
    name: str


def _share_components(
    states: Sequence[RunState], stages: Sequence[list[Stage]], announce: Announcer
) -> dict[Stage, StageRecord]:
    """Reduce what is not in the store; records of the stages on rank 0.

    Args:
        states: Of each run; what the store did not keep is added to them.
        announce: Called with each stage before it begins.
    """
    first = states[0]
    held = find_ranks(first.comm)
    dealt = make_on_root(first.comm, lambda: _list_dealt(states, stages, held))
    by_job = [[stage for stage in stages[one.run] if stage.component == one.name] for one in dealt]
    load_elastic(itertools.chain.from_iterable(by_job))

    def reduce_one(number: int, settle: Callable[[], None]) -> _SharedComponent:
        one = dealt[number]
        state = states[one.run]
        alone = start_run(state.scene, MPI.COMM_SELF, state.store, plan=state.plan)
        records: list[StageRecord] = []

        def begin(stage: Stage) -> None:
            settle()
            announce(stage)

        for stage in by_job[number]:
            run_stage(
                alone,
                stage,
                COMPONENT_STAGES[stage.kind],
                announce=begin,
                observer=records.append,
            )
        reduced = alone.reduced[one.name]
        request = stored_request(alone, state.plan.components[one.name])
        stored = not state.is_root and serving_keys(state.store, request)
        return _SharedComponent(tuple(records), tuple(alone.warnings), None if stored else reduced)

    jobs = [expect_job(own_stages) for own_stages in by_job]
    shared = deal_out(jobs, reduce_one, comm=first.comm, folder=first.store.root)
    for one, made in zip(dealt, shared, strict=False):  # none on other ranks
        state = states[one.run]
        for message in made.warnings:
            state.warn(message)
        if made.reduced is not None:
            component = state.plan.components[one.name]
            state.read[stored_request(state, component)] = made.reduced
    return {record.stage: record for made in shared for record in made.records}


def find_ranks(comm: MPI.Comm) -> RanksOnNodes:
    """Count the ranks of a run and those on a node; collective."""
    node, node_mb = find_node(comm), node_memory_bytes() / 1e6
    return RanksOnNodes(
        comm.size, comm.allreduce(node.ranks, op=MPI.MAX), comm.allreduce(node_mb, op=MPI.MIN)
    )


def _list_dealt(
    states: Sequence[RunState], stages: Sequence[list[Stage]], held: RanksOnNodes
) -> list[_Dealt]:
    """Elastic components to reduce on one rank, of equal ones the first; those to be split are left
    out.

    Raises:
        BudgetError: A component that is not in the store does not fit on a node.
    """
    missing: dict[StoredRequest, _Dealt] = {}
    small: set[_Dealt] = set()
    for run, (state, of_run) in enumerate(zip(states, stages, strict=True)):
        for stage in of_run:
            if stage.kind != "reduce":
                continue
            component = state.plan.components[str(stage.component)]
            if not load_reduced(state, component):
                missing.setdefault(stored_request(state, component), _Dealt(run, component.name))
            if not _is_split(stage):
                small.add(_Dealt(run, component.name))
        check_memory(
            [stage for stage in of_run if _Dealt(run, str(stage.component)) in missing.values()],
            state.scene.limits.memory_bytes,
            held=held,
            split_dofs=SPLIT_DOFS,
        )
    return [one for one in missing.values() if one in small]


def _is_split(stage: Stage) -> bool:
    """Whether a component is reduced on all ranks together."""
    return stage.kind == "reduce" and (stage.estimated_dofs or 0) > SPLIT_DOFS
