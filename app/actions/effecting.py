"""``headstock effects``: a scene run with each effect switched the other way; what each moves and
costs, as a table and sentences.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import click
from mpi4py import MPI

from headstock.app.actions.running import require_ranks, select_analyses
from headstock.app.terminal.guard import DONE
from headstock.app.terminal.progress import show_progress
from headstock.pipeline.results.estimates import show_share
from headstock.pipeline.storage.json_texts import dump_summary
from headstock.pipeline.storage.outputs import write_output
from headstock.pipeline.storage.provenance import Provenance, SceneChoice
from headstock.pipeline.storage.store import Store, default_store_root
from headstock.scene.building.loader import load_scene
from headstock.scene.scene import Scene
from headstock.solvers.ranks import make_on_root
from headstock.studies.answers import UNITS, Change
from headstock.studies.effects import (
    EffectTrial,
    rank_trials,
    summarise_trials,
    try_effects,
)

SHOWN = 3  # answers per effect
CLEARLY = 0.05  # share of the time from which it is shown as a number


def print_trials(trials: Sequence[EffectTrial]) -> None:
    """A block per effect that moves anything, those that matter most first, then a line per
    effect.
    """
    for trial in [trial for trial in trials if trial.largest > 0.0]:
        beside = f", in both runs beside {trial.together_with}" if trial.together_with else ""
        times = f"{show_seconds(trial.seconds_with)} with, {show_seconds(trial.seconds_without)} without"
        print(f"\n{trial.effect} ({'named' if trial.active else 'not named'}{beside}; {times})")
        for change in [change for change in trial.changes if change.share > 0.0][:SHOWN]:
            print(f"  {change.answer:<24} {show_share(change.share):>9}   {_describe(change)}")
    print("\nSummary")
    for trial in trials:
        print(f"  {tell_trial(trial)}")


def tell_trial(trial: EffectTrial) -> str:
    """One sentence: what it moves most, what it costs, what to do."""
    if trial.obstacle:
        return f"{trial.effect}: not tried: {trial.obstacle}"
    name = f"{trial.effect} beside {trial.together_with}" if trial.together_with else trial.effect
    if trial.largest == 0.0:
        times = f"{show_seconds(trial.seconds_with)} with, {show_seconds(trial.seconds_without)} without"
        return f"{name}: {trial.advice} ({times})"
    moved = trial.changes[0]
    cost = (
        f"{100.0 * trial.time_share:.0f} % of run time"
        if trial.time_share >= CLEARLY
        else "hardly any time"
    )
    return f"{name}: {show_share(moved.share)} of {moved.answer}, {cost}: {trial.advice}"


def show_seconds(seconds: float) -> str:
    """Processor time with two digits."""
    return f"{seconds:.0f} s" if seconds >= 10.0 else f"{seconds:.2g} s"


def _describe(change: Change) -> str:
    unit = UNITS[change.answer]
    before, after = (
        "none" if value is None else f"{value:.5g}" for value in (change.without, change.present)
    )
    return f"{before} → {after} {unit} ({change.entry})"


@dataclass(frozen=True, kw_only=True)
class EffectsRequest:
    """What the command line asked for."""

    scene: SceneChoice
    ranks: int | None = None
    json_file: Path | None = None
    origin: Provenance | None = None


def effects_request(request: EffectsRequest, comm: MPI.Comm) -> int:
    """Try every effect of a scene on all ranks and print them, those that matter most first.

    Raises:
        SceneError: The scene has problems.
        click.UsageError: An option does not fit.
        HeadstockError: The scene cannot be run as written.
    """
    chosen, store = request.scene, Store(default_store_root())
    require_ranks(request.ranks, comm)
    scene = make_on_root(comm, lambda: _load(request))
    if comm.rank > 0:
        try_effects(chosen, store, comm=comm)
        return make_on_root(comm, lambda: DONE)
    print(
        f"{scene.name}: each effect switched on or off, one at a time; processor seconds without meshing and reduction"
    )
    with show_progress() as progress:
        trials = try_effects(
            chosen, store, comm=comm, announce=lambda text: progress.begin(text, 0.0)
        )
    return make_on_root(comm, lambda: _publish(request, scene.name, rank_trials(trials)))


def _load(request: EffectsRequest) -> Scene:
    if request.json_file is not None and not request.json_file.absolute().parent.is_dir():
        raise click.UsageError(f"there is no folder {request.json_file.parent} for --json")
    chosen = request.scene
    scene = load_scene(chosen.path, variant=chosen.variant, overrides=chosen.overrides)
    return select_analyses(scene, chosen.analyses)


def _publish(request: EffectsRequest, name: str, ranked: Sequence[EffectTrial]) -> int:
    print_trials(ranked)
    if request.json_file is not None:
        summary = summarise_trials(name, ranked)
        if request.origin is not None:
            summary["provenance"] = request.origin.summarise()
        write_output(request.json_file, dump_summary(summary).encode())
    return DONE
