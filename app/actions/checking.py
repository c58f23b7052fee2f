"""``headstock check`` and the rows of ``headstock plan``: what is wrong with a scene, and what it
calls for; nothing is computed.
"""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import TypedDict

from headstock.app.terminal.console import counted, make_console, print_assumptions, print_remarks
from headstock.pipeline.planning.plan import Plan
from headstock.pipeline.planning.rail_meshes import find_coarse_rails
from headstock.pipeline.preview.doubts import doubt_machine
from headstock.pipeline.preview.free_motions import free_motion_warnings
from headstock.pipeline.preview.watched_numbers import find_unknown_numbers
from headstock.pipeline.storage.json_texts import dump_summary
from headstock.pipeline.storage.outputs import write_output
from headstock.pipeline.storage.part_files import find_missing_patches
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.findings import SceneError


def check_scene(
    path: Path, variant: str | None, overrides: Sequence[str], json_file: Path | None
) -> int:
    """Load a scene and say what it holds.

    Args:
        overrides: ``KEY=VALUE`` of each ``--set``.
        json_file: Where problems and warnings go too.

    Raises:
        SceneError: It has problems; they are in the JSON file too.
    """
    try:
        scene = load_scene(path, variant=variant, overrides=overrides)
        problems, remarks = find_missing_patches(scene)
        coarse, perhaps = find_coarse_rails(scene)
        if problems := problems + coarse + find_unknown_numbers(scene):
            raise SceneError(problems)
    except SceneError as error:
        found = [dataclasses.asdict(problem) for problem in error.problems]
        _write(json_file, path, problems=found)
        raise
    machine = scene.machine
    console = make_console()
    parts = [counted(len(machine.components), "component"), counted(len(machine.joints), "joint")]
    parts += [counted(len(machine.axes), "axis", "axes"), counted(len(machine.points), "point")]
    console.print(f"{path}: ok: {scene.name}: {', '.join(parts)}", markup=False)
    print_assumptions(scene.assumptions)
    lacking = [
        f"with --analysis {name}: {problem.place}: {problem.key}: {problem.message}"
        for name, problems in scene.deferred.items()
        for problem in problems
    ]
    warnings = [
        *scene.warnings,
        *lacking,
        *free_motion_warnings(scene),
        *doubt_machine(scene),
        *perhaps,
        *remarks,
    ]
    print_remarks(warnings)
    _write(json_file, path, warnings=warnings, assumptions=scene.assumptions)
    return 0


def _write(
    json_file: Path | None,
    path: Path,
    *,
    problems: Sequence[object] = (),
    warnings: Sequence[str] = (),
    assumptions: Sequence[str] = (),
) -> None:
    if json_file is not None:
        content = {
            "scene": str(path),
            "ok": not problems,
            "problems": list(problems),
            "warnings": list(warnings),
            **({"assumptions": list(assumptions)} if assumptions else {}),
        }
        write_output(json_file, dump_summary(content).encode())


class StagePlan(TypedDict):
    """A stage of a plan, with the keys of ``summary.json`` and the estimates."""

    stage: str
    component: str | None
    pose: str | None
    reason: str
    estimated_dofs: int | None
    estimated_seconds: float | None
    estimated_memory_mb: float | None


def plan_rows(plan: Plan) -> list[StagePlan]:
    """One row per stage."""
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
