"""``headstock check``: what is wrong with a scene, and nothing else."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

from headstock.app.console import make_console
from headstock.pipeline.result_files import write_output
from headstock.pipeline.results import dump_json
from headstock.pipeline.scene_errors import SceneError
from headstock.pipeline.scene_loader import load_scene


def check_scene(path: Path, variant: str | None, overrides: Sequence[str], json_file: Path | None) -> int:
    """Load a scene and say what it holds.

    Raises:
        SceneError: It has problems; they are in the JSON file too.
    """
    try:
        scene = load_scene(path, variant=variant, overrides=overrides)
    except SceneError as error:
        _write(json_file, path, [dataclasses.asdict(problem) for problem in error.problems], ())
        raise
    machine = scene.machine
    console = make_console()
    counts = {name: len(getattr(machine, name)) for name in ("components", "joints", "axes", "points")}
    parts = ", ".join(f"{count} {name}" for name, count in counts.items())
    console.print(f"{path}: ok: {scene.name}: {parts}")
    for warning in scene.warnings:
        console.print(f"warning: {warning}", style="yellow")
    _write(json_file, path, [], scene.warnings)
    return 0


def _write(json_file: Path | None, path: Path, problems: Sequence[object], warnings: Sequence[str]) -> None:
    if json_file is not None:
        content = {"scene": str(path), "ok": not problems, "problems": list(problems), "warnings": list(warnings)}
        write_output(json_file, dump_json(content).encode())
