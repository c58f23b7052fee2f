"""``headstock compare``: variants of a scene side by side, as one table, and as JSON, CSV, figures
and a page.
"""

import contextlib
import dataclasses
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import get_args

import click
from mpi4py import MPI

from headstock.app.actions.running import require_ranks
from headstock.app.charts.comparison import draw_comparison
from headstock.app.report.pages import render_comparison
from headstock.app.terminal.comparison import print_comparison, print_effort, print_variant
from headstock.app.terminal.console import print_remarks, warn_of_unused_accuracy
from headstock.app.terminal.guard import DONE, FAILED
from headstock.app.texts.comparison import comparison_csv
from headstock.geometry.parts.components import Fidelity
from headstock.pipeline.storage.json_texts import dump_json
from headstock.pipeline.storage.outputs import claim_output, write_beside, write_output
from headstock.pipeline.storage.provenance import Provenance, SceneChoice
from headstock.pipeline.storage.store import Store, default_store_root
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.findings import suggest_names
from headstock.solvers.ranks import make_on_root, share_from_root
from headstock.studies.comparison import (
    ComparisonSummary,
    EffortSummary,
    compare_variants,
    summarise_comparison,
    summarise_effort,
)
from headstock.studies.variants import (
    VariantChoice,
    VariantSolution,
    choose_variants,
    solve_variant,
)

PAGE_FILE, JSON_FILE = "compare.html", "compare.json"


@dataclass(frozen=True, kw_only=True)
class CompareRequest:
    """What the command line asked for; the scene as written, since each column is a variant of
    it.
    """

    scene: SceneChoice
    output: Path | None = None
    variants: tuple[str, ...] = ()
    fidelities: tuple[str, ...] = ()
    pose: str | None = None
    reference: str | None = None
    ranks: int | None = None
    effort: bool = False
    change: tuple[str, ...] = ()
    json_file: Path | None = None


def compare_request(
    request: CompareRequest, comm: MPI.Comm, origin: Provenance | None = None
) -> int:
    """Solve every variant on all ranks, print them side by side and write the files, with where
    they come from.

    Args:
        request: Of the command line.
        comm: Of all ranks.
        origin: Where the results come from.

    Raises:
        SceneError: A variant has problems.
        click.UsageError: An option does not fit.
        HeadstockError: A computation or a file failed.
    """
    start = time.perf_counter()
    require_ranks(request.ranks, comm)
    request = make_on_root(comm, partial(_with_settings, request))
    choices = make_on_root(comm, partial(_choose, request))
    folder = request.output or Path("results") / f"{request.scene.path.stem}-compare"
    with (
        claim_output(folder, (JSON_FILE, PAGE_FILE)) if comm.rank == 0 else contextlib.nullcontext()
    ):
        summary, solutions = _solve_all(request, choices, comm)
        if summary is not None:
            if origin is not None:
                summary["provenance"] = origin.summarise()
            remarks = _publish(summary, folder, request.json_file)
            print_comparison(summary)
            print_effort(summary)
            print_remarks(remarks)
            print(
                f"done in {time.perf_counter() - start:.2f} s, results in {folder} ({PAGE_FILE}, {JSON_FILE})"
            )
    return int(
        share_from_root(comm, FAILED if any(solution.failures for solution in solutions) else DONE)
    )


def _with_settings(request: CompareRequest) -> CompareRequest:
    """What the command line leaves open, as the scene's own table has it."""
    scene = load_scene(request.scene.path, overrides=request.scene.overrides)
    warn_of_unused_accuracy(scene)
    settings = scene.compare
    return dataclasses.replace(
        request,
        variants=request.variants or settings.variants,
        fidelities=request.fidelities or settings.fidelities,
        pose=request.pose or settings.pose,
        # a reference of the scene may be no column of what was asked for on the command line
        reference=request.reference
        or (None if request.variants or request.fidelities else settings.reference),
    )


def _choose(request: CompareRequest) -> tuple[VariantChoice, ...]:
    known, path = get_args(Fidelity), request.scene.path
    for fidelity in request.fidelities:
        if fidelity not in known:
            raise click.UsageError(
                f"there is no fidelity {fidelity!r}; {suggest_names(fidelity, known, what='fidelities')}"
            )
    fidelities: list[Fidelity] = [known[known.index(fidelity)] for fidelity in request.fidelities]
    choices = choose_variants(
        path, request.variants, fidelities=fidelities, overrides=request.scene.overrides
    )
    names = [choice.name for choice in choices]
    if request.reference is not None and request.reference not in names:
        raise click.UsageError(
            f"there is no variant {request.reference!r}; {suggest_names(request.reference, names, what='columns')}"
        )
    for choice in choices:
        scene = load_scene(path, variant=choice.variant, overrides=choice.overrides)
        if scene.is_lumped:
            raise click.UsageError(
                f"{path} describes a lumped mechanism; compare takes machines of components and joints"
            )
        if request.pose is not None and request.pose not in scene.poses:
            raise click.UsageError(
                f"there is no pose {request.pose!r}; {suggest_names(request.pose, scene.poses, what='poses')}"
            )
        if request.change:
            changed = _change(choice, request.change, scene.variants)
            load_scene(path, variant=changed.variant, overrides=changed.overrides)
    return choices


def _solve_all(
    request: CompareRequest, choices: tuple[VariantChoice, ...], comm: MPI.Comm
) -> tuple[ComparisonSummary | None, list[VariantSolution]]:
    """Every variant's solution and what they say side by side; both are on rank 0 only."""
    path = request.scene.path
    solutions: list[VariantSolution] = []
    efforts: dict[str, dict[str, EffortSummary]] = {}
    for choice in choices:
        with _store(cold=request.effort) as store:
            solution = solve_variant(path, choice, pose=request.pose, comm=comm, store=store)
            runs = {"first": solution}
            if request.change:
                known = tuple(load_scene(path).variants)
                changed = _change(choice, request.change, known)
                runs["changed"] = solve_variant(
                    path, changed, pose=request.pose, comm=comm, store=store
                )
        if solution is not None:
            solutions.append(solution)
            efforts[choice.name] = {
                name: summarise_effort(run.effort) for name, run in runs.items() if run is not None
            }
            print_variant(choice.name, efforts[choice.name])
    if not solutions:
        return None, []
    name = load_scene(path).name
    summary = summarise_comparison(
        compare_variants(solutions, scene=name, reference=request.reference)
    )
    if request.effort:
        summary["effort"] = {"change": list(request.change), "variants": efforts}
    return summary, solutions


@contextlib.contextmanager
def _store(*, cold: bool) -> Iterator[Store]:
    """The user's store, or an empty one that is thrown away."""
    if not cold:
        yield Store(default_store_root())
        return
    with tempfile.TemporaryDirectory(prefix="headstock-") as folder:
        yield Store(Path(folder))


def _change(
    choice: VariantChoice, change: tuple[str, ...], known: tuple[str, ...]
) -> VariantChoice:
    """A variant with other variants joined and settings applied."""
    joined = [item for item in change if item in known]
    settings = tuple(item for item in change if item not in known)
    parts = [choice.variant] if choice.variant else []
    return VariantChoice(
        choice.name, "+".join([*parts, *joined]) or None, (*choice.overrides, *settings)
    )


def _publish(summary: ComparisonSummary, folder: Path, json_file: Path | None) -> list[str]:
    """Write every file of a comparison; remarks for the user."""
    figures = draw_comparison(summary)
    tables = {f"{name}.csv": table for name, table in comparison_csv(summary).items()}
    remarks = write_beside(
        folder, {f"{name}.png": image for name, image in figures.items()} | tables
    )
    write_output(folder / JSON_FILE, dump_json(summary).encode())
    write_output(folder / PAGE_FILE, render_comparison(summary, figures).encode())
    if json_file is not None:
        write_output(json_file, dump_json(summary).encode())
    return remarks
