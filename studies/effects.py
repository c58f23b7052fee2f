"""Changes of numbers and time by each effect of a scene: a run with it and one without it, compared by
kind; and ``effects.json``, with those by parts of its model.
"""

import functools
import itertools
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NotRequired, TypedDict

from headstock.pipeline.numbers.numbers import Numbers
from headstock.pipeline.runner import gather_results, run_stages
from headstock.pipeline.storage.provenance import ProvenanceSummary, SceneChoice
from headstock.pipeline.storage.store import Store
from headstock.scene.scene import Scene
from headstock.scene.schema.effects import EFFECT_NAMES
from headstock.solvers.mpi import MPI
from headstock.solvers.ranks import make_on_root
from headstock.solvers.shared_work import use_threads
from headstock.studies.kind_changes import LITTLE, MUCH, Change, ChangeSummary, compare_kinds
from headstock.studies.model_influence import Action, ModelFinding, RunPrice
from headstock.studies.model_trials import ModelKind
from headstock.studies.points import (
    PlannedRun,
    compute_changes,
    load_choice,
    plan_run,
    repeat_quick,
    try_plan,
)

QUICK = 3.0  # a run that takes no longer is repeated, for the least of its times [s]
# effects that act through another one
NEEDS = {
    "gravity_stiffening": "gravity",
    "regeneration": "cutting_force",
    "friction": "drive_control",
    "screw_inertia": "drive_control",
    "torque_ripple": "drive_control",
}


@dataclass(frozen=True)
class EffectTrial:
    """What an effect does.

    Attributes:
        active: Whether the scene names it.
        changes: Of each kind of numbers, the largest first.
        seconds_with: Processor time of the run with it [s].
        seconds_without: And without it [s].
        noise: By which share runs of the same scene differ in time.
        obstacle: Why it could not be tried; empty where it was.
        together_with: Effect it acts through, on in both runs though the scene does not name it;
            empty elsewhere.
    """

    effect: str
    active: bool
    changes: tuple[Change, ...] = ()
    seconds_with: float = 0.0
    seconds_without: float = 0.0
    noise: float = 0.0
    obstacle: str = ""
    together_with: str = ""

    @property
    def largest(self) -> float:
        """Largest change of any number."""
        return max((change.share for change in self.changes), default=0.0)

    @property
    def time_share(self) -> float:
        """Share of the run's processor time that the effect takes; zero where it is within the
        noise, or nothing moved.
        """
        share = 1.0 - self.seconds_without / self.seconds_with if self.seconds_with else 0.0
        return share if share > self.noise and self.largest > 0.0 else 0.0

    @property
    def advice(self) -> str:
        """Advice of a few words."""
        if self.obstacle:
            return "not tried"
        if self.largest == 0.0:
            return "moves nothing that was asked for"
        if self.largest < LITTLE:
            return "leave it out" if self.active else "rightly left out"
        if self.largest < MUCH:
            return "keep it for the third digit" if self.active else "name it for the third digit"
        return "keep it" if self.active else "name it"


def try_effects(
    choice: SceneChoice,
    store: Store,
    *,
    comm: MPI.Comm | None = None,
    announce: Callable[[str], None] = lambda text: None,
) -> list[EffectTrial]:
    """Run a scene as written, and once per effect with that effect switched the other way, each
    choice of effects on one rank; collective.

    Args:
        store: Where meshes and superelements are kept: no time of theirs is counted.
        comm: Ranks that share the runs; None for this one alone.
        announce: Called with what this rank runs.

    Returns:
        A trial per effect; empty on other ranks.

    Raises:
        SceneError: The scene as written has problems.
        HeadstockError: It cannot be run as written; on several ranks the cause of a
            ``SharedFailure``, as the other one.
    """
    comm = comm or MPI.COMM_SELF
    scene = make_on_root(comm, lambda: load_choice(choice))
    # what is set for the two runs that are compared
    pairs: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {}
    for effect in EFFECT_NAMES:
        needed = _missing_need(effect, scene)
        as_named = (f"effects.{needed}=true",) if needed else ()
        pairs[effect] = as_named, (*as_named, *switch_effect(effect, scene))
    switches = dict.fromkeys([(), *itertools.chain.from_iterable(pairs.values())])
    runs = make_on_root(comm, lambda: _plan_switches(choice, scene, switches))
    if comm.size > 1 and scene.accuracy is not None:
        run_stages(scene, comm, store)  # keeps what the settings it finds take
    warm: set[str] = set()

    def work(settings: tuple[str, ...], run: PlannedRun) -> _Run:
        if comm.size > 1:
            use_threads(1)  # so that the processor seconds of ranks compare
        if not warm:
            announce("as written")
            _run(scene, store)  # loads libraries
            warm.add("libraries")
        announce(" ".join(settings) or "as written")
        done = repeat_quick(
            lambda number: _run(run.scene, store),
            lambda run: run[1],
            quick=QUICK,
            least=1 if settings else 2,
            comm=MPI.COMM_SELF,
        )
        return _Run(done[0][0], [seconds for _, seconds in done])

    tried = compute_changes(runs, work, comm=comm, folder=store.root, store=store)
    return [_compare_runs(effect, scene, pairs[effect], tried) for effect in pairs if tried]


def _plan_switches(
    choice: SceneChoice, scene: Scene, switches: Iterable[tuple[str, ...]]
) -> dict[tuple[str, ...], PlannedRun | str]:
    return {
        settings: try_plan(functools.partial(load_choice, choice, settings))
        if settings
        else plan_run(scene)
        for settings in switches
    }


def _compare_runs(
    effect: str,
    scene: Scene,
    pair: tuple[tuple[str, ...], tuple[str, ...]],
    tried: Mapping[tuple[str, ...], "_Run | str"],
) -> EffectTrial:
    """An effect by its two runs, or by why one of them was not to be had."""
    named, written = effect in scene.effects, tried[()]
    as_named, other = (tried[settings] for settings in pair)
    if not (isinstance(written, _Run) and isinstance(as_named, _Run) and isinstance(other, _Run)):
        obstacle = next(run for run in (as_named, other) if isinstance(run, str))
        return EffectTrial(effect, named, obstacle=obstacle)
    without, present = (other, as_named) if named else (as_named, other)
    changes = compare_kinds(without.numbers.values(), present.numbers.values())
    return EffectTrial(
        effect,
        named,
        tuple(sorted(changes, key=lambda change: -change.share)),
        min(present.seconds),
        min(without.seconds),
        max(written.noise, as_named.noise, other.noise),
        together_with=_missing_need(effect, scene),
    )


def rank_trials(trials: Sequence[EffectTrial]) -> list[EffectTrial]:
    """Those that move numbers most come first, those that were not tried last."""
    return sorted(trials, key=lambda trial: (bool(trial.obstacle), -trial.largest, trial.effect))


def switch_effect(effect: str, scene: Scene) -> tuple[str, ...]:
    """Overrides that switch an effect the other way, and those that act through it off with it."""
    if effect not in scene.effects:
        return (f"effects.{effect}=true",)
    others = [name for name, needed in NEEDS.items() if needed == effect and name in scene.effects]
    return tuple(f"effects.{name}=false" for name in (effect, *others))


def _missing_need(effect: str, scene: Scene) -> str:
    """The effect that another one acts through, where the scene names neither; empty elsewhere."""
    need = NEEDS.get(effect, "")
    return "" if effect in scene.effects or need in scene.effects else need


@dataclass(frozen=True)
class _Run:
    """Numbers of a scene and the processor times of its runs [s]."""

    numbers: Numbers
    seconds: list[float]

    @property
    def noise(self) -> float:
        """By which share the times differ."""
        return max(self.seconds) / min(self.seconds) - 1.0


def _run(scene: Scene, store: Store) -> tuple[Numbers, float]:
    begun = time.process_time()
    state = run_stages(scene, MPI.COMM_SELF, store)
    return gather_results(state).numbers, time.process_time() - begun


class _PriceSummary(TypedDict):
    """What a model costs from an empty store."""

    cpu_seconds: float
    peak_memory_mb: float


class _ModelSummary(TypedDict):
    """What a change of the model moves and costs."""

    kind: ModelKind
    bodies: list[str]
    written: str
    tried: str
    settings: list[str]
    obstacle: str | None
    worth: float
    missing_modes: list[str]
    added_modes: list[str]
    price_as_written: _PriceSummary
    price_as_tried: _PriceSummary
    time_saved_share: float
    worth_over_price: float
    action: Action
    verdict: str
    changes: list[ChangeSummary]


class _TrialSummary(TypedDict):
    """What an effect moves and costs; of the time its share and by which share runs differ without
    any change.
    """

    effect: str
    active: bool
    together_with: str | None
    obstacle: str | None
    largest_change: float
    seconds_with: float
    seconds_without: float
    time_share: float
    time_noise: float
    advice: str
    changes: list[ChangeSummary]


class EffectsSummary(TypedDict):
    """Every effect of a scene and every change of its model, and from which change of a number on
    one matters a little or much.
    """

    scene: str
    small_change: float
    large_change: float
    effects: list[_TrialSummary]
    models: list[_ModelSummary]
    provenance: NotRequired[ProvenanceSummary]


def summarise_effects(
    scene: str, trials: Sequence[EffectTrial], findings: Sequence[ModelFinding]
) -> EffectsSummary:
    """As JSON."""
    return {
        "scene": scene,
        "small_change": LITTLE,
        "large_change": MUCH,
        "effects": [
            {
                "effect": trial.effect,
                "active": trial.active,
                "together_with": trial.together_with or None,
                "obstacle": trial.obstacle or None,
                "largest_change": trial.largest,
                "seconds_with": trial.seconds_with,
                "seconds_without": trial.seconds_without,
                "time_share": trial.time_share,
                "time_noise": trial.noise,
                "advice": trial.advice,
                "changes": [change.summarise() for change in trial.changes],
            }
            for trial in trials
        ],
        "models": [_summarise_finding(each) for each in findings],
    }


def _summarise_finding(each: ModelFinding) -> _ModelSummary:
    return {
        "kind": each.trial.kind,
        "bodies": list(each.trial.bodies),
        "written": each.trial.written,
        "tried": each.trial.tried,
        "settings": list(each.trial.settings),
        "obstacle": each.obstacle or None,
        "worth": each.influence,
        "missing_modes": list(each.missing),
        "added_modes": list(each.added),
        "price_as_written": _summarise_price(each.written),
        "price_as_tried": _summarise_price(each.tried),
        "time_saved_share": each.saved_share,
        "worth_over_price": each.influence_over_price,
        "action": each.action,
        "verdict": each.verdict,
        "changes": [change.summarise() for change in each.changes],
    }


def _summarise_price(price: RunPrice) -> _PriceSummary:
    return {"cpu_seconds": price.cpu_seconds, "peak_memory_mb": price.peak_memory_mb}
