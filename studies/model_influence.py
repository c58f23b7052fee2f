"""What each part of a machine's model moves and costs: the scene as written, and once per change of
its model; what to do about each.
"""

import contextlib
import shutil
import tempfile
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path
from typing import Literal

import numpy as np

from headstock.geometry.errors import HeadstockError
from headstock.geometry.frames import FloatArray
from headstock.pipeline.accuracy.followed import ComparedMachine, MachineFamily, follow_numbers
from headstock.pipeline.answers.frf import PoseResponse
from headstock.pipeline.numbers.estimates import show_share
from headstock.pipeline.numbers.numbers import Number, Numbers, make_key
from headstock.pipeline.planning.plan import StageRecord
from headstock.pipeline.results.results import Results
from headstock.pipeline.runner import gather_results, run_stages
from headstock.pipeline.stages.frf import prepare_response
from headstock.pipeline.stages.run_state import MachineParts
from headstock.pipeline.stages.shared_components import (
    load_elastic,
    make_superelements,
    start_run,
)
from headstock.pipeline.storage.provenance import SceneChoice
from headstock.pipeline.storage.store import Store
from headstock.reduction.motions.mode_naming import name_modes
from headstock.scene.expansion.overrides import AS_WRITTEN
from headstock.solvers.linear.frequency_response import evaluate_frf
from headstock.solvers.mpi import MPI
from headstock.solvers.ranks import make_on_root
from headstock.solvers.shared_work import use_threads
from headstock.studies.kind_changes import LITTLE, MUCH, Change, compare_kinds
from headstock.studies.model_trials import (
    MODEL_KINDS,
    ModelKind,
    ModelTrial,
    are_alike,
    list_model_trials,
)
from headstock.studies.points import (
    PlannedRun,
    compute_changes,
    load_choice,
    plan_run,
    repeat_quick,
    try_plan,
)

# of the drive points' responses: what symmetry makes zero is left with this of an uneven mesh
NEGLIGIBLE = 1e-3
FAR = 2.0  # times its frequency from which a mode of the same shape is another one
CLEARLY = 0.05  # share of the time from which a change of it counts
QUICK = 1.0  # what takes less is repeated, for the least of its times [s]
WARM_UP = 30.0  # a component that is expected to take longer is not made beforehand [s]
Action = Literal["keep", "third digit", "drop", "either", "take", "enough", "matters", "not tried"]


@dataclass(frozen=True)
class _FollowedModel:
    """What another model says of the modes and responses of a machine.

    Attributes:
        numbers: Frequencies under the keys of the machine as written.
        missing: Modes of the machine as written that the model lacks within an octave, each with its
            frequency.
        added: Modes of the model, below the highest of the machine as written, that this lacks.
        lines: Of each response, the line that is furthest off.
    """

    numbers: list[Number] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)
    added: list[str] = field(default_factory=list)
    lines: list[Change] = field(default_factory=list)


def _follow_model(
    written: Results, family: MachineFamily, model: ComparedMachine
) -> _FollowedModel:
    """Return what a model says of the modes and responses of the machine as written.

    Args:
        model: The other model, of the same family.
    """
    followed = _FollowedModel()
    for modes in written.modal:
        pose, rigid = modes.pose.name, modes.rigid_count
        pairs = follow_numbers(modes, family.base, model)
        for number, hz, name in zip(
            pairs.numbers, modes.frequencies_hz[rigid:], modes.mode_names[rigid:], strict=True
        ):
            if hz / FAR < number.value < hz * FAR:
                followed.numbers.append(number)
            else:
                followed.missing.append(f"{name} ({hz:.4g} Hz) in pose {pose}")
        if pairs.missing:
            others = model.watch(pose, modes.below + len(modes.frequencies_hz)).modes
            names = name_modes(model.at(pose).coupled, others).names
            followed.added.extend(
                f"{names[mode]} ({others.frequencies_hz[mode]:.4g} Hz) in pose {pose}"
                for mode in pairs.missing
            )
    followed.lines.extend(_compare_lines(response, model) for response in written.frf.values())
    return followed


def _compare_lines(response: PoseResponse, model: ComparedMachine) -> Change:
    """Return the line furthest off, over the peak of its response; what symmetry makes zero is left out."""
    curves = response.curves
    prepared = prepare_response(model.at(curves.pose))
    receptance = evaluate_frf(prepared, curves.frequencies_hz).receptance
    written_lines, other = (np.nan_to_num(values) for values in (curves.receptance, receptance))
    peaks = np.abs(written_lines).max(axis=0)
    counted = peaks > NEGLIGIBLE * np.sqrt(np.outer(peaks.max(axis=1), peaks.max(axis=0)))
    off: FloatArray = np.where(
        counted, np.abs(other - written_lines) / np.where(peaks > 0.0, peaks, 1.0), 0.0
    )
    line, output, given = (int(index) for index in np.unravel_index(np.argmax(off), off.shape))
    where = (
        f"{' '.join(curves.outputs[output])} under {' '.join(curves.inputs[given])} at "
        f"{curves.frequencies_hz[line]:.4g} Hz"
    )
    without, present = (float(abs(lines[line, output, given])) for lines in (other, written_lines))
    entry = list(response.list_series())[output * len(curves.inputs) + given]
    return Change(
        make_key("response_line", pose=curves.pose, line=where),
        float(off[line, output, given]),
        without,
        present,
        entry.unit,
    )


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
    def influence(self) -> float:
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
    def influence_over_price(self) -> float:
        """Largest change over the share of the time that it takes or saves, which counts as
        ``CLEARLY`` where it is less.
        """
        return self.influence / max(CLEARLY, abs(self.saved_share))

    @property
    def action(self) -> Action:
        """Advice: keep what is written, drop it, or take what was tried."""
        if self.obstacle:
            return "not tried"
        if self.trial.sense == "richer":
            return (
                "enough"
                if self.influence < LITTLE
                else "third digit"
                if self.influence < MUCH
                else "take"
            )
        if self.influence < LITTLE:
            return "drop" if self.saved_share >= CLEARLY else "either"
        if self.influence < MUCH:
            return "third digit"
        return "keep" if self.trial.sense == "simpler" else "matters"

    @property
    def verdict(self) -> str:
        """One sentence: what it moves most, what it costs, what to do."""
        if self.obstacle:
            return f"not tried: {self.obstacle}"
        return f"{self._describe_influence()}, {self._describe_price()}: {self._describe_action()}"

    def _describe_influence(self) -> str:
        if self.missing:
            return f"lacks {_first_of(self.missing)}"
        if self.added:
            return f"shows {_first_of(self.added)}, which the scene as written lacks"
        if self.influence == 0.0:
            return "moves nothing that was asked for"
        return f"moves {self.changes[0].label} by {show_share(self.influence)}"

    def _describe_price(self) -> str:
        share = 100.0 * abs(self.saved_share)
        if abs(self.saved_share) < CLEARLY:
            return f"within {100.0 * CLEARLY:.0f} % of the time"
        return f"{share:.0f} % {'less' if self.saved_share > 0.0 else 'more'} time"

    def _describe_action(self) -> str:
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
    base = make_on_root(comm, lambda: plan_run(load_choice(choice)))
    if trials is None:
        trials = make_on_root(comm, lambda: list_model_trials(base.scene, base.plan, kinds))
    if not trials:
        return []
    planned = make_on_root(
        comm, lambda: [try_plan(partial(load_choice, choice, trial.settings)) for trial in trials]
    )
    pairs = list(zip(trials, planned, strict=True))
    with _trial_store(comm, store) as cold:
        runs = [run for run in (base, *planned) if isinstance(run, PlannedRun)]
        load_elastic(stage for run in runs for stage in run.plan.stages)
        models = _Models(base, cold, threads=1 if comm.size > 1 else None)
        models.warm_up(announce)
        announce("components as written")
        prices = _Prices(base, _make_cold(base, comm, cold))

        def work(name: str, run: PlannedRun) -> _ModelRun:
            announce(name)
            return models.run(run)

        changes = {AS_WRITTEN: base} | {trial.name: run for trial, run in pairs}
        tried = compute_changes(changes, work, comm=comm, folder=store.root)
    return [_make_finding(trial, run, tried, prices) for trial, run in pairs if tried]


def _make_finding(
    trial: ModelTrial,
    run: PlannedRun | str,
    tried: Mapping[str, "_ModelRun | str"],
    prices: "_Prices",
) -> ModelFinding:
    """Return what a change moves and costs, or why it could not be tried.

    Args:
        run: Of the changed scene, or why there is none.
        tried: Name of a change to its run, or why there is none; of the scene as written, too.
    """
    written, other = tried[AS_WRITTEN], tried[trial.name]
    if isinstance(written, str):
        raise HeadstockError(written)
    if isinstance(run, str) or isinstance(other, str):
        return ModelFinding(trial, obstacle=str(other))
    return _compare(trial, prices, written, other, run)


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


def _make_cold(
    planned: PlannedRun,
    comm: MPI.Comm,
    store: Store,
    names: Collection[str] | None = None,
    *,
    kept: bool = True,
) -> list[StageRecord]:
    """Make components from an empty store, again where that is quick; the records of the quickest.
    Collective, empty on other ranks.

    Args:
        store: In whose folder the empty ones lie.
        names: Of the components; None for all.
        kept: Put what is made into the store.
    """

    def make(number: int) -> list[StageRecord]:
        records: list[StageRecord] = []
        with _trial_store(comm, store) as cold:
            state = start_run(planned.scene, comm, cold, plan=planned.plan)
            make_superelements(state, only=names, observer=records.append)
            if kept and number == 0:
                make_on_root(comm, lambda: _move_entries(cold, store))
        return records

    return min(repeat_quick(make, _seconds, quick=QUICK, comm=comm), key=_seconds)


def _move_entries(source: Store, target: Store) -> None:
    """Put what one store holds and the other does not into the other."""
    for path in [path for path in source.root.rglob("*") if path.is_file()]:
        moved = target.root / path.relative_to(source.root)
        if not moved.exists():
            moved.parent.mkdir(parents=True, exist_ok=True)
            path.replace(moved)


@dataclass(frozen=True, eq=False)
class _ModelRun:
    """What a model says, and the records of its stages: of the components that are not as written,
    and of the machine, the quickest of several runs.
    """

    numbers: Numbers
    followed: _FollowedModel
    records: tuple[StageRecord, ...]


class _Models:
    """Runs of models of a machine on this rank alone, beside the machine as written.

    Args:
        threads: Of BLAS in every run, so that the processor seconds of ranks compare; None for
            those there are.
    """

    def __init__(self, base: PlannedRun, store: Store, *, threads: int | None) -> None:
        self._base, self._store, self._threads = base, store, threads

    def warm_up(self, announce: Callable[[str], None]) -> None:
        """Reduce the quickest elastic component once, which loads and compiles what all take."""
        seconds = {
            stage.component: stage.estimated_seconds or 0.0
            for stage in self._base.plan.stages
            if stage.kind == "reduce"
        }
        quickest = min(seconds, key=lambda name: seconds[name], default=None)
        if quickest is not None and seconds[quickest] < WARM_UP:
            announce("loading")
            _make_cold(self._base, MPI.COMM_SELF, self._store, {quickest}, kept=False)

    @cached_property
    def _written(self) -> tuple[Results, MachineFamily]:
        return self._run(self._base), MachineFamily(self._restore(self._base))

    def run(self, planned: PlannedRun) -> "_ModelRun":
        """Run a model.

        Raises:
            HeadstockError: It, or the scene as written, cannot be run.
        """
        if self._threads is not None:
            use_threads(self._threads)
        written, family = self._written
        changed = planned.plan.components.keys() - _find_alike(self._base, planned)
        records = _make_cold(planned, MPI.COMM_SELF, self._store, changed)
        runs = repeat_quick(
            lambda number: self._run(planned),
            lambda results: _seconds(_of_machine(results.stages)),
            quick=QUICK,
            comm=MPI.COMM_SELF,
        )
        machine = min((_of_machine(results.stages) for results in runs), key=_seconds)
        followed = _follow_model(written, family, family.change(self._restore(planned)))
        return _ModelRun(runs[0].numbers, followed, (*records, *machine))

    def _restore(self, planned: PlannedRun) -> MachineParts:
        """Return the components of a model, which the store has."""
        state = start_run(planned.scene, MPI.COMM_SELF, self._store, plan=planned.plan)
        make_superelements(state)
        return state.parts

    def _run(self, planned: PlannedRun) -> Results:
        records: list[StageRecord] = []
        state = run_stages(planned.scene, MPI.COMM_SELF, self._store, observer=records.append)
        return gather_results(state, tuple(records))


def _find_alike(base: PlannedRun, other: PlannedRun) -> set[str]:
    """Return the components of another model that are as written."""
    written, parts = base.plan.components, other.plan.components
    return {name for name, part in parts.items() if are_alike(written[name], part)}


def _seconds(records: Sequence[StageRecord]) -> float:
    return sum(record.cpu_seconds for record in records)


def _of_machine(records: Sequence[StageRecord]) -> list[StageRecord]:
    return [record for record in records if record.stage.component is None]


@dataclass(frozen=True, eq=False)
class _Prices:
    """The machine as written, and the records of its components."""

    base: PlannedRun
    records: Sequence[StageRecord]

    def find(self, run: PlannedRun, records: Sequence[StageRecord]) -> RunPrice:
        """Return that of a run by the records of what is not as written, and of the machine."""
        same = _find_alike(self.base, run)
        whole = [record for record in self.records if record.stage.component in same]
        whole += records
        return RunPrice(
            _seconds(whole),
            max((record.peak_rss_mb for record in whole), default=0.0),
        )


def _compare(
    trial: ModelTrial, prices: _Prices, written: _ModelRun, tried: _ModelRun, run: PlannedRun
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
        prices.find(prices.base, written.records),
        prices.find(run, tried.records),
    )


def rank_findings(findings: Sequence[ModelFinding]) -> list[ModelFinding]:
    """Those that move most for their price come first, those that were not tried last."""
    return sorted(
        findings,
        key=lambda each: (bool(each.obstacle), -each.influence_over_price, each.trial.name),
    )
