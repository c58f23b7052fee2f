"""``headstock effects``: what each effect of a scene moves and costs, as a table and sentences."""

from collections.abc import Sequence

from headstock.studies.effect_answers import UNITS, Change
from headstock.studies.effects import EffectTrial

SHOWN = 3  # answers per effect
CLEARLY = 0.05  # share of the time from which it is told as a number


def print_trials(trials: Sequence[EffectTrial]) -> None:
    """A block per effect that moves anything, those that matter most first, then a line per effect."""
    for trial in [trial for trial in trials if trial.largest > 0.0]:
        beside = f", in both runs beside {trial.beside}" if trial.beside else ""
        times = f"{show_seconds(trial.seconds_with)} with, {show_seconds(trial.seconds_without)} without"
        print(f"\n{trial.effect} ({'named' if trial.named else 'not named'}{beside}; {times})")
        for change in [change for change in trial.changes if change.share > 0.0][:SHOWN]:
            print(f"  {change.answer:<24} {show_share(change.share):>9}   {_describe(change)}")
    print("\nin short")
    for trial in trials:
        print(f"  {tell_trial(trial)}")


def tell_trial(trial: EffectTrial) -> str:
    """One sentence: what it moves most, what it costs, what to do."""
    if trial.obstacle:
        return f"{trial.effect}: not tried: {trial.obstacle}"
    name = f"{trial.effect} beside {trial.beside}" if trial.beside else trial.effect
    if trial.largest == 0.0:
        times = f"{show_seconds(trial.seconds_with)} with, {show_seconds(trial.seconds_without)} without"
        return f"{name}: {trial.advice} ({times})"
    moved = trial.changes[0]
    cost = f"{100.0 * trial.time_share:.0f} % of run time" if trial.time_share >= CLEARLY else "hardly any time"
    return f"{name}: {show_share(moved.share)} of {moved.answer}, {cost}: {trial.advice}"


def show_seconds(seconds: float) -> str:
    """Processor time with two digits."""
    return f"{seconds:.0f} s" if seconds >= 10.0 else f"{seconds:.2g} s"


def show_share(share: float) -> str:
    """A share as per cent, with two digits."""
    percent = 100.0 * share
    if percent == 0.0:
        return "0 %"
    return f"{percent:.0f} %" if percent >= 10.0 else f"{percent:.2g} %" if percent >= 1e-3 else f"{percent:.0e} %"


def _describe(change: Change) -> str:
    unit = UNITS[change.answer]
    before, after = ("none" if value is None else f"{value:.5g}" for value in (change.without, change.present))
    return f"{before} → {after} {unit} ({change.entry})"
