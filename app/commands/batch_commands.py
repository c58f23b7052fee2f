"""Commands that run a scene many times: study, converge, sweep, compare, identify. Heavy modules are imported
by the command that needs them.
"""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import click
import typer

from headstock.app.commands.options import (
    Debug,
    JsonFile,
    NoHost,
    NoWait,
    On,
    Overrides,
    Partition,
    Ranks,
    Sbatch,
    SceneFile,
    TimeLimit,
    Variant,
    check_cluster,
    choose_scene,
    on_cluster,
    read_percent,
    read_solid,
    split_list,
    trace_command,
)
from headstock.app.terminal.guard import run_guarded

if TYPE_CHECKING:
    from headstock.solvers.mpi import MPI

StudyFolder = Annotated[
    Path | None,
    typer.Option("-o", "--output", metavar="DIR", help="Folder of results [results/SCENE-NAME]."),
]


@on_cluster
def study(
    scene: SceneFile,
    name: Annotated[str, typer.Argument(metavar="NAME", help="One of the scene's [studies.NAME].")],
    output: StudyFolder = None,
    variant: Variant = None,
    set_: Overrides = None,
    ranks: Ranks = None,
    cold: Annotated[
        bool,
        typer.Option(
            "--cold",
            help="Compute every point from an empty store, so that its seconds are complete.",
        ),
    ] = False,
    repeats: Annotated[
        int | None,
        typer.Option(
            "--repeats",
            metavar="N",
            min=1,
            max=100,
            help="Runs per point, for median and spread of the times.",
        ),
    ] = None,
    retry: Annotated[bool, typer.Option("--retry", help="Compute failed points again.")] = False,
    no_host: NoHost = False,
    json: JsonFile = None,
    debug: Debug = False,
) -> int:
    """Vary keys of a scene and watch results; a stopped study continues."""

    def action(comm: "MPI.Comm") -> int:
        from headstock.app.actions.studying import StudyRequest, study_request

        chosen = choose_scene(scene, variant, set_)
        origin = trace_command(chosen, ranks=comm.size, with_host=not no_host)
        request = StudyRequest(
            scene=chosen,
            name=name,
            output=output,
            ranks=ranks,
            cold=cold,
            repeats=repeats,
            retry=retry,
            json_file=json,
        )
        return study_request(request, comm, origin)

    return run_guarded(action, debug=debug)


@on_cluster
def converge(
    scene: Annotated[
        Path, typer.Argument(metavar="FILE", help="Scene (.toml) or STEP part (.step, .stp).")
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", metavar="DIR", help="Folder of results [results/NAME-converge]."
        ),
    ] = None,
    accuracy: Annotated[
        str,
        typer.Option(
            "--accuracy", metavar="SHARE", help="Largest relative error of every number, as in 1%."
        ),
    ] = "1 %",
    watch: Annotated[
        list[str] | None,
        typer.Option(
            "--watch",
            metavar="NAME",
            help="Numbers to watch, such as frequency or 'compliance(*point=tcp*)' [frequencies, compliances].",
        ),
    ] = None,
    most_dofs: Annotated[
        int,
        typer.Option(
            "--most-dofs", metavar="N", min=1000, help="Approximate dofs of the finest mesh."
        ),
    ] = 300_000,
    most_seconds: Annotated[
        float,
        typer.Option(
            "--most-seconds", metavar="S", min=1.0, help="Approximate time of all meshes together."
        ),
    ] = 600.0,
    free: Annotated[
        bool,
        typer.Option("--free", help="Compute a STEP part without supports, not fixed at one end."),
    ] = False,
    solid: Annotated[
        str | None,
        typer.Option("--solid", metavar="NAME|N", help="Which solid of a STEP file with several."),
    ] = None,
    variant: Variant = None,
    set_: Overrides = None,
    ranks: Ranks = None,
    retry: Annotated[bool, typer.Option("--retry", help="Compute failed meshes again.")] = False,
    no_host: NoHost = False,
    json: JsonFile = None,
    debug: Debug = False,
) -> int:
    """Find how fine the mesh of a part or a machine must be; a stopped series continues."""
    share = read_percent(accuracy)
    words = click.get_current_context().find_root().obj

    def action(comm: "MPI.Comm") -> int:
        from headstock.app.actions.converging import ConvergeRequest, converge_request
        from headstock.studies.parameters.convergence import ConvergenceGoal

        request = ConvergeRequest(
            scene=choose_scene(scene, variant, set_),
            goal=ConvergenceGoal(share, most_dofs, most_seconds, tuple(watch or ())),
            solid=read_solid(solid),
            free=free,
            output=output,
            ranks=ranks,
            retry=retry,
            json_file=json,
            with_host=not no_host,
            command=words,
        )
        return converge_request(request, comm)

    return run_guarded(action, debug=debug)


def sweep(
    scene: SceneFile,
    name: Annotated[str, typer.Argument(metavar="NAME", help="One of the scene's [sweeps.NAME].")],
    output: StudyFolder = None,
    variant: Variant = None,
    set_: Overrides = None,
    ranks: Ranks = None,
    retry: Annotated[bool, typer.Option("--retry", help="Compute failed poses again.")] = False,
    on: On = None,
    tasks: Annotated[
        int | None,
        typer.Option("--tasks", metavar="N", min=1, max=1000, help="With --on: array tasks [4]."),
    ] = None,
    partition: Partition = None,
    time_limit: TimeLimit = None,
    sbatch: Sbatch = None,
    no_wait: NoWait = False,
    part: Annotated[
        str | None, typer.Option("--part", hidden=True, help="K/N: only this share of the poses.")
    ] = None,
    key: Annotated[
        str | None, typer.Option("--key", hidden=True, help="Of the sweep that was submitted.")
    ] = None,
    no_host: NoHost = False,
    json: JsonFile = None,
    debug: Debug = False,
) -> int:
    """Repeat a scene's analyses in every pose of a sweep; a stopped sweep continues."""
    check_cluster(on, tasks, partition, time_limit, sbatch, no_wait)

    def action(comm: "MPI.Comm") -> int:
        from headstock.app.actions.sweeping import SweepRequest, parse_part, sweep_request
        from headstock.studies.sweeps.slurm import SlurmOptions

        options = SlurmOptions(tasks or 4, ranks or 1, partition, time_limit, tuple(sbatch or ()))
        chosen = choose_scene(scene, variant, set_)
        origin = trace_command(chosen, ranks=comm.size, with_host=not no_host)
        request = SweepRequest(
            scene=chosen,
            name=name,
            output=output,
            ranks=ranks,
            retry=retry,
            json_file=json,
            cluster=options if on else None,
            wait=not no_wait,
            part=parse_part(part) if part else None,
            key=key,
        )
        return sweep_request(request, comm, origin)

    return run_guarded(action, debug=debug)


@on_cluster
def compare(
    scene: SceneFile,
    variants: Annotated[
        list[str] | None,
        typer.Option(
            "--variants",
            metavar="A,B,C",
            help="Variants [all]; A+B applies A, then B; 'as written' is the scene itself.",
        ),
    ] = None,
    baseline: Annotated[
        bool,
        typer.Option(
            "--baseline/--no-baseline",
            help="Compare the variants with the scene as written, or not.",
        ),
    ] = True,
    fidelity: Annotated[
        list[str] | None,
        typer.Option(
            "--fidelity",
            metavar="A,B",
            help="Fidelities of the elastic parts: rigid, segmented, elastic [all three without variants].",
        ),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", metavar="DIR", help="Folder of results [results/SCENE-compare]."
        ),
    ] = None,
    pose: Annotated[
        str | None, typer.Option("--pose", metavar="NAME", help="Pose [the first].")
    ] = None,
    reference: Annotated[
        str | None,
        typer.Option(
            "--reference", metavar="NAME", help="Column to compare with [the most detailed]."
        ),
    ] = None,
    effort: Annotated[
        bool,
        typer.Option(
            "--effort", help="Start each variant from an empty store, and show its times."
        ),
    ] = False,
    change: Annotated[
        list[str] | None,
        typer.Option(
            "--change",
            metavar="NAME",
            help="With --effort: also the times after this variant or KEY=VALUE; repeatable.",
        ),
    ] = None,
    set_: Overrides = None,
    ranks: Ranks = None,
    no_host: NoHost = False,
    json: JsonFile = None,
    debug: Debug = False,
) -> int:
    """Compare lumped models with finite elements, or variants of a scene: modes paired by shape,
    compliances, responses, weak links, seconds.
    """

    def action(comm: "MPI.Comm") -> int:
        from headstock.app.actions.comparing import CompareRequest, compare_request

        chosen = choose_scene(scene, None, set_)
        origin = trace_command(chosen, ranks=comm.size, with_host=not no_host)
        request = CompareRequest(
            scene=chosen,
            output=output,
            variants=split_list(variants),
            fidelities=split_list(fidelity),
            baseline=baseline,
            pose=pose,
            reference=reference,
            ranks=ranks,
            effort=effort,
            change=tuple(change or ()),
            json_file=json,
        )
        return compare_request(request, comm, origin)

    return run_guarded(action, debug=debug)


@on_cluster
def identify(
    scene: SceneFile,
    targets: Annotated[
        Path,
        typer.Argument(
            metavar="TARGETS", help="Target file (.toml): what was measured, what may be fitted."
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", metavar="DIR", help="Folder of results [results/SCENE-TARGETS]."
        ),
    ] = None,
    starts: Annotated[
        int | None,
        typer.Option(
            "--starts", metavar="N", min=1, max=4096, help="Number of starts [from the file]."
        ),
    ] = None,
    set_: Overrides = None,
    ranks: Ranks = None,
    no_host: NoHost = False,
    json: JsonFile = None,
    debug: Debug = False,
) -> int:
    """Fit parameters of a scene to measured frequencies, shapes and compliances; the scene file is
    not changed.
    """

    def action(comm: "MPI.Comm") -> int:
        from headstock.app.actions.identifying import IdentifyRequest, identify_request

        chosen = choose_scene(scene, None, set_)
        origin = trace_command(chosen, ranks=comm.size, with_host=not no_host)
        request = IdentifyRequest(
            scene=chosen,
            targets=targets,
            output=output,
            starts=starts,
            ranks=ranks,
            json_file=json,
        )
        return identify_request(request, comm, origin)

    return run_guarded(action, debug=debug)
