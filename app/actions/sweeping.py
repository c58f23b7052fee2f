"""``headstock sweep``: the analyses of a scene in every pose of a sweep, or the share of one task
of an array job.
"""

import dataclasses
import itertools
import re
import time
from pathlib import Path

import click

from headstock.app.actions.cluster_jobs import ClusterRequest, sweep_on_slurm
from headstock.app.actions.running import claim_on_root, require_ranks
from headstock.app.charts.sweep import draw_sweep
from headstock.app.commands.batch_commands import SweepOptions
from headstock.app.report.pages import render_sweep
from headstock.app.tables.sweep_quantities import tabulate_sweep
from headstock.app.tables.table import encode_csv
from headstock.app.terminal.console import (
    counted,
    make_console,
    print_remarks,
    warn_of_unused_accuracy,
)
from headstock.app.terminal.guard import DONE, FAILED
from headstock.app.terminal.summary import print_stage
from headstock.app.terminal.sweep import print_sweep, print_sweep_header
from headstock.pipeline.numbers.folders import NUMBERS_FILE, encode_tables
from headstock.pipeline.results.files import REPORT_FILE
from headstock.pipeline.storage.json_texts import dump_json, dump_summary
from headstock.pipeline.storage.outputs import (
    prepare_output,
    write_named_files,
    write_output,
)
from headstock.pipeline.storage.provenance import Provenance
from headstock.scene.analyses.frf import FrfRequest
from headstock.scene.analyses.lobes import LobesRequest
from headstock.scene.analyses.modal import ModalRequest
from headstock.scene.analyses.static import StaticRequest
from headstock.scene.building.loader import load_scene, prepare_sweep
from headstock.scene.scene import require_name
from headstock.solvers.mpi import MPI
from headstock.solvers.ranks import make_on_root, share_from_root
from headstock.studies.sweeps.files import SWEEP_FILE, summarise_sweep, write_sweep
from headstock.studies.sweeps.journals import FOLDER, remove_other_journals
from headstock.studies.sweeps.results import SweepResults, name_tracked_modes
from headstock.studies.sweeps.runs import (
    Part,
    SweepJob,
    gather_sweep,
    run_sweep,
    select_analyses,
    sweep_key,
)
from headstock.studies.sweeps.slurm import SlurmError

ARRAY_TASKS = 4
SUMMARY, CSV_FILE, ORIGIN_FILE = "sweep.json", "sweep.csv", "provenance.json"


def _read_part(text: str | None) -> Part:
    """Read ``2/3`` as the second of three parts; ``0/3`` has no poses.

    Raises:
        click.UsageError: The text is no part.
    """
    if text is None:
        return Part()
    found = re.fullmatch(r"(\d{1,6})/(\d{1,6})", text)
    if found is None or not 0 <= int(found[1]) <= int(found[2]):
        raise click.UsageError(f"--part {text[:40]!r} is no part; write for example 2/3")
    return Part(int(found[1]), int(found[2]))


def _compute_part(job: SweepJob, key: str | None, comm: MPI.Comm) -> int:
    """Compute the poses of one part that are in no journal yet.

    Args:
        job: The sweep, with the part to compute.
        key: Of the sweep that was submitted; None where nobody submitted it.

    Raises:
        SlurmError: What is computed here is not what was submitted.
        HeadstockError: A component cannot be reduced, or a journal cannot be written.
    """
    if comm.rank == 0:
        prepare_output(job.folder)
        if key is not None and sweep_key(job.scene) != key:
            raise SlurmError(
                "the scene, its files, this program or its libraries have changed since the job was submitted, or are others on this "
                "node; submit again, from a checkout and an environment that the nodes share"
            )
    share_from_root(comm, True)
    outcome = run_sweep(job, comm=comm, observer=print_stage)
    if comm.rank == 0:
        poses = counted(outcome.computed, "pose")
        make_console().say(
            f"part {job.part.number} of {job.part.of}: {poses} computed, {counted(comm.size, 'rank')}"
        )
    return DONE


def sweep_command(options: SweepOptions, comm: MPI.Comm) -> int:
    """Run a sweep on all ranks, print what it found and write its files, and beside them where they
    come from.

    Raises:
        SceneError: The scene or a pose of the sweep has problems, or it has no such sweep.
        click.UsageError: An option does not fit.
        HeadstockError: A component cannot be reduced, or a file cannot be written.
    """
    start, origin = time.perf_counter(), options.trace(comm.size)
    if options.on is not None:
        return _sweep_elsewhere(options, comm)
    require_ranks(options.ranks, comm)
    job = make_on_root(comm, lambda: _make_job(options))
    if options.part is not None:
        return _compute_part(job, options.key, comm)
    files = (SWEEP_FILE, SUMMARY, CSV_FILE, NUMBERS_FILE, ORIGIN_FILE, REPORT_FILE)
    with claim_on_root(comm, job.folder, files, (FOLDER,)):
        if comm.rank == 0:
            print_sweep_header(job, ranks=comm.size)
        outcome = run_sweep(job, comm=comm, observer=print_stage)
        results = None
        if comm.rank == 0:
            results = name_tracked_modes(outcome.parts, gather_sweep(job, outcome))
            _write_numbers(results, options, job.folder, origin)
        figures = _draw_together(comm, results)
        failed = False
        if results is not None:
            remarks = _write_pictures(results, figures, job.folder, origin)
            remove_other_journals(job.folder, results.key)
            print_sweep(
                results,
                computed=outcome.computed,
                seconds=time.perf_counter() - start,
                folder=job.folder,
            )
            print_remarks(remarks)
            failed = bool(results.failed)
    return int(share_from_root(comm, FAILED if failed else DONE))


def _sweep_elsewhere(options: SweepOptions, comm: MPI.Comm) -> int:
    here = dataclasses.replace(
        options, on=None, tasks=None, partition=None, time_limit=None, sbatch=None, no_wait=False,
        ranks=None, retry=False,
    )  # fmt: skip
    words = [word for text in options.set_ or () for word in ("--set", text)]
    words += ["--variant", options.variant] if options.variant else []
    words += ["--retry"] if options.retry else []
    cluster = ClusterRequest(
        options=options.describe_job(options.tasks or ARRAY_TASKS, options.ranks),
        arguments=tuple(words),
        retry=options.retry,
        wait=not options.no_wait,
    )
    return sweep_on_slurm(_make_job(options), cluster, comm, lambda: sweep_command(here, comm))


def _draw_together(comm: MPI.Comm, results: SweepResults | None) -> dict[str, bytes]:
    """Pictures of a sweep by name, on rank 0; every rank draws its share; collective.

    Args:
        results: On rank 0.
    """
    shared = share_from_root(comm, results and results.without_shapes())
    share = draw_sweep(shared, slice(comm.rank, None, comm.size))
    shares = [each.items() for each in comm.gather(share) or ()]
    # dealt out in turn, so taken back in turn
    return dict(filter(None, itertools.chain.from_iterable(itertools.zip_longest(*shares))))


def _write_numbers(
    results: SweepResults, options: SweepOptions, folder: Path, origin: Provenance | None
) -> None:
    """Write the results of a sweep, and where they come from."""
    summary = summarise_sweep(results)
    words = None if origin is None else origin.summarise()
    if words is not None:
        # apart from the results, which are the same bytes whenever and wherever they are computed
        write_output(folder / ORIGIN_FILE, dump_json(words).encode())
    write_sweep(folder, results)
    write_output(folder / NUMBERS_FILE, encode_tables({"": results.numbers}))
    write_output(folder / SUMMARY, dump_summary(summary).encode())
    # there alone, without a file of its origin beside it
    options.write_json(dump_summary(summary if words is None else {**summary, "provenance": words}))
    write_output(folder / CSV_FILE, encode_csv(tabulate_sweep(results)))


def _write_pictures(
    results: SweepResults, figures: dict[str, bytes], folder: Path, origin: Provenance | None
) -> list[str]:
    """Write pictures and page of a sweep; remarks for the user."""
    remarks = write_named_files(folder, {f"{name}.png": image for name, image in figures.items()})
    words = None if origin is None else origin.summarise()
    write_output(folder / REPORT_FILE, render_sweep(results, figures, words).encode())
    return remarks


def _make_job(options: SweepOptions) -> SweepJob:
    chosen = options.chosen
    scene = load_scene(chosen.path, variant=chosen.variant, overrides=chosen.overrides)
    require_name(scene, "sweeps", options.name, scene.sweeps)
    scene = prepare_sweep(scene, options.name, overrides=chosen.overrides)
    if (
        StaticRequest not in scene.analyses
        and ModalRequest not in scene.analyses
        and FrfRequest not in scene.analyses
        and LobesRequest not in scene.analyses
    ):
        raise click.UsageError(
            f"{chosen.path} asks for nothing to compute in a pose; write [analyses.static] or [analyses.modal]"
        )
    warn_of_unused_accuracy(scene)
    stem = "-".join(filter(None, [chosen.path.stem, options.name, chosen.variant]))
    folder = options.output or Path("results") / stem
    return SweepJob(
        select_analyses(scene),
        scene.sweeps[options.name],
        folder,
        _read_part(options.part),
        options.retry,
    )
