"""``headstock plan``: what a scene calls for; nothing is computed."""

import dataclasses
import importlib

from headstock.app.actions.checking import choose_fidelity, load_chosen, use_defaults
from headstock.app.commands.scene_commands import PlanOptions
from headstock.app.terminal.console import (
    add_row,
    make_console,
    make_table,
    print_remarks,
    print_table,
    spaced,
)
from headstock.app.terminal.guard import DONE
from headstock.app.terminal.progress import show_progress
from headstock.pipeline.planning.locking import foresee_locking
from headstock.pipeline.planning.plan import Plan
from headstock.pipeline.planning.planner import plan_scene
from headstock.pipeline.planning.reductions import add_compiling
from headstock.pipeline.storage.json_texts import dump_json
from headstock.scene.analyses.lobes import require_feed_of_run

SEARCH_MODULE = "headstock.pipeline.accuracy.search"  # loads the solvers


def plan_command(options: PlanOptions) -> int:
    """Print the stages of a run."""
    chosen = use_defaults(options.chosen)
    if options.fidelity is not None:
        chosen, kept = choose_fidelity(chosen, options.fidelity)
        print_remarks(kept)
    scene = load_chosen(chosen, options.accuracy)
    require_feed_of_run(scene)
    if scene.accuracy is None:
        with show_progress() as progress:

            def announce(component: str) -> None:
                progress.end()
                progress.begin(f"survey of the mesh of {component}")

            planned = plan_scene(scene, survey=True, before_survey=announce)
    else:
        planned = importlib.import_module(SEARCH_MODULE).plan_first_round(scene)
    planned = add_compiling(planned, scene)
    planned = dataclasses.replace(planned, warnings=(*planned.warnings, *foresee_locking(scene)))
    _print_plan(scene.name, planned)
    options.write_json(dump_json(_list_stages(planned)))
    return DONE


def _list_stages(plan: Plan) -> list[dict[str, object]]:
    """Return one row per stage, with the keys of ``summary.json`` and the estimates."""
    return [
        {
            "stage": stage.kind,
            "component": stage.component,
            "pose": stage.pose,
            "reason": stage.reason,
            "estimated_dofs": stage.estimated_dofs,
            "estimated_seconds": None
            if stage.estimated_seconds is None
            else round(stage.estimated_seconds, 2),
            "estimated_memory_mb": None
            if stage.estimated_memory_mb is None
            else round(stage.estimated_memory_mb, 1),
        }
        for stage in plan.stages
    ]


def _print_plan(name: str, plan: Plan) -> None:
    """Print the stages of a plan with their reasons and estimates."""
    console = make_console()
    table = make_table("stage", "component", "pose", ">dofs ≈", ">MB ≈", ">CPU s ≈", "reason")
    for stage in plan.stages:
        dofs = "" if stage.estimated_dofs is None else spaced(stage.estimated_dofs)
        memory = (
            "" if stage.estimated_memory_mb is None else spaced(round(stage.estimated_memory_mb))
        )
        seconds = "" if stage.estimated_seconds is None else f"{stage.estimated_seconds:.2g}"
        add_row(
            table,
            stage.kind,
            stage.component or "",
            stage.pose or "",
            dofs,
            memory,
            seconds,
            stage.reason,
        )
    print_table(console, f"{name}: planned stages", table)
    print_remarks(plan.warnings)
