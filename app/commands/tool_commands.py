"""Commands beside a scene: parts, validation, reports, the environment. Heavy modules are imported
by the command that needs them.
"""

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import click
import typer

from headstock.app.commands.options import (
    Debug,
    JsonFile,
    Overrides,
    Ranks,
    Variant,
    read_solid,
    write_json_file,
)
from headstock.app.terminal.guard import run_guarded

if TYPE_CHECKING:
    from headstock.solvers.mpi import MPI


class SchemaKind(StrEnum):
    """Files that have a schema."""

    scene = "scene"
    targets = "targets"


def show(
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="STEP or mesh file, or scene (.toml).")
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", metavar="PNG", help="Picture [NAME_faces.png or NAME_machine.png]."
        ),
    ] = None,
    variant: Variant = None,
    set_: Overrides = None,
    pose: Annotated[
        str | None, typer.Option("--pose", metavar="NAME", help="Pose of a scene [the first].")
    ] = None,
    window: Annotated[
        bool, typer.Option("--window", help="Show the machine in an interactive window.")
    ] = False,
    solid: Annotated[
        str | None,
        typer.Option(
            "--solid",
            metavar="NAME|N",
            help="Which solid of a STEP file, set of cells of a mesh file, or * for all.",
        ),
    ] = None,
    unit: Annotated[
        str | None,
        typer.Option("--unit", metavar="LENGTH", help="Length unit of a mesh file, as 1 mm."),
    ] = None,
    component: Annotated[
        str | None,
        typer.Option("--component", metavar="NAME", help="This component of a scene."),
    ] = None,
    every_face: Annotated[
        bool, typer.Option("--all", help="List every face, not only the largest.")
    ] = False,
    json: JsonFile = None,
    debug: Debug = False,
) -> int:
    """Draw a part with numbered faces and suggest interfaces, or the machine of a scene with
    its joints and points, before anything is computed.
    """

    def action() -> int:
        from headstock.app.actions.showing import ShowRequest, show_file

        return show_file(
            ShowRequest(
                path=file,
                variant=variant,
                overrides=tuple(set_ or ()),
                pose=pose,
                window=window,
                picture=output,
                solid=read_solid(solid),
                component=component,
                every_face=every_face,
                json_file=json,
                unit=unit,
            )
        )

    return run_guarded(action, debug=debug)


def new(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Folder to make.")],
    part: Annotated[
        Path | None,
        typer.Option(
            "--part", metavar="FILE", help="STEP or mesh file to start from; it is copied."
        ),
    ] = None,
    solid: Annotated[
        str | None,
        typer.Option(
            "--solid",
            metavar="NAME|N",
            help="Which solid of a STEP file, set of cells of a mesh file, or * for all.",
        ),
    ] = None,
    unit: Annotated[
        str | None,
        typer.Option("--unit", metavar="LENGTH", help="Length unit of a mesh file, as 1 mm."),
    ] = None,
    debug: Debug = False,
) -> int:
    """Make a folder with a commented scene that can be run."""

    def action() -> int:
        from headstock.app.actions.starting import StartRequest, start_scene

        return start_scene(
            StartRequest(folder=folder, part=part, solid=read_solid(solid), unit=unit)
        )

    return run_guarded(action, debug=debug)


def validate(
    cases: Annotated[
        list[str] | None,
        typer.Argument(metavar="[CASE]...", help="Cases or groups; all when none is named."),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="DIR", help="Folder for figures of cases."),
    ] = None,
    seed: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            min=0,
            help="Compare what is drawn from this seed on (coverage, model-estimates): what no factor was fitted on.",
        ),
    ] = None,
    json: JsonFile = None,
    ranks: Ranks = None,
    debug: Debug = False,
) -> int:
    """Compare computed numbers with closed forms and published values."""

    def action(comm: "MPI.Comm") -> int:
        from headstock.app.actions.validating import validate_cases

        return validate_cases(cases or [], json, ranks, comm, output, seed)

    return run_guarded(action, debug=debug)


def report(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of results.")],
    debug: Debug = False,
) -> int:
    """Write the report of a finished run again, with a PNG of every mode and chart in
    DIR/figures.
    """

    def action() -> int:
        from headstock.app.actions.publishing import renew_report

        typer.echo(renew_report(folder))
        return 0

    return run_guarded(action, debug=debug)


def _complete_numbers(ctx: click.Context, incomplete: str) -> list[str]:
    from headstock.geometry.errors import HeadstockError
    from headstock.pipeline.numbers.folders import read_number_tables

    try:
        tables = read_number_tables(Path(ctx.params["folder"])).values()
        names = dict.fromkeys(str(key) for numbers in tables for key in numbers)
        return [name for name in names if name.startswith(incomplete)]
    except (HeadstockError, KeyError, TypeError):
        return []


def numbers(
    folder: Annotated[
        Path, typer.Argument(metavar="RESULTS", help="Folder of a run, study, sweep or comparison.")
    ],
    pattern: Annotated[
        str | None,
        typer.Argument(
            metavar="[PATTERN]",
            help="Names to list: one, a kind (frequency), or with * and ? (compliance(*point=tcp*)) [all].",
            autocompletion=_complete_numbers,
        ),
    ] = None,
    csv: Annotated[
        Path | None, typer.Option("--csv", metavar="FILE", help="Write them as CSV, in SI units.")
    ] = None,
    json: JsonFile = None,
    debug: Debug = False,
) -> int:
    """List every number of a finished run, study, sweep or comparison with its name, unit and ±, and what is not in ±."""

    def action() -> int:
        from headstock.app.actions.numbering import list_numbers

        return list_numbers(folder, pattern, csv, json)

    return run_guarded(action, debug=debug)


def doctor(json: JsonFile = None, debug: Debug = False) -> int:
    """Check the environment: libraries, MPI, memory, caches."""

    def action() -> int:
        from headstock.app.actions.doctor import run_doctor

        return run_doctor(json)

    return run_guarded(action, debug=debug)


def schema(
    kind: Annotated[
        SchemaKind, typer.Argument(help="Of scene files, or of target files (targets).")
    ] = SchemaKind.scene,
    markdown: Annotated[
        bool, typer.Option("--markdown", help="Print the scene reference instead.")
    ] = False,
    json: JsonFile = None,
    debug: Debug = False,
) -> int:
    """Print the JSON schema of scene files, or of target files, for editors."""

    def action() -> int:
        from headstock.app.actions.editor_schema import plain_schema, scene_schema, targets_schema
        from headstock.app.actions.scene_reference import render_reference
        from headstock.pipeline.storage.json_texts import dump_json

        content = scene_schema() if kind is SchemaKind.scene else targets_schema()
        typer.echo(render_reference(plain_schema()) if markdown else dump_json(content), nl=False)
        write_json_file(json, content)
        return 0

    return run_guarded(action, debug=debug)


def _list_elements() -> list[str]:
    from headstock.scene.expansion.catalogue import read_catalogue, read_cutting_materials

    return [*read_catalogue(), "cutting", *read_cutting_materials()]


def catalogue(
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="[NAME]",
            help="Element (guide_35), family (guide), or cutting for work materials; all.",
            autocompletion=_list_elements,
        ),
    ] = None,
    markdown: Annotated[
        bool, typer.Option("--markdown", help="Print the page of the documentation instead.")
    ] = False,
    json: JsonFile = None,
    debug: Debug = False,
) -> int:
    """List typical machine elements (guides, screws, bearings, mounts) that joints take by name:
    stiffness, damping, range and source; or cutting coefficients of work materials.
    """

    def action() -> int:
        from headstock.app.actions.cataloguing import list_catalogue

        return list_catalogue(name, markdown=markdown, json_file=json)

    return run_guarded(action, debug=debug)


def _list_shells() -> list[str]:
    return ["bash", "zsh", "fish"]


def completion(
    shell: Annotated[
        str, typer.Argument(metavar="SHELL", help="bash, zsh or fish.", autocompletion=_list_shells)
    ],
) -> int:
    """Print a script that completes commands with the Tab key: source <(./headstock completion
    bash).
    """
    from headstock.app.actions.shell_completion import SCRIPTS

    if shell not in SCRIPTS:
        raise click.UsageError(
            f"no completion for {shell!r}; there is one for: {', '.join(SCRIPTS)}"
        )
    typer.echo(SCRIPTS[shell], nl=False)
    return 0


def refuse_test(
    arguments: Annotated[list[str] | None, typer.Argument(metavar="[PYTEST ARGUMENTS]...")] = None,
) -> int:
    """Run the tests (the launcher ./headstock does this itself)."""
    raise click.UsageError("start the tests through the launcher: ./headstock test")
