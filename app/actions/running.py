"""``headstock run``: from a scene file to results, a printed summary and a report."""

import contextlib
import dataclasses
import os
import time
from collections.abc import Iterable, Iterator
from pathlib import Path

import click

from headstock.app.actions.checking import choose_fidelity, load_chosen
from headstock.app.commands.options import find_command_line, trace_command
from headstock.app.commands.scene_commands import RunOptions
from headstock.app.report.marks import is_published, mark_report
from headstock.app.terminal.console import counted, print_remarks
from headstock.app.terminal.guard import DONE, FAILED
from headstock.app.terminal.progress import show_progress
from headstock.app.terminal.summary import print_header, print_stage, print_summary
from headstock.geometry.parts.solids import MeshFile, StepFile
from headstock.pipeline.numbers.folders import RESULTS_FILE, SUMMARY_FILE
from headstock.pipeline.planning.analyses import load_named
from headstock.pipeline.planning.budgets import BASE_MB
from headstock.pipeline.planning.plan import Stage, StageRecord
from headstock.pipeline.preview.doubts import free_motion_warnings
from headstock.pipeline.results.files import PUBLISHED, REPORT_FILE
from headstock.pipeline.results.mode_files import VOLUME_FOLDER
from headstock.pipeline.results.results import Results
from headstock.pipeline.results.summary import summarise
from headstock.pipeline.runner import run_scene
from headstock.pipeline.stages.run_state import Announcer, Observer
from headstock.pipeline.storage.json_texts import dump_summary
from headstock.pipeline.storage.outputs import claim_output
from headstock.pipeline.storage.provenance import Provenance
from headstock.scene.scene import Scene
from headstock.solvers.mpi import MPI
from headstock.solvers.ranks import find_node, make_on_root, share_from_root
from headstock.solvers.shared_work import NAMED_THREADS, free_cores

DRAWING_SECONDS = 4.0


def run_command(options: RunOptions, comm: MPI.Comm) -> int:
    """Run a scene on all ranks and print what came out; where it comes from is written with it.

    Raises:
        SceneError: The scene has problems.
        click.UsageError: An option does not fit.
        HeadstockError: A computation failed.
    """
    line, start = find_command_line(), time.perf_counter()
    chosen, wanted = options.chosen, options.fidelity
    if wanted is not None:
        chosen, kept = make_on_root(comm, lambda: choose_fidelity(options.chosen, wanted))
        if comm.rank == 0:
            print_remarks(kept)
    asked = () if options.accuracy is None else (f"accuracy={options.accuracy}",)
    traced = dataclasses.replace(chosen, overrides=(*chosen.overrides, *asked))
    origin = trace_command(traced, ranks=comm.size, with_host=not options.no_host)
    require_ranks(options.ranks, comm)
    if options.json is not None and not options.json.absolute().parent.is_dir():
        raise click.UsageError(f"there is no folder {options.json.parent} for --json")
    scene = make_on_root(comm, lambda: load_chosen(chosen, options.accuracy))
    parts = filter(None, [scene.path.stem, options.variant, options.fidelity])
    output = options.output or Path("results") / "-".join(parts)
    files = (RESULTS_FILE, SUMMARY_FILE, REPORT_FILE)
    with claim_on_root(comm, output, files, (*PUBLISHED, VOLUME_FOLDER)):
        said = free_motion_warnings(scene) if comm.rank == 0 else ()
        if comm.rank == 0:
            print_header(scene, ranks=comm.size)
            print_remarks(said)
        results = _run_with_progress(scene, output, comm, volume=options.volume, origin=origin)
        if comm.rank == 0:
            remarks = _publish(output, results, figures=not options.no_figures)
            options.write_json(dump_summary(summarise(results)))
            print_remarks(remarks)
            seconds = time.perf_counter() - start if line is None else line.seconds
            print_summary(results, seconds=seconds, folder=output, said=said)
    return int(share_from_root(comm, FAILED if results.failures else DONE))


def _publish(folder: Path, results: Results, *, figures: bool) -> list[str]:
    """Write report, tables, modes and pictures, where those of the last run are not the same; remarks
    for the user.
    """
    if is_published(folder, mark_report(folder, results, figures=figures)):
        return []
    with show_progress() as progress:
        progress.begin("report", DRAWING_SECONDS if figures else 0.0)
        # templates and pictures, a fifth of a second
        publish = load_named("headstock.app.actions.publishing:publish_run")
        remarks: list[str] = publish(folder, results, figures=figures)
    return remarks


@contextlib.contextmanager
def claim_on_root(
    comm: MPI.Comm, folder: Path, names: Iterable[str] = (), parts: Iterable[str] = ()
) -> Iterator[None]:
    """Keep other runs out of an output folder while the body runs; collective.

    Args:
        names: Of files that will be written there whatever is computed.
        parts: Names of the folders in it that may be written into.

    Raises:
        OutputError: It is not to be had, as ``claim_output`` says; on several ranks the cause of a
            ``SharedFailure``.
    """
    with contextlib.ExitStack() as claims:
        make_on_root(comm, lambda: claims.enter_context(claim_output(folder, names, parts)))
        yield


def require_ranks(ranks: int | None, comm: MPI.Comm) -> None:
    """Refuse a number of ranks that nobody started; say what more ranks than free cores cost.

    Raises:
        click.UsageError: The job has another number of ranks.
    """
    if ranks is not None and ranks != comm.size:
        raise click.UsageError(
            f"--ranks {ranks} was asked for and {comm.size} run; start through ./headstock, which starts the ranks"
        )
    if comm.size == 1:
        return
    here, cores = find_node(comm).ranks, free_cores()
    threads = int(os.environ.get(NAMED_THREADS, "1"))
    if comm.rank == 0 and here * threads > cores:
        print_remarks([_describe_crowd(here, threads, cores)])


def _describe_crowd(ranks: int, threads: int, cores: int) -> str:
    """Say what it costs that there are more ranks on a node, or threads of them all, than free cores."""
    if ranks <= cores:
        return (
            f"{ranks} ranks with {threads} threads each (HEADSTOCK_THREADS) on {counted(cores, 'free core')}: poses and other "
            f"small pieces of work take several times as long as with HEADSTOCK_THREADS={max(1, cores // ranks)}"
        )
    return (
        f"{ranks} ranks on {counted(cores, 'free core')} take turns: what is dealt out takes as long as on "
        f"{counted(cores, 'rank')}, a part that is split several times as long, and each rank holds {BASE_MB:.0f} MB and more"
    )


@contextlib.contextmanager
def stage_progress(comm: MPI.Comm, first: str = "") -> Iterator[tuple[Announcer, Observer]]:
    """Provide what is called with each stage before it begins and as it ends: rank 0 prints each stage,
    and shows how a long one goes on.

    Args:
        first: What goes on before the first stage; empty for nothing.
    """
    if comm.rank > 0:
        yield lambda stage: None, lambda record: None
        return
    with show_progress() as progress:

        def announce(stage: Stage) -> None:
            unknown = stage.kind in ("mesh", "reduce", "load")
            seconds = (
                stage.estimated_seconds if stage.estimated_seconds is not None or unknown else 0.0
            )
            subject = stage.component or stage.pose or ""
            if stage.kernels:
                subject += f", {counted(stage.kernels, 'kernel')} to compile first"
            progress.begin(f"{stage.kind:<7} {subject}", seconds)

        def observe(record: StageRecord) -> None:
            progress.end()
            print_stage(record)

        if first:
            progress.begin(first)
        yield announce, observe


def _run_with_progress(
    scene: Scene, output: Path, comm: MPI.Comm, *, volume: bool, origin: Provenance | None
) -> Results:
    """Run a scene; rank 0 prints each stage as it ends, and shows how a long one goes on."""
    parts = scene.machine.components.values()
    files = any(isinstance(part.solid, StepFile | MeshFile) for part in parts)
    with stage_progress(comm, "plan    from the parts' files" if files else "") as shown:
        announce, observe = shown
        return run_scene(
            scene,
            output,
            comm=comm,
            observer=observe,
            announce=announce,
            volume=volume,
            provenance=origin,
        )
