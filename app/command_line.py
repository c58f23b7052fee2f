"""The command line: a thin skin over the Python API. Heavy modules are imported by the command that needs them."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import click
import typer

from headstock.app.guard import PIPE_CLOSED, leave_closed_pipe, open_missing_streams, run_guarded

if TYPE_CHECKING:
    from mpi4py import MPI

    from headstock.pipeline.scene import Scene

PROGRAM = "headstock"
PROGRAM_HELP = """A FEM-based virtual machine tool: from one scene file to a machine's stiffness and modes.

`headstock test [pytest arguments]` runs the tests.

Exit codes: 0 done, 1 a computation failed (named error), 2 bad input.
"""

app = typer.Typer(name=PROGRAM, help=PROGRAM_HELP, no_args_is_help=True, add_completion=False, rich_markup_mode=None)

SceneFile = Annotated[Path, typer.Argument(metavar="SCENE", help="Scene file (.toml).")]
Variant = Annotated[
    str | None, typer.Option("--variant", metavar="NAME", help="Apply a variant of the scene; A+B applies A, then B.")
]
Overrides = Annotated[list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Override a key of the scene; repeatable.")]
JsonFile = Annotated[Path | None, typer.Option("--json", metavar="FILE", help="Write what is printed as JSON too.")]
Debug = Annotated[bool, typer.Option("--debug", help="Show tracebacks.")]
Ranks = Annotated[int | None, typer.Option("--ranks", metavar="N", min=1, help="MPI ranks; the launcher starts them.")]
Names = Annotated[list[str] | None, typer.Option("--analysis", metavar="NAME", help="Run this analysis only; repeatable.")]


def _list_campaigns() -> list[str]:
    return ["kill", "resume", "disk", "fuzz", "files", "slurm"]


def _list_shells() -> list[str]:
    return ["bash", "zsh", "fish"]


@app.command()
def check(scene: SceneFile, variant: Variant = None, set_: Overrides = None, json: JsonFile = None, debug: Debug = False) -> int:
    """Check a scene: every problem at once, nothing computed."""

    def action() -> int:
        from headstock.app.checking import check_scene

        return check_scene(scene, variant, set_ or [], json)

    return run_guarded(action, debug=debug)


@app.command()
def plan(scene: SceneFile, variant: Variant = None, set_: Overrides = None, json: JsonFile = None, debug: Debug = False) -> int:
    """Print the stages a scene calls for, with reasons, dofs and memory."""

    def action() -> int:
        from headstock.app.console import print_plan
        from headstock.app.plan_listing import plan_rows
        from headstock.pipeline.planner import plan_scene

        loaded = _load(scene, variant, set_)
        planned = plan_scene(loaded)
        print_plan(loaded.name, planned)
        _write_json(json, plan_rows(planned))
        return 0

    return run_guarded(action, debug=debug)


@app.command()
def run(
    scene: SceneFile,
    output: Annotated[Path | None, typer.Option("-o", "--output", metavar="DIR", help="Folder of results [results/NAME].")] = None,
    variant: Variant = None,
    analysis: Names = None,
    set_: Overrides = None,
    ranks: Ranks = None,
    no_figures: Annotated[
        bool, typer.Option("--no-figures", help="Draw no pictures of the machine: saves about a second.")
    ] = False,
    accuracy: Annotated[
        str | None,
        typer.Option("--accuracy", metavar="SHARE", help="Choose meshes and modes so that no number is off by more, such as 1%."),
    ] = None,
    json: JsonFile = None,
    debug: Debug = False,
) -> int:
    """Run a scene: static compliance with its budget, natural modes, and what each cost."""

    def action(comm: "MPI.Comm") -> int:
        from headstock.app.running import RunRequest, run_request

        request = RunRequest(
            scene, output, variant, tuple(analysis or ()), tuple(set_ or ()), ranks, json, not no_figures, accuracy
        )
        return run_request(request, comm)

    return run_guarded(action, debug=debug)


@app.command()
def study(
    scene: SceneFile,
    name: Annotated[str, typer.Argument(metavar="NAME", help="One of the scene's [studies.NAME].")],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="DIR", help="Folder of results [results/SCENE-NAME].")
    ] = None,
    variant: Variant = None,
    set_: Overrides = None,
    ranks: Ranks = None,
    cold: Annotated[
        bool, typer.Option("--cold", help="Compute every point from an empty store, so that its seconds are all of them.")
    ] = False,
    repeats: Annotated[
        int | None, typer.Option("--repeats", metavar="N", min=1, max=100, help="Runs per point, for median and spread of seconds.")
    ] = None,
    retry: Annotated[bool, typer.Option("--retry", help="Compute failed points again.")] = False,
    json: JsonFile = None,
    debug: Debug = False,
) -> int:
    """Vary keys of a scene and watch results; a study that was stopped goes on where it was."""

    def action(comm: "MPI.Comm") -> int:
        from headstock.app.studying import StudyRequest, study_request

        settings = (output, variant, tuple(set_ or ()), ranks)
        return study_request(StudyRequest(scene, name, *settings, cold=cold, repeats=repeats, retry=retry, json_file=json), comm)

    return run_guarded(action, debug=debug)


@app.command()
def sweep(
    scene: SceneFile,
    name: Annotated[str, typer.Argument(metavar="NAME", help="One of the scene's [sweeps.NAME].")],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="DIR", help="Folder of results [results/SCENE-NAME].")
    ] = None,
    variant: Variant = None,
    set_: Overrides = None,
    ranks: Ranks = None,
    retry: Annotated[bool, typer.Option("--retry", help="Compute failed poses again.")] = False,
    on: Annotated[str | None, typer.Option("--on", metavar="slurm", help="Compute in an array job of this cluster.")] = None,
    tasks: Annotated[int | None, typer.Option("--tasks", metavar="N", min=1, max=1000, help="With --on: array tasks [4].")] = None,
    partition: Annotated[str | None, typer.Option("--partition", metavar="NAME", help="With --on: where to.")] = None,
    time_limit: Annotated[
        str | None, typer.Option("--time", metavar="LIMIT", help="With --on: of each task, as in 0:30:00.")
    ] = None,
    sbatch: Annotated[
        list[str] | None, typer.Option("--sbatch", metavar="OPTION", help="With --on: as in --sbatch=--account=ours; repeatable.")
    ] = None,
    no_wait: Annotated[bool, typer.Option("--no-wait", help="With --on: submit only; the same command again collects.")] = False,
    part: Annotated[str | None, typer.Option("--part", hidden=True, help="K/N: only this share of the poses.")] = None,
    key: Annotated[str | None, typer.Option("--key", hidden=True, help="Of the sweep that was submitted.")] = None,
    json: JsonFile = None,
    debug: Debug = False,
) -> int:
    """Repeat a scene's analyses in every pose of a sweep; one that was stopped goes on where it was."""
    if on not in (None, "slurm"):
        raise click.UsageError(f"--on {on} is not known; write --on slurm")
    if on is None and (tasks or partition or time_limit or sbatch or no_wait):
        raise click.UsageError("--tasks, --partition, --time, --sbatch and --no-wait go with --on slurm")

    def action(comm: "MPI.Comm") -> int:
        from headstock.app.sweep_parts import parse_part
        from headstock.app.sweeping import SweepRequest, sweep_request
        from headstock.pipeline.slurm_jobs import SlurmOptions

        options = SlurmOptions(tasks or 4, ranks or 1, partition, time_limit, tuple(sbatch or ()))
        cluster = (options if on else None, not no_wait, parse_part(part) if part else None, key)
        return sweep_request(SweepRequest(scene, name, output, variant, tuple(set_ or ()), ranks, retry, json, *cluster), comm)

    return run_guarded(action, debug=debug)


@app.command()
def effects(
    scene: SceneFile,
    variant: Variant = None,
    analysis: Names = None,
    set_: Overrides = None,
    json: JsonFile = None,
    debug: Debug = False,
) -> int:
    """Run a scene with each effect switched the other way: how much it moves every answer, and what it costs."""

    def action() -> int:
        from headstock.app.effecting import EffectsRequest, effects_request
        from headstock.pipeline.effect_trials import ScenePlan

        return effects_request(EffectsRequest(ScenePlan(scene, variant, tuple(set_ or ()), tuple(analysis or ())), json))

    return run_guarded(action, debug=debug)


@app.command()
def compare(
    scene: SceneFile,
    variants: Annotated[
        str | None, typer.Option("--variants", metavar="A,B,C", help="These variants [all]; A+B joins, 'as written' is none.")
    ] = None,
    fidelity: Annotated[
        str | None,
        typer.Option("--fidelity", metavar="A,B", help="Each variant with its elastic parts rigid, segmented or elastic."),
    ] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="DIR", help="Folder of results [results/SCENE-compare].")
    ] = None,
    pose: Annotated[str | None, typer.Option("--pose", metavar="NAME", help="Pose [the first].")] = None,
    reference: Annotated[str | None, typer.Option("--reference", metavar="NAME", help="Column to hold the others against.")] = None,
    effort: Annotated[
        bool, typer.Option("--effort", help="Begin each variant from an empty store, and show what it costs.")
    ] = False,
    change: Annotated[
        list[str] | None,
        typer.Option("--change", metavar="NAME", help="With --effort: also after this variant or KEY=VALUE; repeatable."),
    ] = None,
    set_: Overrides = None,
    ranks: Ranks = None,
    json: JsonFile = None,
    debug: Debug = False,
) -> int:
    """Hold variants of a scene side by side: modes paired by shape, compliances, weak links, dofs, seconds."""

    def action(comm: "MPI.Comm") -> int:
        from headstock.app.comparing import CompareRequest, compare_request

        lists = (_split_list(variants), _split_list(fidelity), tuple(set_ or ()))
        return compare_request(
            CompareRequest(
                scene, output, *lists, pose, reference, ranks, effort=effort, change=tuple(change or ()), json_file=json
            ),
            comm,
        )

    return run_guarded(action, debug=debug)


@app.command()
def show(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="STEP file (.step, .stp) or scene (.toml).")],
    output: Annotated[Path | None, typer.Option("-o", "--output", metavar="PNG", help="Picture [NAME_faces.png].")] = None,
    solid: Annotated[str | None, typer.Option("--solid", metavar="NAME|N", help="Which solid of a STEP file with several.")] = None,
    component: Annotated[str | None, typer.Option("--component", metavar="NAME", help="This STEP component of a scene.")] = None,
    every_face: Annotated[bool, typer.Option("--all", help="List every face, not only the largest.")] = False,
    json: JsonFile = None,
    debug: Debug = False,
) -> int:
    """Draw a STEP part with numbered faces and suggest interfaces, or draw the machine of a scene."""

    def action() -> int:
        from headstock.app.showing import ShowRequest, show_file

        return show_file(ShowRequest(file, output, _read_solid(solid), component, every_face, json))

    return run_guarded(action, debug=debug)


@app.command()
def new(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Folder to make.")],
    part: Annotated[Path | None, typer.Option("--part", metavar="STEP", help="STEP part to start from; it is copied.")] = None,
    solid: Annotated[str | None, typer.Option("--solid", metavar="NAME|N", help="Which solid of a STEP file with several.")] = None,
    debug: Debug = False,
) -> int:
    """Make a folder with a commented scene that runs as it is."""

    def action() -> int:
        from headstock.app.starting import StartRequest, start_scene

        return start_scene(StartRequest(folder, part, _read_solid(solid)))

    return run_guarded(action, debug=debug)


@app.command()
def export(
    scene: SceneFile,
    component: Annotated[str | None, typer.Argument(metavar="[COMPONENT]", help="Component to reduce.")] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE", help="File to write [COMPONENT.h5, SCENE.mat].")
    ] = None,
    state_space: Annotated[
        str | None, typer.Option("--state-space", metavar="HZ", help='State space with modes up to here, such as "500 Hz".')
    ] = None,
    pose: Annotated[str | None, typer.Option("--pose", metavar="NAME", help="Pose of the state space [the first].")] = None,
    variant: Variant = None,
    set_: Overrides = None,
    ranks: Ranks = None,
    debug: Debug = False,
) -> int:
    """Write one component as a superelement file for other scenes, or the machine's state space as a file for MATLAB."""
    if (component is None) == (state_space is None):
        raise click.UsageError('name a component to reduce, or write --state-space "500 Hz" for the whole machine')

    def action(comm: "MPI.Comm") -> int:
        from headstock.app.exporting import ExportRequest, export_component, export_machine

        default = Path(f"{component}.h5") if component is not None else Path(f"{scene.stem}.mat")
        request = ExportRequest(scene, component or "", output or default, variant, tuple(set_ or ()), ranks)
        return export_component(request, comm) if state_space is None else export_machine(request, state_space, pose, comm)

    return run_guarded(action, debug=debug)


@app.command()
def validate(
    cases: Annotated[list[str] | None, typer.Argument(metavar="[CASE]...", help="Cases or groups; all when none is named.")] = None,
    output: Annotated[Path | None, typer.Option("-o", "--output", metavar="DIR", help="Folder for figures of cases.")] = None,
    json: JsonFile = None,
    ranks: Ranks = None,
    debug: Debug = False,
) -> int:
    """Hold computed numbers against closed forms and published values."""

    def action(comm: "MPI.Comm") -> int:
        from headstock.app.validating import validate_cases

        return validate_cases(cases or [], json, ranks, comm, output)

    return run_guarded(action, debug=debug)


@app.command()
def identify(
    scene: SceneFile,
    targets: Annotated[Path, typer.Argument(metavar="TARGETS", help="Target file (.toml): what was measured, what may be fitted.")],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="DIR", help="Folder of results [results/SCENE-TARGETS].")
    ] = None,
    starts: Annotated[
        int | None, typer.Option("--starts", metavar="N", min=1, max=4096, help="Starts, instead of the file's.")
    ] = None,
    set_: Overrides = None,
    json: JsonFile = None,
    debug: Debug = False,
) -> int:
    """Fit numbers of a scene to measured frequencies, shapes and compliances; the scene file is not changed."""

    def action() -> int:
        from headstock.app.identifying import IdentifyRequest, identify_scene

        return identify_scene(IdentifyRequest(scene, targets, output, starts, tuple(set_ or ()), json))

    return run_guarded(action, debug=debug)


@app.command()
def report(folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of results.")], debug: Debug = False) -> int:
    """Write the report of a finished run again, with a PNG of every mode and chart in DIR/figures."""

    def action() -> int:
        from headstock.app.console import print_remarks
        from headstock.app.publishing import publish_again
        from headstock.pipeline.result_files import REPORT_FILE, claim_output, read_curves, read_paths, read_summary, read_view

        summary = read_summary(folder)
        with claim_output(folder):
            print_remarks(publish_again(folder, summary, read_view(folder), read_curves(folder), read_paths(folder)))
        typer.echo(folder / REPORT_FILE)
        return 0

    return run_guarded(action, debug=debug)


@app.command()
def doctor(json: JsonFile = None, debug: Debug = False) -> int:
    """Check the environment: libraries, MPI, memory, caches."""

    def action() -> int:
        from headstock.app.doctor import run_doctor

        return run_doctor(json)

    return run_guarded(action, debug=debug)


@app.command()
def schema(
    markdown: Annotated[bool, typer.Option("--markdown", help="Print the scene reference instead.")] = False,
    json: JsonFile = None,
    debug: Debug = False,
) -> int:
    """Print the JSON schema of scene files."""

    def action() -> int:
        from headstock.app.scene_reference import render_reference
        from headstock.pipeline.results import dump_json
        from headstock.pipeline.scene_schema import schema_json

        content = schema_json()
        typer.echo(render_reference(content) if markdown else dump_json(content), nl=False)
        _write_json(json, content)
        return 0

    return run_guarded(action, debug=debug)


@app.command()
def campaign(
    name: Annotated[
        str, typer.Argument(metavar="NAME", help="kill, resume, disk, fuzz, files or slurm.", autocompletion=_list_campaigns)
    ],
    runs: Annotated[
        int | None, typer.Option("--runs", metavar="N", min=1, help="How many trials [200, 20, 100000, 500, 4].")
    ] = None,
    seed: Annotated[int, typer.Option("--seed", metavar="N", help="Of everything random.")] = 1,
    json: JsonFile = None,
    debug: Debug = False,
) -> int:
    """Try faults on purpose: killed runs, full disks, damaged scenes, damaged files, disturbed jobs of a real Slurm."""

    def action() -> int:
        from headstock.app.campaigning import run_campaign

        return run_campaign(name, runs, seed, json)

    return run_guarded(action, debug=debug)


@app.command()
def completion(
    shell: Annotated[str, typer.Argument(metavar="SHELL", help="bash, zsh or fish.", autocompletion=_list_shells)],
) -> int:
    """Print a script that completes commands with the Tab key: source <(./headstock completion bash)."""
    from headstock.app.shell_completion import SCRIPTS

    if shell not in SCRIPTS:
        raise click.UsageError(f"no completion for {shell!r}; there is one for: {', '.join(SCRIPTS)}")
    typer.echo(SCRIPTS[shell], nl=False)
    return 0


@app.command("test", context_settings={"ignore_unknown_options": True, "allow_extra_args": True})
def refuse_test(arguments: Annotated[list[str] | None, typer.Argument(metavar="[PYTEST ARGUMENTS]...")] = None) -> int:
    """Run the tests (the launcher ./headstock does this itself)."""
    raise click.UsageError("start the tests through the launcher: ./headstock test")


def main(arguments: list[str] | None = None) -> int:
    """Run a command line and return its exit code."""
    open_missing_streams()
    try:
        code = typer.main.get_command(app).main(args=arguments, prog_name=PROGRAM, standalone_mode=False)
    except click.ClickException as error:
        error.show()
        return error.exit_code
    except (click.Abort, KeyboardInterrupt):
        typer.echo("interrupted", err=True)
        return 130
    except BrokenPipeError:
        leave_closed_pipe()
        return PIPE_CLOSED
    return int(code or 0)


def _read_solid(text: str | None) -> int | str | None:
    return int(text) if text is not None and text.isdecimal() else text


def _split_list(text: str | None) -> tuple[str, ...]:
    return tuple(part.strip() for part in (text or "").split(",") if part.strip())


def _load(scene: Path, variant: str | None, overrides: list[str] | None) -> "Scene":
    from headstock.pipeline.scene_loader import load_scene

    return load_scene(scene, variant=variant, overrides=overrides or [])


def _write_json(path: Path | None, content: Any) -> None:
    if path is not None:
        from headstock.pipeline.result_files import write_output
        from headstock.pipeline.results import dump_json

        write_output(path, dump_json(content).encode())


if __name__ == "__main__":
    sys.exit(main())
