"""``headstock study``: vary keys of a scene, watch results, and go on where a killed study was."""

import contextlib
import dataclasses
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
from mpi4py import MPI

from headstock.app.guard import DONE, FAILED
from headstock.app.png_images import encode_png
from headstock.app.running import require_ranks
from headstock.app.study_charts import draw_study
from headstock.app.study_listing import list_study, print_progress, print_study, study_csv
from headstock.pipeline.rank_messages import share_from_root
from headstock.pipeline.result_files import claim_output, write_output
from headstock.pipeline.results import dump_json
from headstock.pipeline.scene_errors import suggest_names
from headstock.pipeline.scene_loader import load_scene
from headstock.pipeline.study_runs import StudyJob, check_points, hash_scene, run_study
from headstock.pipeline.study_tables import StudyTable, tabulate_study


@dataclass(frozen=True)
class StudyRequest:
    """What the command line asked for."""

    scene: Path
    name: str
    output: Path | None
    variant: str | None
    overrides: tuple[str, ...]
    ranks: int | None
    cold: bool
    repeats: int | None
    retry: bool
    json_file: Path | None


def study_request(request: StudyRequest, comm: MPI.Comm) -> int:
    """Run a study on all ranks, print its table and write its files.

    Raises:
        SceneError: The scene or a varied value has problems.
        click.UsageError: The scene has no such study, or an option does not fit.
        HeadstockError: A file cannot be written.
    """
    start = time.perf_counter()
    require_ranks(request.ranks, comm)
    job = share_from_root(comm, _make_job(request) if comm.rank == 0 else None)
    folder = request.output or Path("results") / f"{request.scene.stem}-{request.name}"
    with claim_output(folder) if comm.rank == 0 else contextlib.nullcontext():
        records = run_study(job, folder, comm=comm, observer=print_progress)
        if comm.rank == 0:
            table = tabulate_study(job.study, records)
            _publish(table, folder, request)
            print_study(table, seconds=time.perf_counter() - start, folder=folder)
    failed = any(record.status == "failed" for record in records)
    return int(share_from_root(comm, FAILED if failed else DONE))


def _make_job(request: StudyRequest) -> StudyJob:
    content = hash_scene(request.scene) if request.scene.is_file() else ""
    scene = load_scene(request.scene, variant=request.variant, overrides=request.overrides)
    if request.name not in scene.studies:
        raise click.UsageError(
            f"{request.scene} has no study {request.name!r}; {suggest_names(request.name, scene.studies, what='studies')}"
        )
    study = scene.studies[request.name]
    changes: dict[str, Any] = {"cold": True} if request.cold else {}
    changes |= {"repeats": request.repeats} if request.repeats is not None else {}
    job = StudyJob(
        path=request.scene,
        study=dataclasses.replace(study, **changes),
        raw=scene.raw,
        content=content,
        variant=request.variant,
        overrides=request.overrides,
        retry=request.retry,
    )
    check_points(job)
    return job


def _publish(table: StudyTable, folder: Path, request: StudyRequest) -> None:
    """Write the files of a study beside its records."""
    listing = list_study(table, request.scene)
    write_output(folder / "study.csv", study_csv(table))
    write_output(folder / "study.json", dump_json(listing).encode())
    figure = draw_study(table)
    if figure is not None:
        write_output(folder / "study.png", encode_png(figure))
    if request.json_file is not None:
        write_output(request.json_file, dump_json(listing).encode())
