"""``headstock study``: vary keys of a scene, watch results, and go on where a killed study was."""

import dataclasses
import functools
import importlib
import time
from collections.abc import Sequence
from pathlib import Path

import headstock.validation
from headstock.app.actions.running import claim_on_root, require_ranks
from headstock.app.charts.refinement import draw_refinement
from headstock.app.charts.study import draw_costs, draw_study
from headstock.app.commands.batch_commands import StudyOptions
from headstock.app.tables.table import encode_csv
from headstock.app.terminal.console import print_remarks
from headstock.app.terminal.guard import DONE, FAILED
from headstock.app.terminal.refinement import list_statements, print_refinement, refinement_tables
from headstock.app.terminal.study import (
    cost_table,
    digit_words,
    list_costs,
    list_study,
    print_progress,
    print_study,
    study_csv,
)
from headstock.pipeline.numbers.folders import NUMBERS_FILE, encode_tables
from headstock.pipeline.numbers.numbers import Numbers
from headstock.pipeline.storage.content_keys import code_fingerprint
from headstock.pipeline.storage.json_texts import dump_summary
from headstock.pipeline.storage.outputs import write_named_files, write_output
from headstock.pipeline.storage.provenance import Provenance
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.watch_paths import parse_watch
from headstock.scene.scene import require_name
from headstock.solvers.mpi import MPI
from headstock.solvers.ranks import make_on_root
from headstock.studies.parameters.costs import weigh_costs
from headstock.studies.parameters.records import StudyRecord
from headstock.studies.parameters.runs import StudyJob, check_study, hash_scene, run_study
from headstock.studies.parameters.tables import StudyTable, tabulate_study
from headstock.validation.refinement.points import collect_points, measure_beam
from headstock.validation.refinement.references import ReferenceBeam, reference_beam
from headstock.validation.refinement.statements import evaluate_own, evaluate_statements

TABLE_FILE, LISTING_FILE = "study.csv", "study.json"
PAPER_MODULE = "headstock.validation.refinement.paper_elements"
Extra = dict[str, bytes]  # further files of a study, by name


def study_command(options: StudyOptions, comm: MPI.Comm) -> int:
    """Run a study on all ranks, print its table and write its files, with where it comes from.

    Raises:
        SceneError: The scene or a varied value has problems, or it has no such study.
        click.UsageError: ``--ranks`` does not fit.
        NumberNameError: A watched name fits no number; all files are written.
        HeadstockError: A file cannot be written.
    """
    start, origin = time.perf_counter(), options.trace(comm.size)
    require_ranks(options.ranks, comm)
    job = make_on_root(comm, lambda: _make_job(options))
    folder = options.output or Path("results") / f"{options.scene.stem}-{options.name}"
    with claim_on_root(comm, folder, (TABLE_FILE, LISTING_FILE)):
        records = run_study(job, folder, comm=comm, observer=print_progress)

        def finish() -> int:
            table = tabulate_study(job.study, records)
            remarks = _publish(table, records, folder, options, origin)
            print_study(table, seconds=time.perf_counter() - start, folder=folder)
            print_remarks(remarks)
            _require_matches(table)
            return FAILED if any(record.status == "failed" for record in records) else DONE

        return make_on_root(comm, finish)


def _require_matches(table: StudyTable) -> None:
    """See that every watched name fits a number of some point.

    Raises:
        NumberNameError: One fits none; the message lists names that exist.
    """
    if any(row.problems for row in table.rows):
        known = Numbers.collect(number for each in table.numbers for number in each.values())
        for text in table.study.watch if known else ():
            if parse_watch(text).names_numbers:
                known.select(text)


def _make_job(options: StudyOptions) -> StudyJob:
    chosen = options.chosen
    content = hash_scene(chosen.path) if chosen.path.is_file() else ""
    scene = load_scene(chosen.path, variant=chosen.variant, overrides=chosen.overrides)
    require_name(scene, "studies", options.name, scene.studies)
    study = scene.studies[options.name]
    repeats = study.repeats if options.repeats is None else options.repeats
    job = StudyJob(
        path=chosen.path,
        study=dataclasses.replace(study, cold=options.cold or study.cold, repeats=repeats),
        raw=scene.raw,
        content=content,
        variant=chosen.variant,
        overrides=chosen.overrides,
        measure=None
        if study.reference is None
        else functools.partial(measure_beam, study.reference),
        measure_name=""
        if study.reference is None
        else f"{study.reference} {code_fingerprint(headstock.validation)}",
        retry=options.retry,
    )
    check_study(job)
    return job


def _publish(
    table: StudyTable,
    records: Sequence[StudyRecord],
    folder: Path,
    options: StudyOptions,
    origin: Provenance | None,
) -> list[str]:
    """Write the files of a study beside its records, and print what a reference says of it; remarks
    for the user.
    """
    extra: Extra = {}
    listing = list_study(table, options.scene)
    if table.study.reference is not None:
        _add_refinement(reference_beam(table.study.reference), records, listing, extra)
    if table.study.reference_run is not None:
        _add_costs(table, listing, extra)
    figure = draw_study(table)
    if figure is not None:
        extra["study.png"] = figure
    points = {f"point {number}": each for number, each in enumerate(table.numbers, 1)}
    extra[NUMBERS_FILE] = encode_tables(points)
    remarks = write_named_files(folder, extra)
    write_output(folder / TABLE_FILE, study_csv(table))
    if origin is not None:
        listing["provenance"] = origin.summarise()
    text = dump_summary(listing)
    write_output(folder / LISTING_FILE, text.encode())
    options.write_json(text)
    return remarks


def _add_costs(table: StudyTable, listing: dict[str, object], extra: Extra) -> None:
    """Errors beside costs, as a table and a figure."""
    points = weigh_costs(table)
    extra["cost.csv"] = encode_csv(cost_table(points))
    figure = draw_costs(points, {family.name: family.label for family in table.study.families})
    if figure is not None:
        extra["cost.png"] = figure
    listing["costs"], listing["digits"] = list_costs(points), digit_words(points)


def _add_refinement(
    beam: ReferenceBeam, records: Sequence[StudyRecord], listing: dict[str, object], extra: Extra
) -> None:
    """Figures, tables and statements of a refinement study."""
    paper = importlib.import_module(PAPER_MODULE)  # loads PETSc
    points = [*collect_points(beam, records), *paper.paper_points(beam)]
    statements, own = evaluate_statements(beam, points), evaluate_own(beam, points)
    extra.update(
        {
            f"{table.name}.csv": encode_csv(table)
            for table in refinement_tables(beam, points, [*statements, *own])
        }
    )
    extra.update({f"{name}.png": image for name, image in draw_refinement(beam, points).items()})
    print_refinement(beam, points, statements, own)
    listing["claims"], listing["own_claims"] = list_statements(statements), list_statements(own)
