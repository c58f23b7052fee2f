"""Commands on one scene: check, plan, run, effects, export. Heavy modules are imported by the
command that needs them.
"""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import click
import typer

from headstock.app.commands.options import (
    Accuracy,
    Debug,
    Fidelities,
    JsonFile,
    Names,
    NoHost,
    Overrides,
    Ranks,
    SceneFile,
    Variant,
    choose_scene,
    on_cluster,
    split_list,
    trace_command,
    write_json_file,
)
from headstock.app.terminal.guard import run_guarded

if TYPE_CHECKING:
    from headstock.solvers.mpi import MPI


def check(
    scene: SceneFile,
    variant: Variant = None,
    set_: Overrides = None,
    json: JsonFile = None,
    debug: Debug = False,
) -> int:
    """Check a scene and list every problem; nothing is computed."""

    def action() -> int:
        from headstock.app.actions.checking import check_scene

        return check_scene(scene, variant, set_ or [], json)

    return run_guarded(action, debug=debug)


def plan(
    scene: SceneFile,
    variant: Variant = None,
    analysis: Names = None,
    set_: Overrides = None,
    accuracy: Accuracy = None,
    fidelity: Fidelities = None,
    json: JsonFile = None,
    debug: Debug = False,
) -> int:
    """Print the stages of a run, with reasons, dofs and memory."""

    def action() -> int:
        from headstock.app.actions.checking import plan_rows
        from headstock.app.actions.choosing import choose_fidelity, load_chosen
        from headstock.app.terminal.console import print_remarks
        from headstock.app.terminal.progress import show_progress
        from headstock.app.terminal.summary import print_plan
        from headstock.pipeline.planning.planner import plan_scene
        from headstock.pipeline.planning.reductions import add_compiling
        from headstock.scene.analyses.lobes import require_feed_of_run

        chosen = choose_scene(scene, variant, set_, analysis)
        if fidelity is not None:
            chosen, kept = choose_fidelity(chosen, fidelity)
            print_remarks(kept)
        loaded = load_chosen(chosen, accuracy)
        require_feed_of_run(loaded)
        if loaded.accuracy is None:
            with show_progress() as progress:

                def tell(component: str) -> None:
                    progress.end()
                    progress.begin(f"survey of the surface of {component}")

                planned = plan_scene(loaded, survey=True, before_survey=tell)
        else:
            from headstock.pipeline.accuracy.search import plan_first_round  # it loads the solvers

            planned = plan_first_round(loaded)
        planned = add_compiling(planned, loaded)
        print_plan(loaded.name, planned)
        write_json_file(json, plan_rows(planned))
        return 0

    return run_guarded(action, debug=debug)


@on_cluster
def run(
    scene: SceneFile,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="DIR", help="Folder of results [results/NAME]."),
    ] = None,
    variant: Variant = None,
    analysis: Names = None,
    set_: Overrides = None,
    ranks: Ranks = None,
    no_figures: Annotated[
        bool,
        typer.Option("--no-figures", help="Draw no pictures of the machine: saves about a second."),
    ] = False,
    volume: Annotated[
        bool,
        typer.Option(
            "--volume",
            help="Write volume meshes with modes, static responses and stresses, too (volume/*.vtu).",
        ),
    ] = False,
    accuracy: Accuracy = None,
    fidelity: Fidelities = None,
    no_host: NoHost = False,
    json: JsonFile = None,
    debug: Debug = False,
) -> int:
    """Run a scene: static compliance with its budget, natural modes, frequency responses."""

    def action(comm: "MPI.Comm") -> int:
        from headstock.app.actions.choosing import choose_fidelity
        from headstock.app.actions.running import RunRequest, run_request
        from headstock.app.terminal.console import print_remarks
        from headstock.solvers.ranks import make_on_root

        chosen = choose_scene(scene, variant, set_, analysis)
        if fidelity is not None:
            start, wanted = chosen, fidelity
            chosen, kept = make_on_root(comm, lambda: choose_fidelity(start, wanted))
            if comm.rank == 0:
                print_remarks(kept)
        request = RunRequest(
            scene=chosen,
            output=output,
            ranks=ranks,
            json_file=json,
            figures=not no_figures,
            accuracy=accuracy,
            volume=volume,
            fidelity=fidelity,
        )
        asked = [f"accuracy={accuracy}"] if accuracy is not None else []
        traced = choose_scene(scene, variant, [*chosen.overrides, *asked], analysis)
        origin = trace_command(traced, ranks=comm.size, with_host=not no_host)
        return run_request(request, comm, origin)

    return run_guarded(action, debug=debug)


@on_cluster
def effects(
    scene: SceneFile,
    variant: Variant = None,
    analysis: Names = None,
    set_: Overrides = None,
    only: Annotated[
        list[str] | None,
        typer.Option(
            "--only",
            metavar="A,B",
            help="Try these only: effects, elasticity, interfaces, modes, mesh, pose.",
        ),
    ] = None,
    list_: Annotated[
        bool, typer.Option("--list", help="List what would be tried; nothing is computed.")
    ] = False,
    write: Annotated[
        bool,
        typer.Option("--write", help="Write what may be dropped as a variant of the scene."),
    ] = False,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", metavar="FILE", help="Scene file of --write [SCENE_good_enough.toml]."
        ),
    ] = None,
    force: Annotated[
        bool, typer.Option("--force", help="Let --write replace a file that is there.")
    ] = False,
    page: Annotated[
        Path | None,
        typer.Option("--page", metavar="FILE", help="Write a page with the chart as HTML."),
    ] = None,
    report: Annotated[
        Path | None,
        typer.Option(
            "--report", metavar="DIR", help="Show it in the report of a finished run of the scene."
        ),
    ] = None,
    ranks: Ranks = None,
    no_host: NoHost = False,
    json: JsonFile = None,
    debug: Debug = False,
) -> int:
    """Switch each effect on or off and change each part of the model: worth, price, verdict."""

    def action(comm: "MPI.Comm") -> int:
        from headstock.app.actions.effecting import EffectsRequest, effects_request

        chosen = choose_scene(scene, variant, set_, analysis)
        origin = trace_command(chosen, ranks=comm.size, with_host=not no_host)
        request = EffectsRequest(
            scene=chosen,
            only=split_list(only),
            listed=list_,
            write=write,
            output=output,
            force=force,
            ranks=ranks,
            json_file=json,
            page=page,
            report=report,
            origin=origin,
        )
        return effects_request(request, comm)

    return run_guarded(action, debug=debug)


def export(
    scene: SceneFile,
    component: Annotated[
        str | None, typer.Argument(metavar="[COMPONENT]", help="Component to reduce or to mesh.")
    ] = None,
    mesh: Annotated[
        Path | None,
        typer.Option(
            "--mesh",
            metavar="FILE",
            help="Write the component's mesh with its patches: .xdmf, .exo, .med, .bdf or .msh.",
        ),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", metavar="FILE", help="File to write [COMPONENT.h5, SCENE.mat]."
        ),
    ] = None,
    state_space: Annotated[
        str | None,
        typer.Option(
            "--state-space",
            metavar="HZ",
            help='State space with modes up to here, such as "500 Hz".',
        ),
    ] = None,
    pose: Annotated[
        str | None,
        typer.Option("--pose", metavar="NAME", help="Pose of the state space [the first]."),
    ] = None,
    variant: Variant = None,
    set_: Overrides = None,
    ranks: Ranks = None,
    no_host: NoHost = False,
    debug: Debug = False,
) -> int:
    """Write one component as a superelement file for other scenes or as a mesh for other programs,
    or the machine's state space as a file for MATLAB.
    """
    if mesh is not None and (output is not None or state_space is not None):
        raise click.UsageError("--mesh FILE goes without -o and --state-space")
    if mesh is None and (component is None) == (state_space is None):
        raise click.UsageError(
            "name a component to reduce, write --mesh FILE for its mesh, or "
            '--state-space "500 Hz" for the whole machine'
        )

    def action(comm: "MPI.Comm") -> int:
        from headstock.app.actions.exporting import (
            ExportRequest,
            export_component,
            export_component_mesh,
            export_machine,
        )

        default = Path(f"{component}.h5") if component is not None else Path(f"{scene.stem}.mat")
        chosen = choose_scene(scene, variant, set_)
        origin = trace_command(chosen, ranks=comm.size, with_host=not no_host)
        request = ExportRequest(
            scene=chosen,
            component=component or "",
            output=mesh or output or default,
            ranks=ranks,
            origin=origin,
        )
        if mesh is not None:
            return export_component_mesh(request, component, comm)
        return (
            export_component(request, comm)
            if state_space is None
            else export_machine(request, state_space, pose, comm)
        )

    return run_guarded(action, debug=debug)
