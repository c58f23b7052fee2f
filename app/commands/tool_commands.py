"""Options of commands beside a scene: parts, validation, reports, the environment."""

from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import click

from headstock.app.commands.options import (
    CommandOptions,
    Debug,
    JsonFile,
    Overrides,
    PartOptions,
    Ranks,
    SceneOptions,
    Solid,
    Unit,
    Variant,
    flag,
    option,
    output_option,
)
from headstock.app.commands.plain_typer import typer


@dataclass(frozen=True, kw_only=True)
class ShowOptions(SceneOptions, PartOptions):
    """Draw a part with numbered faces and suggest interfaces, or the machine of a scene with
    its joints and points, before anything is computed.
    """

    action = "showing:show_command"
    scene: Annotated[
        Path, typer.Argument(metavar="FILE", help="STEP or mesh file, or scene (.toml).")
    ]
    output: Annotated[
        Path | None, output_option("PNG", "Picture [NAME_faces.png or NAME_machine.png].")
    ] = None
    variant: Variant = None
    set_: Overrides = None
    pose: Annotated[str | None, option("--pose", "NAME", "Pose of a scene [the first].")] = None
    window: Annotated[bool, flag("--window", "Show the machine in an interactive window.")] = False
    solid: Solid = None
    unit: Unit = None
    component: Annotated[
        str | None, option("--component", "NAME", "This component of a scene.")
    ] = None
    every_face: Annotated[bool, flag("--all", "List every face, not only the largest.")] = False
    json: JsonFile = None
    debug: Debug = False


@dataclass(frozen=True, kw_only=True)
class NewOptions(PartOptions):
    """Make a folder with a commented scene that can be run."""

    action = "starting:new_command"
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Folder to make.")]
    part: Annotated[
        Path | None, option("--part", "FILE", "STEP or mesh file to start from; it is copied.")
    ] = None
    assembly: Annotated[
        Path | None,
        option(
            "--assembly", "FILE", "STEP assembly to start from: its parts, contacts and joints."
        ),
    ] = None
    solid: Solid = None
    unit: Unit = None
    debug: Debug = False


@dataclass(frozen=True, kw_only=True)
class ValidateOptions(CommandOptions):
    """Compare computed numbers with closed forms and published values."""

    action = "validating:validate_command"
    collective = True
    cases: Annotated[
        list[str] | None,
        typer.Argument(metavar="[CASE]...", help="Cases or groups; all when none is named."),
    ] = None
    output: Annotated[Path | None, output_option("DIR", "Folder for figures of cases.")] = None
    seed: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            min=0,
            help="Compare what is drawn from this seed on (coverage, model-estimates): what no factor was fitted on.",
        ),
    ] = None
    json: JsonFile = None
    ranks: Ranks = None
    debug: Debug = False


@dataclass(frozen=True, kw_only=True)
class ReportOptions(CommandOptions):
    """Write the report of a finished run again, with a PNG of every mode and chart in
    DIR/figures.
    """

    action = "publishing:report_command"
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of results.")]
    debug: Debug = False


def _complete_numbers(ctx: click.Context, incomplete: str) -> list[str]:
    from headstock.geometry.errors import HeadstockError
    from headstock.pipeline.numbers.folders import read_number_tables

    try:
        tables = read_number_tables(Path(ctx.params["folder"])).values()
        names = dict.fromkeys(str(key) for numbers in tables for key in numbers)
        return [name for name in names if name.startswith(incomplete)]
    except (HeadstockError, KeyError, TypeError):
        return []


@dataclass(frozen=True, kw_only=True)
class NumbersOptions(CommandOptions):
    """List every number of a finished run, study, sweep or comparison with its name, unit and ±, and what is not in ±."""

    action = "numbering:numbers_command"
    folder: Annotated[
        Path, typer.Argument(metavar="RESULTS", help="Folder of a run, study, sweep or comparison.")
    ]
    pattern: Annotated[
        str | None,
        typer.Argument(
            metavar="[PATTERN]",
            help="Names to list: one, a kind (frequency), or with * and ? (compliance(*point=tcp*)) [all].",
            autocompletion=_complete_numbers,
        ),
    ] = None
    csv: Annotated[Path | None, option("--csv", "FILE", "Write them as CSV, in SI units.")] = None
    json: JsonFile = None
    debug: Debug = False


@dataclass(frozen=True, kw_only=True)
class ModesOptions(CommandOptions):
    """Fit poles, damping and shapes to the frequency responses of a test."""

    action = "correlating:modes_command"
    test: Annotated[
        Path, typer.Argument(metavar="TEST", help="Test file, such as .uff, with responses.")
    ]
    output: Annotated[
        Path | None, output_option("DIR", "Folder of results [results/TEST-modes].")
    ] = None
    band: Annotated[
        str | None, option("--band", "LOW..HIGH", "Frequencies used, as 20Hz..300Hz [all].")
    ] = None
    order: Annotated[
        int, option("--order", "N", "Highest order of the stabilisation diagram.", min=4, max=200)
    ] = 60
    references: Annotated[
        str | None,
        option("--references", "NAME,...", "Use these points or channels, as 3,12:+x [all]."),
    ] = None
    json: JsonFile = None
    debug: Debug = False

    def __post_init__(self) -> None:
        """Refuse a band that is none, before anything is read."""
        _ = self.band_hz

    @property
    def band_hz(self) -> tuple[float, float] | None:
        """Lowest and highest frequency [Hz]; None for all."""
        if self.band is None:
            return None
        from headstock.scene.reading.units import FREQUENCY, UnitError, parse_quantity

        try:
            low, high = (parse_quantity(end, FREQUENCY).value for end in self.band.split(".."))
        except (UnitError, ValueError) as error:
            raise click.BadParameter(
                f"{self.band!r} is no band: {error}; write it as 20Hz..300Hz",
                param_hint="'--band'",
            ) from error
        if not 0.0 <= low < high:
            raise click.BadParameter(
                f"{self.band!r} is empty; write the lower frequency first", param_hint="'--band'"
            )
        return low, high

    @property
    def names(self) -> tuple[str, ...]:
        """References that are used; empty for all."""
        return tuple(filter(None, (name.strip() for name in (self.references or "").split(","))))


@dataclass(frozen=True, kw_only=True)
class DoctorOptions(CommandOptions):
    """Check the environment: libraries, MPI, memory, caches."""

    action = "doctor:doctor_command"
    json: JsonFile = None
    debug: Debug = False


class _SchemaKind(StrEnum):
    """Files that have a schema."""

    scene = "scene"
    targets = "targets"
    units = "units"


@dataclass(frozen=True, kw_only=True)
class SchemaOptions(CommandOptions):
    """Print the JSON schema of scene files, or of target files, for editors; or the accepted units."""

    action = "schemas:schema_command"
    kind: Annotated[
        _SchemaKind, typer.Argument(help="Of scene files, of target files (targets), or the units.")
    ] = _SchemaKind.scene
    markdown: Annotated[bool, flag("--markdown", "Print the scene reference instead.")] = False
    json: JsonFile = None
    debug: Debug = False


def _list_elements() -> list[str]:
    from headstock.scene.expansion.catalogue import read_catalogue, read_cutting_materials

    return [*read_catalogue(), "cutting", *read_cutting_materials()]


@dataclass(frozen=True, kw_only=True)
class CatalogueOptions(CommandOptions):
    """List typical machine elements (guides, screws, bearings, mounts) that joints take by name:
    stiffness, damping, range and source; or cutting coefficients of work materials.
    """

    action = "cataloguing:catalogue_command"
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="[NAME]",
            help="Element (guide_35), family (guide), or cutting for work materials; all.",
            autocompletion=_list_elements,
        ),
    ] = None
    markdown: Annotated[
        bool, flag("--markdown", "Print the page of the documentation instead.")
    ] = False
    json: JsonFile = None
    debug: Debug = False


def _list_shells() -> list[str]:
    return ["bash", "zsh", "fish"]


def print_completion(
    shell: Annotated[
        str, typer.Argument(metavar="SHELL", help="bash, zsh or fish.", autocompletion=_list_shells)
    ],
) -> int:
    """Print a script that completes commands with the Tab key: source <(./headstock completion
    bash).
    """
    from headstock.app.commands.shell_completion import SCRIPTS

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
