"""``headstock effects``: a scene run with each effect switched the other way."""

from dataclasses import dataclass
from pathlib import Path

import click

from headstock.app.actions.effecting import print_trials
from headstock.app.actions.running import select_analyses
from headstock.app.terminal.guard import DONE
from headstock.app.terminal.progress import show_progress
from headstock.pipeline.storage.json_texts import dump_json
from headstock.pipeline.storage.outputs import write_output
from headstock.pipeline.storage.provenance import Provenance
from headstock.pipeline.storage.store import Store, default_store_root
from headstock.scene.building.loader import load_scene
from headstock.studies.effects import ScenePlan, rank_trials, summarise_trials, try_effects


@dataclass(frozen=True)
class EffectsRequest:
    """What the command line asked for."""

    plan: ScenePlan
    json_file: Path | None
    origin: Provenance | None = None


def effects_request(request: EffectsRequest) -> int:
    """Try every effect of a scene and print them, those that matter most first.

    Raises:
        SceneError: The scene has problems.
        click.UsageError: An option does not fit.
        HeadstockError: The scene cannot be run as written.
    """
    plan = request.plan
    if request.json_file is not None and not request.json_file.absolute().parent.is_dir():
        raise click.UsageError(f"there is no folder {request.json_file.parent} for --json")
    scene = load_scene(plan.path, variant=plan.variant, overrides=plan.overrides)
    select_analyses(scene, plan.analyses)
    print(f"{scene.name}: every effect switched the other way, one at a time; processor seconds, meshing and reduction not counted")
    with show_progress() as progress:
        trials = list(try_effects(plan, Store(default_store_root()), announce=lambda text: progress.begin(text, 0.0)))
    ranked = rank_trials(trials)
    print_trials(ranked)
    if request.json_file is not None:
        summary = summarise_trials(scene.name, ranked)
        if request.origin is not None:
            summary["provenance"] = request.origin.summarise()
        write_output(request.json_file, dump_json(summary).encode())
    return DONE
