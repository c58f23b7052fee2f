"""``headstock converge``: how fine a part or a machine must be meshed, in one command; one that was
stopped goes on where it was.
"""

from pathlib import Path

import click

from headstock.app.actions.running import claim_on_root, require_ranks
from headstock.app.actions.showing import STEP_SUFFIXES
from headstock.app.actions.starting import write_part_scene
from headstock.app.charts.study import draw_convergence
from headstock.app.commands.batch_commands import ConvergeOptions
from headstock.app.commands.options import read_percent, trace_command
from headstock.app.terminal.console import print_remarks
from headstock.app.terminal.convergence import (
    FILES,
    convergence_csv,
    list_convergence,
    print_convergence,
    print_feature_trial,
    print_mesh,
)
from headstock.app.terminal.guard import DONE
from headstock.geometry.parts.solids import MeshFile, StepFile
from headstock.meshing.components.survey import survey_step
from headstock.meshing.errors import MeshError
from headstock.meshing.length_units import doubt_size
from headstock.pipeline.planning.planner import plan_scene
from headstock.pipeline.preview.watched_numbers import find_name_fault
from headstock.pipeline.storage.json_texts import dump_summary
from headstock.pipeline.storage.outputs import prepare_output, write_named_files, write_output
from headstock.pipeline.storage.provenance import SceneChoice
from headstock.scene.building.loader import load_scene
from headstock.scene.scene import Scene
from headstock.solvers.mpi import MPI
from headstock.solvers.ranks import make_on_root
from headstock.studies.parameters.convergence import (
    Convergence,
    ConvergenceGoal,
    MeshSeries,
    choose_series,
    measure_fields,
    plan_study,
    run_convergence,
    show_count,
)
from headstock.studies.parameters.features import MeshAdvice, try_features
from headstock.studies.parameters.limits import MeshNeed, find_need
from headstock.studies.parameters.records import POINTS_FILE
from headstock.studies.parameters.runs import StudyJob, hash_scene

MEASURE = "motions of surfaces, 1"  # its number rises when they are measured otherwise
WATCHED = ("static", "modal")
ACCURACIES = (0.03, 0.01, 0.003, 0.001)  # of which the table tells what they take


def converge_command(options: ConvergeOptions, comm: MPI.Comm) -> int:
    """Compute meshes from coarse to fine on all ranks, print what they say and write it.

    Raises:
        SceneError: The scene has problems.
        click.UsageError: There is nothing to mesh or to watch, or an option does not fit.
        HeadstockError: No mesh could be computed, or a file cannot be written.
    """
    require_ranks(options.ranks, comm)
    share = read_percent(options.accuracy)
    goal = ConvergenceGoal(
        share, options.most_dofs, options.most_seconds, tuple(options.watch or ())
    )
    folder = options.output or Path("results") / f"{options.scene.stem}-converge"
    chosen = make_on_root(comm, lambda: _choose_scene(options, folder))
    job, series = make_on_root(comm, lambda: _make_job(chosen, goal, retry=options.retry))
    with claim_on_root(comm, folder, FILES):
        found = run_convergence(job, series, goal, folder, comm=comm, observer=print_mesh)
        trials = try_features(job, found, goal, folder, comm=comm, observer=print_feature_trial)
        if found is not None:
            advice = MeshAdvice(found, _find_needs(found, goal), tuple(trials))
            print_remarks(_publish(advice, chosen, folder, options, comm.size))
    return DONE


def _choose_scene(options: ConvergeOptions, folder: Path) -> SceneChoice:
    """The scene; around a STEP part the one that ``new --part`` makes, in the output folder."""
    chosen, solid = options.chosen, options.solid_choice
    if chosen.path.suffix.lower() not in STEP_SUFFIXES:
        if options.free or solid is not None:
            raise click.UsageError("--free and --solid go with a STEP file; a scene says it itself")
        return chosen
    try:
        survey = survey_step(StepFile(chosen.path.absolute(), solid))
    except MeshError as error:
        raise click.UsageError(f"{error}; see what `headstock show {chosen.path}` says") from error
    doubt = doubt_size(chosen.path, max(survey.size))
    name = f"{chosen.path.stem}.toml"
    text = write_part_scene(
        chosen.path, survey, name, solid=solid, free=options.free, accuracy=False
    ).removeprefix("#:schema ./scene.schema.json\n")
    prepare_output(folder, (name, chosen.path.name))
    write_output(folder / name, text.encode())
    write_output(folder / chosen.path.name, chosen.path.read_bytes())
    print_remarks([] if doubt is None else [doubt])
    return SceneChoice(folder / name, chosen.variant, chosen.overrides, chosen.analyses)


def _make_job(
    chosen: SceneChoice, goal: ConvergenceGoal, *, retry: bool
) -> tuple[StudyJob, MeshSeries]:
    content = hash_scene(chosen.path) if chosen.path.is_file() else ""
    scene = load_scene(chosen.path, variant=chosen.variant, overrides=chosen.overrides)
    wanted = scene.analyses.names if goal.watch else WATCHED
    analyses = [name for name in wanted if name in scene.analyses.names]
    for pattern in goal.watch:
        if fault := find_name_fault(pattern, [scene]):
            raise click.UsageError(f"--watch: {fault}")
    series = _check_scene(scene, chosen.path, analyses)
    _check_first_mesh(chosen, series, goal)
    job = StudyJob(
        path=chosen.path,
        study=plan_study(analyses),
        raw=scene.raw,
        content=content,
        variant=chosen.variant,
        overrides=chosen.overrides,
        measure=measure_fields,
        measure_name=MEASURE,
        retry=retry,
    )
    return job, series


def _check_scene(scene: Scene, path: Path, analyses: list[str]) -> MeshSeries:
    """The meshes of a scene.

    Raises:
        click.UsageError: Nothing is meshed, nothing can be watched, or meshes are chosen otherwise.
    """
    if not analyses:
        raise click.UsageError(
            f"{path} asks for no number that could converge: write [analyses.modal] with count = 6, or [analyses.static]"
        )
    if scene.accuracy is not None:
        raise click.UsageError(
            f"{path} leaves its meshes to accuracy = {100.0 * scene.accuracy.to:g} %: take that line out, and see how fine they must be"
        )
    series = choose_series(scene)
    if not series.parts:
        raise click.UsageError(f"{path} has no mesh to refine: {_describe_parts(scene)}")
    return series


def _check_first_mesh(chosen: SceneChoice, series: MeshSeries, goal: ConvergenceGoal) -> None:
    """See that the coarsest mesh is no larger than the finest may be.

    Raises:
        click.UsageError: It is.
        BudgetError: It does not fit the limits of the scene.
    """
    coarsest = load_scene(
        chosen.path,
        variant=chosen.variant,
        overrides=chosen.overrides,
        values=series.settings(series.factors[0]),
    )
    stages = plan_scene(coarsest, survey=True).stages
    dofs = sum(stage.estimated_dofs or 0 for stage in stages if stage.kind == "mesh")
    if dofs > goal.most_dofs:
        sizes = ", ".join(
            f"{name} {size}" for name, size in series.sizes(series.factors[0]).items()
        )
        raise click.UsageError(
            f"the first and coarsest mesh ({sizes}) would have about {show_count(dofs)} dofs, and --most-dofs is {goal.most_dofs}: "
            f"allow ten times the {show_count(dofs)}, so that finer meshes can follow, or write larger sizes under mesh of these components"
        )


def _describe_parts(scene: Scene) -> str:
    """Why no component is meshed, and what to write."""
    parts = scene.machine.components
    kinds = [
        f"{name} is {'a mesh file' if isinstance(part.solid, MeshFile) else 'imported' if part.fidelity == 'elastic' else part.fidelity}"
        for name, part in parts.items()
    ]
    stiff = [name for name, part in parts.items() if part.fidelity != "elastic"]
    remedy = f"; try --set components.{stiff[0]}.fidelity=elastic" if stiff else ""
    return f"{', '.join(kinds[:4])}{', …' if len(kinds) > 4 else ''}{remedy}"


def _find_needs(found: Convergence, goal: ConvergenceGoal) -> tuple[MeshNeed, ...]:
    others = [accuracy for accuracy in ACCURACIES if accuracy != goal.accuracy]
    return tuple(
        find_need(accuracy, found.costs, found.watched, found.limits)
        for accuracy in (goal.accuracy, *others)
    )


def _publish(
    advice: MeshAdvice, chosen: SceneChoice, folder: Path, options: ConvergeOptions, ranks: int
) -> list[str]:
    """Write the files and print; remarks for the user."""
    listing = list_convergence(advice, options.scene)
    origin = trace_command(chosen, ranks=ranks, with_host=not options.no_host)
    if origin is not None:
        listing["provenance"] = origin.summarise()
    figure = draw_convergence(advice.found, advice.needs[0])
    pictures = {} if figure is None else {"convergence.png": figure}
    remarks = write_named_files(folder, pictures)
    table, text = FILES
    write_output(folder / table, convergence_csv(advice.found))
    content = dump_summary(listing)
    write_output(folder / text, content.encode())
    options.write_json(content)
    print_convergence(advice, folder=folder, files=[POINTS_FILE, table, *pictures])
    return remarks
