"""What is done with machines, in the same way as by the command of the same name: ``load``,
``check``, ``plan``, ``run`` and so on.

All of it is collective under MPI: every rank calls it with the same arguments and gets the same
answer. An error on one rank leaves the others waiting: start with ``mpirun python -m mpi4py``.
"""

import contextlib
import dataclasses
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import cast

from headstock.arguments import (
    check_call,
    read_keys,
    read_name,
    read_names,
    read_path_argument,
    refuse,
)
from headstock.geometry.parts.components import Fidelity
from headstock.machine import Machine, write_setting, write_settings
from headstock.pipeline.accuracy.search import plan_first_round
from headstock.pipeline.numbers.folders import RESULTS_FILE, SUMMARY_FILE
from headstock.pipeline.planning.plan import Plan, StageRecord
from headstock.pipeline.planning.planner import plan_scene
from headstock.pipeline.planning.reductions import add_compiling
from headstock.pipeline.preview.doubts import check_scene
from headstock.pipeline.results.files import (
    FIGURES_FOLDER,
    REPORT_FILE,
    TABLES_FOLDER,
    open_results,
)
from headstock.pipeline.results.mode_files import MODES_FOLDER, VOLUME_FOLDER, write_mode_files
from headstock.pipeline.results.results import Results
from headstock.pipeline.runner import run_scene
from headstock.pipeline.storage.outputs import claim_output, remove_outputs, replace_outputs
from headstock.pipeline.storage.provenance import Provenance, SceneChoice, trace_content
from headstock.pipeline.storage.store import Store, default_store_root
from headstock.scene.building.loader import build_scene, load_scene, prepare_sweep
from headstock.scene.expansion.includes import scene_content
from headstock.scene.reading.files import TomlTable, write_toml
from headstock.scene.reading.findings import Findings, SceneError, suggest_names
from headstock.scene.reading.watch_paths import MEASURED_NAMES
from headstock.scene.scene import Scene, keep_analyses, list_analyses, require_name
from headstock.scene.studies import Study
from headstock.solvers.errors import ModelError
from headstock.solvers.mpi import MPI
from headstock.solvers.ranks import make_on_root, share_from_root
from headstock.studies.comparison import Comparison, compare_variants
from headstock.studies.identification.descent import StartRecord
from headstock.studies.identification.identification import (
    Identification,
    fit_parameters,
    prepare_problem,
)
from headstock.studies.identification.target_files import load_targets
from headstock.studies.identification.targets import MAX_STARTS
from headstock.studies.parameters.runs import (
    StudyJob,
    StudyProgress,
    check_study,
    hash_scene,
    run_study,
)
from headstock.studies.parameters.tables import StudyTable, tabulate_study
from headstock.studies.points import Settle, compute_points
from headstock.studies.sweeps.files import write_sweep
from headstock.studies.sweeps.results import SweepResults, name_tracked_modes
from headstock.studies.sweeps.runs import SweepJob, gather_sweep, run_sweep, select_analyses
from headstock.studies.variants import (
    FidelityError,
    VariantChoice,
    VariantSolution,
    choose_variants,
    plan_variant,
    solve_variant,
)

# what a run writes into its folder or removes there
RUN_FILES = (RESULTS_FILE, SUMMARY_FILE, REPORT_FILE)
RUN_PARTS = (MODES_FOLDER, VOLUME_FOLDER, TABLES_FOLDER, FIGURES_FOLDER)

UNNAMED = "study"  # a study that is described in Python

type Source = Machine | str | Path  # a machine, or the path of a scene file


def load(
    path: str | Path, *, variant: str | None = None, set: Mapping[str, object] | None = None
) -> Machine:
    """Load a machine from a scene file.

    Args:
        path: A ``.toml`` file.
        variant: One of its variants, or several joined by ``+``.
        set: Dotted key to value, applied after the variant; numbers are in SI units.

    Raises:
        SceneError: Anything is wrong; ``problems`` has every problem with file, line, key and
            remedy.
    """
    if variant is not None:
        read_name(variant, "load", "variant")
    settings = write_settings(read_keys(set, "load", "set"))
    return Machine.load(
        SceneChoice(read_path_argument(path, "load", "path"), variant, tuple(settings))
    )


def check(machine: Source) -> tuple[str, ...]:
    """Return what is allowed but looks wrong: bodies that move freely, odd numbers, what an
    analysis on request lacks.

    Raises:
        SceneError: Anything is wrong.
    """
    return tuple(check_scene(_machine(machine, "check").scene))


def plan(machine: Source) -> Plan:
    """Return the stages that a machine calls for, each with its reason and an estimate of its cost."""
    scene = _machine(machine, "plan").scene
    planned = plan_scene(scene, survey=True) if scene.accuracy is None else plan_first_round(scene)
    return add_compiling(planned, scene)


def run(
    machine: Source,
    *,
    output: str | Path | None = None,
    analyses: Sequence[str] = (),
    volume: bool = False,
    progress: Callable[[StageRecord], None] = lambda record: None,
    comm: MPI.Comm | None = None,
) -> Results:
    """Run the analyses of a machine; meshes and superelements come from the user's store where they
    are there.

    Args:
        machine: Machine or path of a scene file.
        output: Folder for ``results.h5`` and ``summary.json``, which ``open`` reads and
            ``headstock report`` makes a page of; pages of an earlier run are removed. None for no
            files.
        analyses: Names of those to run; empty for all but those on request.
        volume: Write the volume meshes with modes and stresses, too.
        progress: Called with each stage that has ended, on rank 0.
        comm: Ranks that compute together; all that were started where None.

    Raises:
        SceneError: The machine has problems.
        HeadstockError: A computation or a file failed; earlier files are untouched.
    """
    check_call(progress, "run")
    comm = comm or MPI.COMM_WORLD
    made, analyses = _machine(machine, "run"), read_names(analyses, "run", "analyses")
    scene = _with_analyses(made.scene, analyses)
    origin = _trace(made, analyses, comm.size) if comm.rank == 0 else None
    with _claimed("run", output, comm, RUN_FILES, RUN_PARTS) as folder:
        results = run_scene(
            scene, folder, comm=comm, observer=progress, volume=volume, provenance=origin
        )
        if output is not None and comm.rank == 0:
            write_mode_files(folder, results.modal, results.view)
            # of an earlier run: pages and pictures are made by `headstock report`
            remove_outputs(folder, [REPORT_FILE])
            for part in (TABLES_FOLDER, FIGURES_FOLDER):
                replace_outputs(folder, part, {})
    if comm.size == 1:
        return results
    # meshes stay on rank 0: other ranks have the surfaces
    shared = dataclasses.replace(results, volumes=None)
    found = share_from_root(comm, shared if comm.rank == 0 else None)
    return results if comm.rank == 0 else found


def study(
    machine: Source,
    name: str | None = None,
    *,
    vary: Mapping[str, Iterable[object]] | None = None,
    watch: Sequence[str] = (),
    pairwise: bool = False,
    output: str | Path | None = None,
    progress: Callable[[StudyProgress], None] = lambda point: None,
    comm: MPI.Comm | None = None,
) -> StudyTable:
    """Run every point of a study; points that are finished in the output folder are not computed
    again.

    Args:
        machine: Machine or path of a scene file.
        name: A study of the scene; None for the one that ``vary`` and ``watch`` describe.
        vary: Dotted key (or ``variant``) to its values; numbers are in SI units.
        watch: What to look at in each point: names of numbers, such as ``frequency(pose=reference,mode=1)``
            or ``frequency``, and paths, such as ``modal.frequencies_hz[0]``.
        pairwise: The first values go together, then the second ones; else all combinations are
            points.
        output: Folder that keeps finished points; None for none.
        progress: Called with each point that is finished, on rank 0.
        comm: Ranks that compute each point together; all that were started where None.

    Raises:
        SceneError: The machine, the study or a varied value has problems.
        HeadstockError: A record cannot be written. A point that cannot be computed is a row with
            its error.
    """
    check_call(progress, "study")
    comm = comm or MPI.COMM_WORLD
    made = _machine(machine, "study")
    if name is None:
        chosen = _describe_study(made, vary, watch, pairwise=pairwise)
    elif vary is None and not watch:
        read_name(name, "study", "name")
        require_name(made.scene, "studies", name, made.scene.studies)
        chosen = made.scene.studies[name]
    else:
        raise refuse("study", "name", "give the name of a study or vary and watch, not both")
    with made.on_disk() as choice, _claimed("study", output, comm) as folder:
        job = StudyJob(
            path=choice.path,
            study=chosen,
            raw=made.scene.raw,
            content=hash_scene(choice.path),
            variant=choice.variant,
            overrides=choice.overrides,
        )
        with _naming_arguments() if name is None else contextlib.nullcontext():
            check_study(job)
        records = run_study(job, folder, comm=comm, observer=progress)
    return share_from_root(comm, tabulate_study(chosen, records) if comm.rank == 0 else None)


def sweep(
    machine: Source,
    name: str,
    *,
    output: str | Path | None = None,
    progress: Callable[[StageRecord], None] = lambda record: None,
    comm: MPI.Comm | None = None,
) -> SweepResults:
    """Run the analyses of a machine in every pose of one of its sweeps; poses that are finished in
    the output folder are not computed again.

    Args:
        machine: Machine or path of a scene file.
        output: Folder that keeps finished poses and gets ``sweep.h5``; None for no files.
        progress: Called with each stage of a component that has ended, on rank 0.
        comm: Ranks that share the poses; all that were started where None.

    Raises:
        SceneError: The machine or a pose has problems.
        HeadstockError: A component cannot be reduced, or a file cannot be written.
    """
    check_call(progress, "sweep")
    comm = comm or MPI.COMM_WORLD
    made = _machine(machine, "sweep")
    read_name(name, "sweep", "name")
    require_name(made.scene, "sweeps", name, made.scene.sweeps)
    chosen = made.scene.sweeps[name]
    with made.on_disk() as choice, _claimed("sweep", output, comm) as folder:
        scene = prepare_sweep(
            load_scene(choice.path, variant=choice.variant, overrides=choice.overrides),
            name,
            overrides=choice.overrides,
        )
        job = SweepJob(select_analyses(scene), chosen, folder)
        outcome = run_sweep(job, comm=comm, observer=progress)
        results = None
        if comm.rank == 0:
            results = name_tracked_modes(outcome.parts, gather_sweep(job, outcome))
            if output is not None:
                write_sweep(folder, results)
    return share_from_root(comm, results)


def compare(
    machine: Source,
    variants: Sequence[str] = (),
    *,
    fidelities: Sequence[Fidelity] = (),
    baseline: bool = True,
    pose: str | None = None,
    reference: str | None = None,
    comm: MPI.Comm | None = None,
    progress: Callable[[str], None] = lambda variant: None,
) -> Comparison:
    """Variants of a machine side by side, modes paired by their shapes.

    Args:
        machine: Machine or path of a scene file.
        variants: Names, ``A+B`` for joined ones, ``as written`` for none; empty for all.
        fidelities: Each variant once with its elastic components at each of them.
        baseline: Show the machine as written beside its variants; without ``fidelities`` only.
        pose: Name; None for the first.
        reference: Variant the others are compared with; None for the richest.
        comm: Ranks that share the variants; all that were started where None.
        progress: Called on rank 0 with the name of each variant that is solved.

    Returns:
        The same on every rank.

    Raises:
        SceneError: A variant has problems.
        HeadstockError: A computation failed.
    """
    check_call(progress, "compare")
    comm, store = comm or MPI.COMM_WORLD, Store(default_store_root())
    kinds = cast(Sequence[Fidelity], read_names(fidelities, "compare", "fidelities"))
    with _machine(machine, "compare").on_disk() as file:
        choices = choose_variants(
            file.path,
            read_names(variants, "compare", "variants"),
            fidelities=kinds,
            overrides=file.overrides,
            baseline=baseline,
        )
        columns = [choice.name for choice in choices]
        if reference is not None and reference not in columns:
            hint = suggest_names(reference, columns, what="columns")
            raise refuse("compare", "reference", f"there is no variant {reference!r}; {hint}")
        asked = [choice for choice in choices if not choice.cannot]

        def solve(choice: VariantChoice, alone: MPI.Comm, _: Settle) -> VariantSolution | str:
            """Return the model of a variant, or why there is none."""
            try:
                return solve_variant(file.path, choice, pose=pose, comm=alone, store=store) or ""
            except FidelityError as error:
                return str(error)

        def report(choice: VariantChoice, found: VariantSolution | str) -> None:
            if not isinstance(found, str):
                progress(choice.name)

        found = compute_points(
            asked,
            solve,
            comm=comm,
            folder=store.root,
            plan=partial(plan_variant, file.path),
            store=store,
            observer=report,
        )

        def join() -> Comparison:
            solutions = [one for one in found if not isinstance(one, str)]
            cannot = {choice.name: choice.cannot for choice in choices if choice.cannot}
            cannot |= {
                choice.name: why
                for choice, why in zip(asked, found, strict=True)
                if isinstance(why, str)
            }
            if not solutions:
                raise ModelError(f"there is no model to compare: {'; '.join(cannot.values())}")
            return compare_variants(
                solutions,
                scene=load_scene(file.path, overrides=file.overrides).name,
                reference=reference,
                cannot=cannot,
                columns=columns,
            )

        return make_on_root(comm, join)


def identify(
    machine: Source,
    targets: str | Path,
    *,
    starts: int | None = None,
    comm: MPI.Comm | None = None,
    progress: Callable[[StartRecord], None] = lambda record: None,
) -> Identification:
    """Fit numbers of a machine to measurements.

    Args:
        machine: Machine or path of a scene file, without a variant: the target file names those.
        targets: Target file (``.toml``).
        starts: How many starting points the fit has; None for what the target file says.
        comm: Ranks that share the starts; all that were started where None.
        progress: Called on rank 0 with each start that has ended.

    Returns:
        The same on every rank.

    Raises:
        SceneError: The machine or the target file has problems.
        HeadstockError: A computation failed.
    """
    check_call(progress, "identify")
    comm, path = comm or MPI.COMM_WORLD, read_path_argument(targets, "identify", "targets")
    if starts is not None and not (isinstance(starts, int) and 1 <= starts <= MAX_STARTS):
        raise refuse(
            "identify", "starts", f"is {starts!r}; write a whole number, 1 to {MAX_STARTS}"
        )
    with _machine(machine, "identify").on_disk() as file:
        loaded = load_targets(path, file.path, overrides=file.overrides, starts=starts)
        problem = prepare_problem(loaded, Store(default_store_root()), comm)
        return fit_parameters(problem, loaded.task.name, progress, comm=comm)


def open(folder: str | Path) -> Results:
    """Open the results of a run from its folder, of the same type as those of ``run``.

    Raises:
        OutputError: There are none, or they are damaged or of another version.
    """
    return open_results(read_path_argument(folder, "open", "folder"))


def _machine(source: Source, function: str) -> Machine:
    """Return the machine that a function is given."""
    return (
        source
        if isinstance(source, Machine)
        else load(read_path_argument(source, function, "machine"))
    )


def _describe_study(made: Machine, vary: object, watch: object, *, pairwise: bool) -> Study:
    """Describe a study in Python, checked as one of a scene file is."""
    watched, varied = read_names(watch, "study", "watch"), read_keys(vary, "study", "vary")
    if not varied:
        example = 'vary={"components.NAME.mesh.size": ["50 mm", "25 mm"]}'
        hint = suggest_names("", made.scene.studies, what="studies")
        raise refuse("study", "vary", f"is empty; write {example}, or name a study: {hint}")
    table = {
        "vary": {
            key: items
            if isinstance(items, str | bytes | Mapping) or not isinstance(items, Iterable)
            else [write_setting(key, item) for item in items]
            for key, items in varied.items()
        },
        # nothing to look at is the records alone
        "watch": list(watched or MEASURED_NAMES),
        "pairwise": pairwise,
    }
    raw = cast(TomlTable, {**made.table, "studies": {UNNAMED: table}})
    with _naming_arguments():
        scene = build_scene(raw, Findings("hs.study"), path=made.scene.path)
    return dataclasses.replace(scene.studies[UNNAMED], watch=watched)


@contextlib.contextmanager
def _naming_arguments() -> Iterator[None]:
    """Name arguments of ``study`` where problems name the keys of the study they describe."""
    own = f"studies.{UNNAMED}"
    try:
        yield
    except SceneError as error:
        raise SceneError(
            dataclasses.replace(
                each, place="hs.study", key=each.key.removeprefix(own).removeprefix(".")
            )
            if each.key.startswith(own)
            else each
            for each in error.problems
        ) from None


def _with_analyses(scene: Scene, names: Sequence[str]) -> Scene:
    present = list_analyses(scene)
    findings = Findings(str(scene.path))
    for name in names:
        if name not in present:
            findings.add(
                ("analyses", name), suggest_names(name, present, what="analyses of this scene")
            )
    findings.raise_if_any()
    return keep_analyses(scene, names) if names else scene


@contextlib.contextmanager
def _claimed(
    function: str,
    output: str | Path | None,
    comm: MPI.Comm,
    names: Iterable[str] = (),
    parts: Iterable[str] = (),
) -> Iterator[Path]:
    """Claim an output folder that no other run writes into, with files and folders in it that will
    be written; a temporary one where none is wanted.
    """
    with contextlib.ExitStack() as stack:
        folder = Path() if output is None else read_path_argument(output, function, "output")
        if comm.rank == 0 and output is None:
            scratch = tempfile.TemporaryDirectory(prefix="headstock-results-")
            folder = Path(stack.enter_context(scratch))
        elif comm.rank == 0:
            stack.enter_context(claim_output(folder, names, parts))
        yield share_from_root(comm, folder)


def _trace(machine: Machine, analyses: Sequence[str], ranks: int) -> Provenance:
    choice, path = machine.choice, machine.scene.path
    if choice is None or not path.is_file():
        content = write_toml(machine.table).encode()
        choice = SceneChoice(path, machine.scene.variant)
    else:
        content = scene_content(path)
    named = dataclasses.replace(choice, analyses=tuple(analyses))
    return trace_content(named, content, ranks=ranks)
