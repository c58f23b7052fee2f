"""``headstock check`` and ``headstock plan``: which scene a command line asks for, what is wrong with
it, and what it calls for; nothing is computed.
"""

import dataclasses
import importlib
from collections.abc import Sequence

import click

from headstock.app.commands.scene_commands import CheckOptions, PlanOptions
from headstock.app.terminal.console import (
    add_row,
    counted,
    make_console,
    make_table,
    print_assumptions,
    print_remarks,
    print_table,
    spaced,
)
from headstock.app.terminal.guard import DONE
from headstock.app.terminal.progress import show_progress
from headstock.geometry.parts.components import Fidelity
from headstock.pipeline.planning.plan import Plan
from headstock.pipeline.planning.planner import plan_scene
from headstock.pipeline.planning.reductions import add_compiling
from headstock.pipeline.preview.doubts import check_scene
from headstock.pipeline.storage.json_texts import dump_json, dump_summary
from headstock.pipeline.storage.provenance import SceneChoice
from headstock.scene.analyses.lobes import require_feed_of_run
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.findings import SceneError
from headstock.scene.scene import Scene, deforming_parts, keep_analyses, list_analyses

SEARCH_MODULE = "headstock.pipeline.accuracy.search"  # loads the solvers


def check_command(options: CheckOptions) -> int:
    """Load a scene and say what it holds.

    Raises:
        SceneError: It has problems; they are in the JSON file too.
    """
    try:
        scene = load_chosen(options.chosen)
        warnings = check_scene(scene)
    except SceneError as error:
        _write(options, problems=[dataclasses.asdict(problem) for problem in error.problems])
        raise
    machine = scene.machine
    console = make_console()
    parts = [counted(len(machine.components), "component"), counted(len(machine.joints), "joint")]
    parts += [counted(len(machine.axes), "axis", "axes"), counted(len(machine.points), "point")]
    console.print(f"{options.scene}: ok: {scene.name}: {', '.join(parts)}", markup=False)
    print_remarks(warnings)
    print_assumptions(scene.assumptions)
    _write(options, warnings=warnings, assumptions=scene.assumptions)
    return DONE


def _write(
    options: CheckOptions,
    *,
    problems: Sequence[object] = (),
    warnings: Sequence[str] = (),
    assumptions: Sequence[str] = (),
) -> None:
    content = {
        "scene": str(options.scene),
        "ok": not problems,
        "problems": list(problems),
        "warnings": list(warnings),
        **({"assumptions": list(assumptions)} if assumptions else {}),
    }
    options.write_json(dump_summary(content))


def plan_command(options: PlanOptions) -> int:
    """Print the stages of a run."""
    chosen = options.chosen
    if options.fidelity is not None:
        chosen, kept = choose_fidelity(chosen, options.fidelity)
        print_remarks(kept)
    scene = load_chosen(chosen, options.accuracy)
    require_feed_of_run(scene)
    if scene.accuracy is None:
        with show_progress() as progress:

            def announce(component: str) -> None:
                progress.end()
                progress.begin(f"survey of the surface of {component}")

            planned = plan_scene(scene, survey=True, before_survey=announce)
    else:
        planned = importlib.import_module(SEARCH_MODULE).plan_first_round(scene)
    planned = add_compiling(planned, scene)
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


def load_chosen(chosen: SceneChoice, accuracy: str | None = None) -> Scene:
    """The scene that was chosen, with its analyses.

    Args:
        chosen: Scene, variant, settings and analyses.
        accuracy: Asked for, as written; None for that of the scene.

    Raises:
        SceneError: The scene has problems.
        click.UsageError: An analysis is none of the scene's.
    """
    scene = load_scene(chosen.path, variant=chosen.variant, overrides=chosen.overrides)
    if accuracy is not None:
        # what the scene allows beside the number stays as it is
        key = "accuracy" if scene.accuracy is None else "accuracy.to"
        scene = load_scene(
            chosen.path,
            variant=chosen.variant,
            overrides=(*chosen.overrides, f"{key}={accuracy}"),
        )
    return _select_analyses(scene, chosen.analyses)


def choose_fidelity(chosen: SceneChoice, fidelity: Fidelity) -> tuple[SceneChoice, list[str]]:
    """A scene with every part that deforms at one fidelity, and a remark on each part that cannot
    have it and keeps its own.

    Args:
        chosen: Scene, variant and settings; rigid and imported parts stay as they are there.

    Raises:
        SceneError: The scene has problems, or no part can have this fidelity.
        click.UsageError: No part deforms.
    """
    scene = load_scene(chosen.path, variant=chosen.variant, overrides=chosen.overrides)
    wanted = deforming_parts(scene)
    if not wanted:
        raise click.UsageError(
            f"--fidelity {fidelity} changes nothing in {chosen.path}: all components are rigid or imported superelements; "
            'write fidelity = "elastic" in [components.NAME] of those that deform, or --set components.NAME.fidelity=elastic'
        )
    made, remarks = _set_fidelity(chosen, wanted, fidelity), list[str]()
    try:
        load_scene(made.path, variant=made.variant, overrides=made.overrides)
    except SceneError as error:
        # the scene as chosen is sound, so every problem comes of the fidelity of some part
        refused = {
            name: problem.message
            for problem in error.problems
            for name in wanted
            if f"{problem.key}.".startswith(f"components.{name}.")
        }
        able = [name for name in wanted if name not in refused]
        if not refused or not able:
            raise
        made = _set_fidelity(chosen, able, fidelity)
        load_scene(made.path, variant=made.variant, overrides=made.overrides)
        remarks = [
            f"components.{name} keeps fidelity = "
            f'"{scene.machine.components[name].fidelity}": {message}'
            for name, message in refused.items()
        ]
    return made, remarks


def _set_fidelity(chosen: SceneChoice, names: list[str], fidelity: Fidelity) -> SceneChoice:
    settings = (f"components.{name}.fidelity={fidelity}" for name in names)
    return dataclasses.replace(chosen, overrides=(*chosen.overrides, *settings))


def _select_analyses(scene: Scene, names: tuple[str, ...]) -> Scene:
    """The scene with only the named analyses."""
    present = list_analyses(scene)
    for name in names:
        if name not in present:
            raise click.UsageError(
                f"{scene.path} has no [analyses.{name}]; it has: {', '.join(present) or 'none'}"
            )
    return keep_analyses(scene, names) if names else scene


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
