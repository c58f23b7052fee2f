"""A machine many times over, or beside a measured one, in the same way as by the command of the same name:
``study``, ``sweep``, ``compare``, ``fit_modes``, ``correlate`` and ``identify``.

All of it is collective under MPI: every rank calls it with the same arguments and gets the same
answer. An error on one rank leaves the others waiting: start with ``mpirun python -m mpi4py``.
"""

import contextlib
import dataclasses
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import cast

from headstock.arguments import (
    check_call,
    naming_arguments,
    read_keys,
    read_name,
    read_names,
    read_path_argument,
    refuse,
)
from headstock.geometry.parts.components import Fidelity
from headstock.loading import Source, take_machine
from headstock.machine import Machine, write_setting
from headstock.pipeline.planning.plan import StageRecord
from headstock.pipeline.storage.store import Store, default_store_root
from headstock.runs import claim_folder
from headstock.scene.building.loader import build_scene, load_scene, prepare_sweep
from headstock.scene.reading.files import TomlTable
from headstock.scene.reading.findings import Findings, suggest_names
from headstock.scene.reading.watch_paths import MEASURED_NAMES
from headstock.scene.scene import require_name
from headstock.scene.studies import Study
from headstock.scene.test_data.reading import read_test_data
from headstock.solvers.errors import ModelError
from headstock.solvers.mpi import MPI
from headstock.solvers.ranks import make_on_root, share_from_root
from headstock.studies.comparison import Comparison, compare_variants
from headstock.studies.correlation.correlation import WITHIN, Correlation
from headstock.studies.correlation.job import CorrelationJob, load_correlation, run_correlation
from headstock.studies.correlation.modal_fit import LEAST_ORDER, ORDER, ModalFit, read_modes
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

UNNAMED = "study"  # a study that is described in Python


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
    made = take_machine(machine, "study")
    if name is None:
        chosen = _describe_study(made, vary, watch, pairwise=pairwise)
    elif vary is None and not watch:
        read_name(name, "study", "name")
        require_name(made.scene, "studies", name, made.scene.studies)
        chosen = made.scene.studies[name]
    else:
        raise refuse("study", "name", "give the name of a study or vary and watch, not both")
    with made.on_disk() as choice, claim_folder("study", output, comm) as folder:
        job = StudyJob(
            path=choice.path,
            study=chosen,
            raw=made.scene.raw,
            content=hash_scene(choice.path),
            variant=choice.variant,
            overrides=choice.overrides,
        )
        with (
            naming_arguments("study", f"studies.{UNNAMED}")
            if name is None
            else contextlib.nullcontext()
        ):
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
    made = take_machine(machine, "sweep")
    read_name(name, "sweep", "name")
    require_name(made.scene, "sweeps", name, made.scene.sweeps)
    chosen = made.scene.sweeps[name]
    with made.on_disk() as choice, claim_folder("sweep", output, comm) as folder:
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
    with take_machine(machine, "compare").on_disk() as file:
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


def correlate(
    machine: Source,
    test: str | Path,
    *,
    variant: str | None = None,
    pose: str | None = None,
    within: float = WITHIN,
    like: str | Path | None = None,
    comm: MPI.Comm | None = None,
    progress: Callable[[StageRecord], None] = lambda record: None,
) -> Correlation:
    """Compare a measured machine with its model, modes paired by their shapes.

    Args:
        machine: Machine or path of a scene file.
        test: Test file, such as ``.uff``.
        variant: Name; several joined by ``+``. None for the machine as it is.
        pose: Name; None for the first.
        within: Relative deviation up to which a frequency counts as met.
        like: Target file of a test before the machine was modified, whose shapes name the modes.
        comm: Ranks that compute together; all that were started where None.
        progress: Called with each stage that has ended, on rank 0.

    Returns:
        The same on every rank.

    Raises:
        SceneError: The machine has problems.
        HeadstockError: The test file has, or a computation failed.
    """
    check_call(progress, "correlate")
    comm, path = comm or MPI.COMM_WORLD, read_path_argument(test, "correlate", "test")
    if not isinstance(within, float) or not 0.0 < within < 1.0:
        raise refuse("correlate", "within", f"is {within!r}; write a share such as 0.05")
    base = None if like is None else read_path_argument(like, "correlate", "like")
    made = take_machine(machine, "correlate")
    with (made if variant is None else made.change(variant=variant)).on_disk() as file:
        job = CorrelationJob(file, path, pose, within, like=base)
        loaded, store = load_correlation(job), Store(default_store_root())
        found = run_correlation(loaded, store, comm, observer=progress)
        return share_from_root(comm, found)


def fit_modes(
    test: str | Path,
    *,
    band: tuple[float, float] | None = None,
    order: int = ORDER,
    references: Sequence[str] | str = (),
    progress: Callable[[str], None] = lambda text: None,
) -> ModalFit:
    """Fit poles, damping and shapes to the frequency responses of a test.

    Args:
        test: Test file, such as ``.uff``.
        band: Lowest and highest frequency that is used [Hz]; all lines by default.
        order: Highest order of the stabilisation diagram.
        references: Points or channels, such as ``3`` or ``3:+z``, that are used; all by default.
        progress: Called with what is done.

    Raises:
        SceneError: An argument is none.
        HeadstockError: The test file has problems, or nothing to fit.
    """
    check_call(progress, "fit_modes")
    path = read_path_argument(test, "fit_modes", "test")
    if band is not None and not (len(band) == 2 and 0.0 <= band[0] < band[1]):
        raise refuse("fit_modes", "band", f"is {band!r}; write (low, high) in Hz")
    if not isinstance(order, int) or order < LEAST_ORDER:
        raise refuse("fit_modes", "order", f"is {order!r}; write a number from {LEAST_ORDER} on")
    return read_modes(
        read_test_data(path),
        path.name,
        band=band,
        order=order,
        references=read_names(references, "fit_modes", "references"),
        progress=progress,
    )


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
    with take_machine(machine, "identify").on_disk() as file:
        loaded = load_targets(path, file.path, overrides=file.overrides, starts=starts)
        problem = prepare_problem(loaded, Store(default_store_root()), comm)
        return fit_parameters(problem, loaded.task.name, progress, comm=comm)


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
    with naming_arguments("study", f"studies.{UNNAMED}"):
        scene = build_scene(raw, Findings("hs.study"), path=made.scene.path)
    return dataclasses.replace(scene.studies[UNNAMED], watch=watched)
