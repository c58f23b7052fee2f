"""``effects.json``: what effects and parts of the model of a scene move and cost."""

from collections.abc import Sequence
from typing import NotRequired, TypedDict

from headstock.pipeline.storage.provenance import ProvenanceSummary
from headstock.studies.effects import LITTLE, MUCH, EffectTrial
from headstock.studies.kind_changes import ChangeSummary
from headstock.studies.model_trials import ModelKind
from headstock.studies.model_worth import Action, ModelFinding, RunPrice


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
        "worth": each.worth,
        "missing_modes": list(each.missing),
        "added_modes": list(each.added),
        "price_as_written": _summarise_price(each.written),
        "price_as_tried": _summarise_price(each.tried),
        "time_saved_share": each.saved_share,
        "worth_over_price": each.worth_over_price,
        "action": each.action,
        "verdict": each.verdict,
        "changes": [change.summarise() for change in each.changes],
    }


def _summarise_price(price: RunPrice) -> _PriceSummary:
    return {"cpu_seconds": price.cpu_seconds, "peak_memory_mb": price.peak_memory_mb}
