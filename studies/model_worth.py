"""What each part of a machine's model moves and costs: the scene as written, and once per change of
its model; what to do about each.
"""

import contextlib
import importlib
import shutil
import tempfile
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from headstock.geometry.errors import HeadstockError
from headstock.pipeline.accuracy.followed import MachineFamily
from headstock.pipeline.numbers.estimates import show_share
from headstock.pipeline.numbers.numbers import Numbers
from headstock.pipeline.planning.budgets import BASE_MB
from headstock.pipeline.planning.plan import StageRecord
from headstock.pipeline.planning.resources import node_memory_bytes
from headstock.pipeline.results.results import Results
from headstock.pipeline.runner import run_scene
from headstock.pipeline.stages.components import ELASTIC_MODULE
from headstock.pipeline.stages.run_state import MachineParts
from headstock.pipeline.stages.shared_components import expect_job, make_superelements, start_run
from headstock.pipeline.storage.provenance import SceneChoice
from headstock.pipeline.storage.store import Store
from headstock.scene.reading.findings import SceneError
from headstock.solvers.mpi import MPI
from headstock.solvers.ranks import make_on_root
from headstock.solvers.shared_work import share_work, use_threads
from headstock.studies.effects import LITTLE, MUCH, load_choice
from headstock.studies.followed_models import FollowedModel, follow_model
from headstock.studies.kind_changes import Change, compare_kinds
from headstock.studies.model_trials import (
    MODEL_KINDS,
    ModelKind,
    ModelTrial,
    are_alike,
    list_model_trials,
)
from headstock.studies.shared_runs import PlannedRun, plan_run

CLEARLY = 0.05  # share of the time from which a change of it counts
QUICK, REPEATS = 1.0, 3  # what takes less is repeated, for the least of its times [s]
WARM_UP = 30.0  # a component that is expected to take longer is not made beforehand [s]
Action = Literal["keep", "third digit", "drop", "either", "take", "enough", "matters", "not tried"]


@dataclass(frozen=True)
class RunPrice:
    """What a model costs from an empty store.

    Attributes:
        cpu_seconds: Processor time of all stages, meshes and reductions included [s].
        peak_memory_mb: Most memory of any stage [MB].
    """

    cpu_seconds: float
    peak_memory_mb: float


@dataclass(frozen=True)
class ModelFinding:
    """What a change of the model moves and costs.

    Attributes:
        changes: Of each kind of numbers, the largest first.
        missing: Modes of the machine as written that it lacks.
        added: Modes that the machine as written lacks.
        obstacle: Why it could not be tried; empty where it was.
    """

    trial: ModelTrial
    changes: tuple[Change, ...] = ()
    missing: tuple[str, ...] = ()
    added: tuple[str, ...] = ()
    written: RunPrice = RunPrice(0.0, 0.0)
    tried: RunPrice = RunPrice(0.0, 0.0)
    obstacle: str = ""

    @property
    def worth(self) -> float:
        """Largest change of any number; all of it where a mode is missing or added."""
        largest = max((change.share for change in self.changes), default=0.0)
        return max(largest, 1.0) if self.missing or self.added else largest

    @property
    def saved_share(self) -> float:
        """Share of the processor time as written that the other model saves; negative where it
        costs more.
        """
        whole = self.written.cpu_seconds
        return 1.0 - self.tried.cpu_seconds / whole if whole else 0.0

    @property
    def worth_over_price(self) -> float:
        """Largest change over the share of the time that it takes or saves, which counts as
        ``CLEARLY`` where it is less.
        """
        return self.worth / max(CLEARLY, abs(self.saved_share))

    @property
    def action(self) -> Action:
        """What to do: keep what is written, drop it, or take what was tried."""
        if self.obstacle:
            return "not tried"
        if self.trial.sense == "richer":
            return (
                "enough" if self.worth < LITTLE else "third digit" if self.worth < MUCH else "take"
            )
        if self.worth < LITTLE:
            return "drop" if self.saved_share >= CLEARLY else "either"
        if self.worth < MUCH:
            return "third digit"
        return "keep" if self.trial.sense == "simpler" else "matters"

    @property
    def verdict(self) -> str:
        """One sentence: what it moves most, what it costs, what to do."""
        if self.obstacle:
            return f"not tried: {self.obstacle}"
        return f"{self._tell_worth()}, {self._tell_price()}: {self._tell_action()}"

    def _tell_worth(self) -> str:
        if self.missing:
            return f"lacks {_first_of(self.missing)}"
        if self.added:
            return f"shows {_first_of(self.added)}, which the scene as written lacks"
        if self.worth == 0.0:
            return "moves nothing that was asked for"
        return f"moves {self.changes[0].label} by {show_share(self.worth)}"

    def _tell_price(self) -> str:
        share = 100.0 * abs(self.saved_share)
        if abs(self.saved_share) < CLEARLY:
            return f"within {100.0 * CLEARLY:.0f} % of the time"
        return f"{share:.0f} % {'less' if self.saved_share > 0.0 else 'more'} time"

    def _tell_action(self) -> str:
        written, tried = self.trial.written, self.trial.tried
        return {
            "keep": f"keep {written}",
            "third digit": f"{written} gives two digits, {tried} three"
            if self.trial.sense == "richer"
            else f"keep {written} for the third digit",
            "drop": f"{tried} is enough",
            "either": "either will do",
            "take": f"take {tried}",
            "enough": f"{written} is enough",
            "matters": "take the one that is like the joint",
            "not tried": "",
        }[self.action]


def _first_of(modes: Sequence[str]) -> str:
    return modes[0] if len(modes) == 1 else f"{modes[0]} and {len(modes) - 1} more"


def try_models(
    choice: SceneChoice,
    store: Store,
    *,
    kinds: Sequence[ModelKind] = MODEL_KINDS,
    trials: Sequence[ModelTrial] | None = None,
    comm: MPI.Comm | None = None,
    announce: Callable[[str], None] = lambda text: None,
) -> list[ModelFinding]:
    """Run a scene as written, and once per change of its model, each on one rank; collective.

    Components are meshed and reduced anew in a store of their own, so that what they cost is known.

    Args:
        store: Beside it lies the store of the trials while they run.
        trials: The changes; None for all of these kinds.
        comm: Ranks that share the runs; None for this one alone.
        announce: Called with what this rank runs.

    Returns:
        A finding per change; empty on other ranks.

    Raises:
        SceneError: The scene as written has problems.
        HeadstockError: It cannot be run as written; on several ranks the cause of a
            ``SharedFailure``, as the other one.
    """
    comm = comm or MPI.COMM_SELF
    base = make_on_root(comm, lambda: plan_run(load_choice(choice, ())))
    if trials is None:
        trials = make_on_root(comm, lambda: list_model_trials(base.scene, base.plan, kinds))
    if not trials:
        return []
    planned = make_on_root(comm, lambda: [_plan(choice, trial) for trial in trials])
    runs = [base, *(each for each in planned if isinstance(each, PlannedRun))]
    names = [
        trial.name for trial, each in zip(trials, planned, strict=True) if not isinstance(each, str)
    ]
    with _trial_store(comm, store) as cold:
        reduces = [stage.kind == "reduce" for each in runs for stage in each.plan.stages]
        if make_on_root(comm, lambda: any(reduces)):
            importlib.import_module(ELASTIC_MODULE)  # PETSc starts on all ranks together
        bench = _Bench(base, cold, announce, threads=1 if comm.size > 1 else None)
        bench.warm_up()
        announce("components as written")
        records = _make_written(base, comm, cold)

        def work(number: int, settle: Callable[[], None]) -> "_ModelRun | str":
            announce(["as written", *names][number])
            return bench.run(runs[number], is_base=number == 0)

        done = share_work(
            comm,
            [expect_job(run.plan.stages) for run in runs],
            work,
            folder=store.root,
            memory_mb=node_memory_bytes() / 1e6,
            idle_mb=BASE_MB,
        )
    if not done:  # on other ranks
        return []
    written, others = done[0], iter(done[1:])
    if isinstance(written, str):
        raise HeadstockError(written)
    known = _Known(base, records)
    findings = []
    for trial, run in zip(trials, planned, strict=True):
        tried = run if isinstance(run, str) else next(others)
        findings.append(
            ModelFinding(trial, obstacle=str(tried))
            if isinstance(tried, str) or isinstance(run, str)
            else _judge(trial, known, written, tried, run)
        )
    return findings


@contextlib.contextmanager
def _trial_store(comm: MPI.Comm, store: Store) -> Iterator[Store]:
    """An empty store that all ranks reach, gone afterwards."""

    def make() -> Path:
        store.root.mkdir(parents=True, exist_ok=True)
        return Path(tempfile.mkdtemp(prefix="headstock-trials-", dir=store.root))

    root = make_on_root(comm, make)
    try:
        yield Store(root)
    finally:
        if comm.rank == 0:
            shutil.rmtree(root, ignore_errors=True)


def _make_written(base: PlannedRun, comm: MPI.Comm, store: Store) -> tuple[StageRecord, ...]:
    """Make the components as written in an empty store, again in others where that is quick; the
    records of the quickest. Collective, empty on other ranks.
    """
    runs: list[list[StageRecord]] = []

    def is_quick() -> bool:
        return _seconds(runs[-1]) < QUICK

    for number in range(REPEATS):
        with contextlib.ExitStack() as stack:
            place = store if number == 0 else stack.enter_context(_trial_store(comm, store))
            records: list[StageRecord] = []
            make_superelements(
                start_run(base.scene, comm, place, plan=base.plan), observer=records.append
            )
        runs.append(records)
        if not make_on_root(comm, is_quick):
            break
    quickest = min(runs, key=_seconds)
    return tuple(quickest)


def _move_entries(source: Store, target: Store) -> None:
    """Put what one store holds and the other does not into the other."""
    for path in [path for path in source.root.rglob("*") if path.is_file()]:
        place = target.root / path.relative_to(source.root)
        if not place.exists():
            place.parent.mkdir(parents=True, exist_ok=True)
            path.replace(place)


def _plan(choice: SceneChoice, trial: ModelTrial) -> PlannedRun | str:
    try:
        return plan_run(load_choice(choice, trial.settings))
    except (SceneError, HeadstockError) as error:
        return error.problems[0].message if isinstance(error, SceneError) else str(error)


@dataclass(frozen=True, eq=False)
class _ModelRun:
    """What a model says, and the records of its stages: of the components that are not as written,
    and of the machine, the quickest of several runs.
    """

    numbers: Numbers
    followed: FollowedModel
    records: tuple[StageRecord, ...]


class _Bench:
    """Runs models of a machine on this rank alone.

    Args:
        announce: Called with what is run.
        threads: Of BLAS in every run, so that the processor seconds of ranks compare; None for
            those there are.
    """

    def __init__(
        self,
        base: PlannedRun,
        store: Store,
        announce: Callable[[str], None],
        *,
        threads: int | None,
    ) -> None:
        self._base, self._store, self._announce = base, store, announce
        self._threads = threads
        self._written: tuple[Results, MachineFamily] | None = None

    def warm_up(self) -> None:
        """Reduce the quickest elastic component once, which loads and compiles what all take."""
        seconds = {
            stage.component: stage.estimated_seconds or 0.0
            for stage in self._base.plan.stages
            if stage.kind == "reduce"
        }
        quickest = min(seconds, key=lambda name: seconds[name], default=None)
        if quickest is not None and seconds[quickest] < WARM_UP:
            self._announce("loading")
            self._price(self._base, {quickest}, kept=False)

    def run(self, planned: PlannedRun, *, is_base: bool) -> "_ModelRun | str":
        """A model's run, or why it failed.

        Raises:
            HeadstockError: The scene as written cannot be run.
        """
        if self._threads is not None:
            use_threads(self._threads)
        if self._written is None:
            family = MachineFamily(self._restore(self._base))
            self._written = (self._run(self._base), family)
        own = self._base.plan.components
        changed = {
            name for name, part in planned.plan.components.items() if not are_alike(own[name], part)
        }
        try:
            return self._repeat(planned, self._price(planned, changed), *self._written)
        except HeadstockError as error:
            if is_base:
                raise
            return str(error)

    def _price(
        self, planned: PlannedRun, names: Collection[str], *, kept: bool = True
    ) -> list[StageRecord]:
        """Make components from an empty store, again where that is quick; the records of the
        quickest. They are ``kept`` in the store of the trials.
        """
        runs: list[list[StageRecord]] = []
        for number in range(REPEATS):
            records: list[StageRecord] = []
            with tempfile.TemporaryDirectory(prefix="cold-", dir=self._store.root) as folder:
                cold = Store(Path(folder))
                state = start_run(planned.scene, MPI.COMM_SELF, cold, plan=planned.plan)
                make_superelements(state, only=names, observer=records.append)
                if kept and number == 0:
                    _move_entries(cold, self._store)
            runs.append(records)
            if _seconds(records) >= QUICK:
                break
        return min(runs, key=_seconds)

    def _repeat(
        self,
        planned: PlannedRun,
        components: Sequence[StageRecord],
        written: Results,
        family: MachineFamily,
    ) -> _ModelRun:
        results = self._run(planned)
        runs = [results.stages]
        while len(runs) < REPEATS and _machine_seconds(results.stages) < QUICK:
            runs.append(self._run(planned).stages)
        machine = min(runs, key=_machine_seconds)
        return _ModelRun(
            results.numbers,
            follow_model(written, family, family.change(self._restore(planned))),
            (*components, *(record for record in machine if record.stage.component is None)),
        )

    def _restore(self, planned: PlannedRun) -> MachineParts:
        """Return the components of a model, which the store has."""
        state = start_run(planned.scene, MPI.COMM_SELF, self._store, plan=planned.plan)
        make_superelements(state)
        return state.parts

    def _run(self, planned: PlannedRun) -> Results:
        with tempfile.TemporaryDirectory(prefix="headstock-effects-") as folder:
            return run_scene(planned.scene, Path(folder), comm=MPI.COMM_SELF, store=self._store)


def _seconds(records: Sequence[StageRecord]) -> float:
    return sum(record.cpu_seconds for record in records)


def _machine_seconds(records: Sequence[StageRecord]) -> float:
    return _seconds([record for record in records if record.stage.component is None])


@dataclass(frozen=True, eq=False)
class _Known:
    """The machine as written, and the records of its components."""

    base: PlannedRun
    records: tuple[StageRecord, ...]

    def price(self, run: PlannedRun, records: Sequence[StageRecord]) -> RunPrice:
        """Of a run by the records of what is not as written, and of the machine."""
        own = self.base.plan.components
        same = {name for name, part in run.plan.components.items() if are_alike(own[name], part)}
        whole = [record for record in self.records if record.stage.component in same]
        whole += records
        return RunPrice(
            _seconds(whole),
            max((record.peak_rss_mb for record in whole), default=0.0),
        )


def _judge(
    trial: ModelTrial,
    known: _Known,
    written: _ModelRun,
    tried: _ModelRun,
    run: PlannedRun,
) -> ModelFinding:
    # what is written is what is present; modes are followed by their shapes
    without, present = (
        [
            *(number for number in each.numbers.values() if number.key.kind != "frequency"),
            *each.followed.numbers,
        ]
        for each in (tried, written)
    )
    changes = compare_kinds(without, present)
    if tried.followed.lines:
        changes.append(max(tried.followed.lines, key=lambda change: change.share))
    return ModelFinding(
        trial,
        tuple(sorted(changes, key=lambda change: -change.share)),
        tuple(tried.followed.missing),
        tuple(tried.followed.added),
        known.price(known.base, written.records),
        known.price(run, tried.records),
    )


def rank_findings(findings: Sequence[ModelFinding]) -> list[ModelFinding]:
    """Those that move most for their price come first, those that were not tried last."""
    return sorted(
        findings,
        key=lambda each: (bool(each.obstacle), -each.worth_over_price, each.trial.name),
    )
