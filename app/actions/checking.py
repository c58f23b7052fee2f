"""``headstock check``: which scene a command line asks for, and what is wrong with it."""

import dataclasses
from collections.abc import Sequence

import click

from headstock.app.commands.options import ACCEPT_DEFAULTS
from headstock.app.commands.scene_commands import CheckOptions
from headstock.app.terminal.console import (
    counted,
    make_console,
    print_assumptions,
    print_open,
    print_remarks,
)
from headstock.app.terminal.guard import DONE
from headstock.geometry.parts.components import Fidelity
from headstock.pipeline.preview.doubts import check_scene
from headstock.pipeline.storage.json_texts import dump_summary
from headstock.pipeline.storage.provenance import SceneChoice
from headstock.scene.building.loader import load_scene, read_tables
from headstock.scene.reading.findings import Findings, SceneError
from headstock.scene.scene import Scene, deforming_parts, keep_analyses, list_analyses


def check_command(options: CheckOptions) -> int:
    """Load a scene and say what it holds.

    Raises:
        SceneError: It has problems; they are in the JSON file too.
    """
    try:
        scene = load_chosen(use_defaults(options.chosen))
        warnings = check_scene(scene)
    except SceneError as error:
        _write(options, problems=[dataclasses.asdict(problem) for problem in error.problems])
        raise
    machine = scene.machine
    console = make_console()
    parts = [counted(len(machine.components), "component"), counted(len(machine.joints), "joint")]
    parts += [counted(len(machine.axes), "axis", "axes"), counted(len(machine.points), "point")]
    measuring = [bool(sensor.directions) for sensor in machine.sensors.values()]
    parts += [counted(measuring.count(True), "sensor")] * any(measuring)
    parts += [counted(measuring.count(False), "point mass", "point masses")] * (False in measuring)
    console.say(f"{options.scene}: ok: {scene.name}: {', '.join(parts)}")
    print_remarks(warnings)
    print_assumptions(scene.assumptions)
    if scene.questions:
        count = counted(sum(len(question.keys) for question in scene.questions), "value")
        print_open(f"{count} open; to answer write another value, or set one:", scene.questions)
    lists = {
        "assumptions": scene.assumptions,
        "open": [question.as_table() for question in scene.questions],
    }
    _write(options, warnings=warnings, **lists)
    return DONE


def _write(
    options: CheckOptions,
    *,
    problems: Sequence[object] = (),
    warnings: Sequence[str] = (),
    **lists: Sequence[object],
) -> None:
    content = {
        "scene": str(options.scene),
        "ok": not problems,
        "problems": list(problems),
        "warnings": list(warnings),
        **{key: list(entries) for key, entries in lists.items() if entries},
    }
    options.write_json(dump_summary(content))


def use_defaults(chosen: SceneChoice) -> SceneChoice:
    """Return what was chosen, for a command that computes nothing: open values have their defaults."""
    return dataclasses.replace(chosen, overrides=(*chosen.overrides, ACCEPT_DEFAULTS))


def load_chosen(chosen: SceneChoice, accuracy: str | None = None) -> Scene:
    """The scene that was chosen, with its analyses.

    Args:
        chosen: Scene, variant, settings and analyses.
        accuracy: Asked for, as written; None for that of the scene.

    Raises:
        SceneError: The scene has problems.
        click.UsageError: An analysis is none of the scene's.
    """
    overrides = chosen.overrides
    if accuracy is not None:
        # what the scene allows beside the number stays as it is
        findings = Findings(str(chosen.path))
        tables = read_tables(chosen.path, findings, variant=chosen.variant, overrides=overrides)
        key = "accuracy.to" if isinstance(tables.get("accuracy"), dict) else "accuracy"
        overrides = (*overrides, f"{key}={accuracy}")
    scene = load_scene(chosen.path, variant=chosen.variant, overrides=overrides)
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
