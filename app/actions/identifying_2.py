"""``headstock identify``: fit numbers of a scene to what was measured, and say what is known of them."""

import dataclasses
import shlex
import time
from dataclasses import dataclass
from pathlib import Path

from mpi4py import MPI

from headstock.app.actions.identifying import print_identification, print_start, print_task
from headstock.app.terminal.guard import DONE, FAILED
from headstock.pipeline.storage.json_texts import dump_json
from headstock.pipeline.storage.outputs import claim_output, write_output
from headstock.pipeline.storage.provenance import Provenance
from headstock.pipeline.storage.store import Store, default_store_root
from headstock.scene.building.loader import load_scene
from headstock.studies.identification.files import OVERRIDES_FILE, RECORD_FILE, render_overrides, summarise_identification
from headstock.studies.identification.identification import identify, prepare_problem
from headstock.studies.identification.target_files_2 import load_targets


@dataclass(frozen=True)
class IdentifyRequest:
    """What the command line asked for."""

    scene: Path
    targets: Path
    output: Path | None
    starts: int | None
    overrides: tuple[str, ...]
    json_file: Path | None


def identify_scene(request: IdentifyRequest, origin: Provenance | None = None) -> int:
    """Fit a scene to a target file, print what came out and write it; the scene is never touched.

    Raises:
        SceneError: The scene or the target file has problems.
        HeadstockError: A computation failed.
    """
    begin = time.perf_counter()
    loaded = load_targets(request.targets, request.scene, overrides=request.overrides)
    if request.starts is not None:
        settings = dataclasses.replace(loaded.task.settings, starts=request.starts)
        loaded = dataclasses.replace(loaded, task=dataclasses.replace(loaded.task, settings=settings))
    output = request.output or Path("results") / f"{request.scene.stem}-{request.targets.stem}"
    with claim_output(output, (OVERRIDES_FILE, RECORD_FILE)):
        print_task(loaded.task)
        problem = prepare_problem(loaded, Store(default_store_root()), MPI.COMM_SELF)
        found = identify(problem, loaded.task.name, print_start)
        summary = {**summarise_identification(found), "seconds": time.perf_counter() - begin}
        if origin is not None:
            summary["provenance"] = origin.summarise()
        command = _command(request, loaded.task.settings.starts, with_folders=origin is None or origin.command is not None)
        written = load_scene(request.scene, overrides=request.overrides)
        write_output(output / OVERRIDES_FILE, render_overrides(found, written, command).encode())
        write_output(output / RECORD_FILE, dump_json(summary).encode())
        if request.json_file is not None:
            write_output(request.json_file, dump_json(summary).encode())
        print_identification(found, output)
    return DONE if found.converged else FAILED


def _command(request: IdentifyRequest, starts: int, *, with_folders: bool) -> str:
    """How to get the same again."""
    files = [str(path) if with_folders else path.name for path in (request.scene, request.targets)]
    return shlex.join(
        ["./headstock", "identify", *files, "--starts", str(starts), *(f"--set={text}" for text in request.overrides)]
    )
