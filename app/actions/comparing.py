"""``headstock compare``: variants of a scene side by side, as one table, and as JSON, CSV, figures
and a page.
"""

import dataclasses
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import get_args

import click

from headstock.app.actions.running import claim_on_root, require_ranks
from headstock.app.charts.comparison import draw_comparison
from headstock.app.commands.batch_commands import CompareOptions
from headstock.app.commands.options import split_list
from headstock.app.report.pages import render_comparison
from headstock.app.tables.comparison import comparison_csv, tabulate_lines
from headstock.app.tables.table import encode_csv
from headstock.app.terminal.comparison import print_comparison, print_effort, print_variant
from headstock.app.terminal.console import print_remarks, warn_of_unused_accuracy
from headstock.app.terminal.guard import DONE, FAILED
from headstock.geometry.parts.components import Fidelity
from headstock.pipeline.numbers.folders import NUMBERS_FILE, encode_tables
from headstock.pipeline.storage.json_texts import dump_summary
from headstock.pipeline.storage.outputs import write_named_files, write_output
from headstock.pipeline.storage.provenance import SceneChoice
from headstock.pipeline.storage.store import Store, default_store_root
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.findings import suggest_names
from headstock.scene.scene import deforming_parts
from headstock.solvers.errors import ModelError
from headstock.solvers.mpi import MPI
from headstock.solvers.ranks import make_on_root
from headstock.studies.comparison import Comparison, compare_variants
from headstock.studies.comparison_summary import (
    ComparisonSummary,
    EffortSummary,
    summarise_comparison,
    summarise_effort,
)
from headstock.studies.points import compute_points, scratch_store
from headstock.studies.variants import (
    FIDELITIES,
    FidelityError,
    VariantChoice,
    VariantSolution,
    choose_variants,
    name_uncompared,
    plan_variant,
    solve_variant,
)

PAGE_FILE, JSON_FILE = "compare.html", "compare.json"


@dataclass(frozen=True, kw_only=True)
class _Request:
    """What is compared: what the command line asked for, and what it leaves open as the scene has it."""

    scene: SceneChoice
    variants: tuple[str, ...]
    fidelities: tuple[str, ...]
    baseline: bool
    pose: str | None
    reference: str | None
    effort: bool
    change: tuple[str, ...]


def compare_command(options: CompareOptions, comm: MPI.Comm) -> int:
    """Solve every variant on all ranks, print them side by side and write the files, with where
    they come from.

    Raises:
        SceneError: A variant has problems.
        click.UsageError: An option does not fit.
        HeadstockError: A computation or a file failed.
    """
    start, origin = time.perf_counter(), options.trace(comm.size)
    require_ranks(options.ranks, comm)
    request = make_on_root(comm, partial(_read_request, options))
    choices = make_on_root(comm, partial(_choose, request))
    folder = options.output or Path("results") / f"{options.scene.stem}-compare"
    with claim_on_root(comm, folder, (JSON_FILE, PAGE_FILE)):
        solved = _solve_all(request, choices, comm)

        def publish() -> int:
            comparison = _compare(request, choices, solved)
            summary = summarise_comparison(comparison)
            if request.effort:
                efforts = {name: _weigh(found.runs) for name, found in solved.items() if found.runs}
                summary["effort"] = {"change": list(request.change), "variants": efforts}
            if origin is not None:
                summary["provenance"] = origin.summarise()
            remarks = _publish(summary, comparison, folder, options)
            print_comparison(summary)
            print_effort(summary)
            print_remarks(remarks)
            print(
                f"done in {time.perf_counter() - start:.2f} s, results in {folder} ({PAGE_FILE}, {JSON_FILE})"
            )
            failed = any(solution.failures for solution in comparison.solutions.values())
            return FAILED if failed else DONE

        return make_on_root(comm, publish)


def _read_request(options: CompareOptions) -> _Request:
    chosen = options.chosen
    scene = load_scene(chosen.path, overrides=chosen.overrides)
    warn_of_unused_accuracy(scene)
    settings = scene.compare
    variants, asked = split_list(options.variants), split_list(options.fidelity)
    # a scene without variants has its fidelities to compare
    fidelities = settings.fidelities or (
        () if scene.variants or variants or settings.variants else FIDELITIES
    )
    return _Request(
        scene=chosen,
        variants=variants or settings.variants,
        # a list of the scene is what its author wants to see
        baseline=options.baseline and bool(variants or not settings.variants),
        fidelities=asked or fidelities,
        pose=options.pose or settings.pose,
        # a reference of the scene may be no column of what was asked for on the command line
        reference=options.reference or (None if variants or asked else settings.reference),
        effort=options.effort,
        change=tuple(options.change or ()),
    )


def _choose(request: _Request) -> tuple[VariantChoice, ...]:
    known, path = get_args(Fidelity), request.scene.path
    for fidelity in request.fidelities:
        if fidelity not in known:
            raise click.UsageError(
                f"there is no fidelity {fidelity!r}; {suggest_names(fidelity, known, what='fidelities')}"
            )
    fidelities: list[Fidelity] = [known[known.index(fidelity)] for fidelity in request.fidelities]
    choices = choose_variants(
        path,
        request.variants,
        fidelities=fidelities,
        overrides=request.scene.overrides,
        baseline=request.baseline,
    )
    names = [choice.name for choice in choices]
    if request.reference is not None and request.reference not in names:
        raise click.UsageError(
            f"there is no variant {request.reference!r}; {suggest_names(request.reference, names, what='columns')}"
        )
    for choice in choices:
        if choice.cannot:
            continue
        scene = load_scene(path, variant=choice.variant, overrides=choice.overrides)
        if request.pose is not None and request.pose not in scene.poses:
            raise click.UsageError(
                f"there is no pose {request.pose!r}; {suggest_names(request.pose, scene.poses, what='poses')}"
            )
        if request.change:
            changed = _change(choice, request.change, scene.variants)
            load_scene(path, variant=changed.variant, overrides=changed.overrides)
        if request.fidelities and len(choices) == 1 and not deforming_parts(scene):
            raise click.UsageError(
                f"there is nothing to compare in {path}: all components are rigid or imported superelements; write fidelity = "
                f'"elastic" in [components.NAME] of those that bend, or --set components.{next(iter(scene.machine.components))}.fidelity=elastic'
            )
    return choices


@dataclass(frozen=True, eq=False)
class _Solved:
    """What became of a variant.

    Attributes:
        runs: The ``first`` model of it and the ``changed`` one after it; empty but on the rank that
            couples.
        cannot: Why the machine has no answer at the fidelity of the variant.
    """

    runs: dict[str, VariantSolution] = field(default_factory=dict)
    cannot: str = ""


def _solve_all(
    request: _Request, choices: tuple[VariantChoice, ...], comm: MPI.Comm
) -> dict[str, _Solved]:
    """Every variant by name; complete on rank 0.

    Several ranks solve a variant each, once they have shared the components of all of them; where
    times are asked for they solve one variant after the other together.
    """
    asked = [choice for choice in choices if not choice.cannot]

    def show(choice: VariantChoice, solved: _Solved) -> None:
        if solved.runs:
            print_variant(choice.name, _weigh(solved.runs))

    store = Store(default_store_root())
    found = compute_points(
        asked,
        lambda choice, ranks, settle: _solve_runs(request, choice, ranks),
        comm=comm,
        folder=store.root,
        together=request.effort,
        plan=partial(plan_variant, request.scene.path),
        store=store,
        observer=show,
    )
    return {choice.name: solved for choice, solved in zip(asked, found, strict=False)}


def _compare(
    request: _Request, choices: tuple[VariantChoice, ...], solved: Mapping[str, _Solved]
) -> Comparison:
    """Every variant side by side.

    Raises:
        ModelError: No two models of those asked for have an answer.
    """
    path = request.scene.path
    solutions = [found.runs["first"] for found in solved.values() if found.runs]
    cannot = {choice.name: choice.cannot for choice in choices if choice.cannot}
    cannot |= {name: found.cannot for name, found in solved.items() if found.cannot}
    asked = sum(not choice.unasked for choice in choices)
    if len(solutions) < min(2, asked):
        reasons = "; ".join(f"{name} cannot: {why}" for name, why in cannot.items())
        raise ModelError(f"there are no two models to compare: {reasons}")
    scene = load_scene(path, overrides=request.scene.overrides)
    comparison = compare_variants(
        solutions,
        scene=scene.name,
        reference=None if request.reference in cannot else request.reference,
        cannot=cannot,
        columns=[choice.name for choice in choices],
    )
    own = load_scene(path, variant=solutions[0].choice.variant, overrides=request.scene.overrides)
    missing = name_uncompared(own) if request.fidelities else ()
    return dataclasses.replace(comparison, not_compared=missing)


def _weigh(runs: Mapping[str, VariantSolution]) -> dict[str, EffortSummary]:
    return {name: summarise_effort(run.effort) for name, run in runs.items()}


def _solve_runs(request: _Request, choice: VariantChoice, comm: MPI.Comm) -> _Solved:
    """Return the models of a variant, or why there is none; collective."""
    path = request.scene.path
    choices = {"first": choice}
    if request.change:
        known = tuple(load_scene(path).variants)
        choices["changed"] = _change(choice, request.change, known)
    solved = _Solved()
    with scratch_store(cold=request.effort) as (_, store):
        for name, made in choices.items():
            cannot = ""
            try:
                run = solve_variant(path, made, pose=request.pose, comm=comm, store=store)
                if run is not None:
                    solved.runs[name] = run
            except FidelityError as error:
                cannot = str(error)
            # rank 0 alone knows: no other may go on to the next model
            if cannot := comm.bcast(cannot):
                return _Solved(cannot=cannot)
    return solved


def _change(
    choice: VariantChoice, change: tuple[str, ...], known: tuple[str, ...]
) -> VariantChoice:
    """A variant with other variants joined and settings applied."""
    joined = [item for item in change if item in known]
    settings = tuple(item for item in change if item not in known)
    parts = [choice.variant] if choice.variant else []
    return VariantChoice(
        choice.name,
        "+".join([*parts, *joined]) or None,
        (*choice.overrides, *settings),
        choice.fidelity,
    )


def _publish(
    summary: ComparisonSummary,
    comparison: Comparison,
    folder: Path,
    options: CompareOptions,
) -> list[str]:
    """Write every file of a comparison; remarks for the user."""
    lines = comparison.lines
    figures = draw_comparison(summary, lines)
    tables = {f"{name}.csv": table for name, table in comparison_csv(summary).items()}
    tables[NUMBERS_FILE] = encode_tables(comparison.numbers)
    if lines:
        tables["responses.csv"] = encode_csv(tabulate_lines(lines))
    remarks = write_named_files(
        folder, {f"{name}.png": image for name, image in figures.items()} | tables
    )
    text = dump_summary(summary)
    write_output(folder / JSON_FILE, text.encode())
    write_output(folder / PAGE_FILE, render_comparison(summary, figures).encode())
    options.write_json(text)
    return remarks
