"""Superelements of all components: those that are not in the store are dealt out to the ranks, each
is meshed and reduced on one.
"""

import importlib
import os
from collections.abc import Callable, Collection
from dataclasses import dataclass

from mpi4py import MPI

from headstock.pipeline.planning.budgets import BASE_MB
from headstock.pipeline.planning.node_memory import (
    RanksOnNodes,
    check_memory,
    node_memory_bytes,
)
from headstock.pipeline.planning.plan import Stage, StageRecord
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
from headstock.reduction.superelement import Superelement
from headstock.solvers.ranks import find_node, make_on_root
from headstock.solvers.shared_work import Job, share_work

# A component of more dofs is split over all ranks: the factors of compact parts come near the 2^31
# entries that CHOLMOD can number
SPLIT_DOFS = int(os.environ.get("HEADSTOCK_SPLIT_DOFS", "1000000"))


@dataclass(frozen=True, eq=False)
class SharedComponent:
    """What became of a component on the rank that reduced it.

    Attributes:
        records: Of its stages.
        warnings: Of them.
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
    done = _share_components(state, stages, announce) if state.comm.size > 1 else {}
    for stage in stages:
        run_stage(
            state,
            stage,
            COMPONENT_STAGES[stage.kind],
            announce=announce,
            # the work was done before; what is left is to fetch it
            observer=lambda record: observer(done.get(record.stage, record)),
        )
    return {
        name: state.reduced[name].superelement
        for name in state.plan.components
        if name in state.reduced
    }


def _share_components(
    state: RunState, stages: list[Stage], announce: Announcer
) -> dict[Stage, StageRecord]:
    """Reduce what is not in the store; records of the stages on rank 0."""
    node, node_mb = find_node(state.comm), node_memory_bytes() / 1e6
    held = RanksOnNodes(
        state.comm.size,
        state.comm.allreduce(node.ranks, op=MPI.MAX),
        state.comm.allreduce(node_mb, op=MPI.MIN),
    )
    names = make_on_root(state.comm, lambda: _list_dealt(state, stages, held))
    if names:
        # PETSc starts on all ranks together
        importlib.import_module(ELASTIC_MODULE)
    by_name = {name: [stage for stage in stages if stage.component == name] for name in names}

    def reduce_one(number: int, settle: Callable[[], None]) -> SharedComponent:
        alone = RunState(state.scene, state.plan, MPI.COMM_SELF, state.store)
        records: list[StageRecord] = []

        def begin(stage: Stage) -> None:
            settle()
            announce(stage)

        for stage in by_name[names[number]]:
            run_stage(
                alone,
                stage,
                COMPONENT_STAGES[stage.kind],
                announce=begin,
                observer=records.append,
            )
        reduced = alone.reduced[names[number]]
        request = stored_request(alone, state.plan.components[names[number]])
        stored = not state.is_root and serving_keys(state.store, request)
        return SharedComponent(tuple(records), tuple(alone.warnings), None if stored else reduced)

    shared = share_work(
        state.comm,
        [_expect(by_name[name]) for name in names],
        reduce_one,
        folder=state.store.root,
        memory_mb=node_mb,
        idle_mb=BASE_MB,
    )
    for name, made in zip(names, shared, strict=False):  # none on other ranks
        for message in made.warnings:
            state.warn(message)
        if made.reduced is not None:
            component = state.plan.components[name]
            state.read[stored_request(state, component)] = made.reduced
    return {record.stage: record for made in shared for record in made.records}


def _list_dealt(state: RunState, stages: list[Stage], held: RanksOnNodes) -> list[str]:
    """Elastic components to reduce on one rank, of equal ones the first; those to be split are left
    out.

    Raises:
        BudgetError: A component that is not in the store does not fit on a node.
    """
    missing: dict[StoredRequest, str] = {}
    reduced = [stage for stage in stages if stage.kind == "reduce"]
    for stage in reduced:
        component = state.plan.components[str(stage.component)]
        if not load_reduced(state, component):
            missing.setdefault(stored_request(state, component), component.name)
    check_memory(
        [stage for stage in stages if stage.component in missing.values()],
        state.scene.limits.memory_bytes,
        held=held,
        split_dofs=SPLIT_DOFS,
    )
    small = {stage.component for stage in reduced if (stage.estimated_dofs or 0) <= SPLIT_DOFS}
    return [name for name in missing.values() if name in small]


def _expect(stages: list[Stage]) -> Job:
    return Job(
        sum(stage.estimated_seconds or 0.0 for stage in stages),
        max(stage.estimated_memory_mb or 0.0 for stage in stages),
    )
