"""What may be dropped of a scene, as a variant appended to the text of its file."""

import json
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from headstock.pipeline.numbers.estimates import show_share
from headstock.scene.scene import Scene
from headstock.studies.effects import EffectTrial, switch_effect
from headstock.studies.model_influence import CLEARLY, ModelFinding
from headstock.studies.model_trials import ModelKind

VARIANT = "good_enough"
ROUNDING = 1e-6  # what moves less moves nothing


@dataclass(frozen=True)
class Drop:
    """Something to leave out.

    Attributes:
        settings: ``key=value`` overrides that leave it out.
        reason: What that moves and saves.
        influence: Largest change of any number.
    """

    settings: tuple[str, ...]
    reason: str
    influence: float


def choose_drops(
    scene: Scene, trials: Sequence[EffectTrial], findings: Sequence[ModelFinding]
) -> list[Drop]:
    """Choose what moves hardly anything: effects to leave out, and per body one model, one kind of
    interfaces and one count of modes: of those that save most, within ``CLEARLY``, that which
    moves least.

    An effect that moves nothing stays: the analyses that were run may not ask for it.
    """
    drops = [
        Drop(
            switch_effect(trial.effect, scene),
            f"{trial.effect} moves {trial.changes[0].label} by {show_share(trial.largest)}",
            trial.largest,
        )
        for trial in trials
        if trial.active and trial.advice == "leave it out" and trial.largest > ROUNDING
    ]
    taken: set[tuple[tuple[str, ...], ModelKind]] = set()
    able = [each for each in findings if each.action == "drop"]
    # a body that is not elastic any more has neither a mesh nor modes of its own
    for each in sorted(able, key=lambda each: (each.trial.kind != "elasticity", each.influence)):
        bodies = each.trial.bodies
        if {(bodies, "elasticity"), (bodies, each.trial.kind)} & taken:
            continue
        most = max(
            other.saved_share
            for other in able
            if (other.trial.bodies, other.trial.kind) == (bodies, each.trial.kind)
        )
        if each.saved_share < most - CLEARLY:
            continue
        taken.add((bodies, each.trial.kind))
        drops.append(Drop(each.trial.settings, each.verdict, each.influence))
    return drops


def keep_within(
    drops: Sequence[Drop], allowed: float, try_together: Callable[[Sequence[Drop]], float]
) -> list[Drop]:
    """Drops that move no number by more together; that which moves most alone is kept first.

    Args:
        allowed: Largest change of any number, over that number.
        try_together: Largest change by some of them.
    """
    left = sorted(drops, key=lambda drop: drop.influence)
    while left and try_together(left) > allowed:
        left.pop()
    return [drop for drop in drops if drop in left]


def append_variant(
    text: str, drops: Sequence[Drop], *, name: str, overrides: Sequence[str] = ()
) -> str:
    """The text of a scene file with a variant after it; the rest stays letter by letter.

    Args:
        drops: What the variant leaves out, each with its reason as a comment.
        overrides: ``key=value`` of the command line with which all was judged; they come first.
    """
    lines = [f"[variants.{name}]  # what `headstock effects` found to matter little"]
    written: dict[str, str] = {}
    for override in overrides:
        key, _, value = override.partition("=")
        written[key.strip()] = f"{json.dumps(key.strip())} = {_as_toml(value)}"
    for drop in drops:
        for setting in drop.settings:
            key, _, value = setting.partition("=")
            written[key] = f"{json.dumps(key)} = {value}  # {drop.reason}"
    end = "\r\n" if "\r\n" in text else "\n"
    gap = "" if text.endswith("\n") else end
    return text + gap + end + end.join([*lines, *written.values()]) + end


def name_variant(scene: Scene) -> str:
    """A name that no variant of the scene has."""
    name, number = VARIANT, 2
    while name in scene.variants:
        name, number = f"{VARIANT}_{number}", number + 1
    return name


def _as_toml(value: str) -> str:
    try:
        parsed = tomllib.loads(f"value = {value.strip()}")
    except tomllib.TOMLDecodeError:
        return json.dumps(value.strip())
    return value.strip() if list(parsed) == ["value"] else json.dumps(value.strip())
