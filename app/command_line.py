"""The command line: a thin skin over the Python API."""

import gc
import os
import sys
import time
from typing import Annotated

import click

from headstock.app.commands import batch_commands, scene_commands, tool_commands
from headstock.app.commands.options import CommandLine, CommandOptions, make_command
from headstock.app.commands.plain_typer import typer
from headstock.app.terminal.guard import find_home, hand_over, prepare_streams

PROGRAM = "headstock"
PROGRAM_HELP = """A FEM-based virtual machine tool: from one scene file to a machine's stiffness and modes.

`headstock python SCRIPT` runs Python with `import headstock`, `headstock notebook` JupyterLab; a checkout also has ./headstock test, docs, exec and
release-check (its first lines say what they do).

Exit codes: 0 done, 1 a computation failed (named error), 2 bad input.
"""

# in the order of the help
COMMANDS: dict[str, type[CommandOptions]] = {
    "check": scene_commands.CheckOptions,
    "plan": scene_commands.PlanOptions,
    "run": scene_commands.RunOptions,
    "study": batch_commands.StudyOptions,
    "converge": batch_commands.ConvergeOptions,
    "sweep": batch_commands.SweepOptions,
    "effects": scene_commands.EffectsOptions,
    "compare": batch_commands.CompareOptions,
    "show": tool_commands.ShowOptions,
    "new": tool_commands.NewOptions,
    "export": scene_commands.ExportOptions,
    "validate": tool_commands.ValidateOptions,
    "modes": tool_commands.ModesOptions,
    "correlate": batch_commands.CorrelateOptions,
    "identify": batch_commands.IdentifyOptions,
    "report": tool_commands.ReportOptions,
    "numbers": tool_commands.NumbersOptions,
    "doctor": tool_commands.DoctorOptions,
    "schema": tool_commands.SchemaOptions,
    "catalogue": tool_commands.CatalogueOptions,
}

app = typer.Typer(
    name=PROGRAM,
    help=PROGRAM_HELP,
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
)
for name, kind in COMMANDS.items():
    app.command(name)(make_command(kind))
app.command("completion")(tool_commands.print_completion)
app.command("test", context_settings={"ignore_unknown_options": True, "allow_extra_args": True})(
    tool_commands.refuse_test
)


def _print_version(asked: bool) -> None:
    if asked:
        from headstock.pipeline.storage.provenance import find_version

        found = find_version()
        typer.echo(f"{PROGRAM} {found.version} (commit {found.commit})")
        raise typer.Exit


@app.callback(help=PROGRAM_HELP)
def _read_program_options(
    version: Annotated[
        bool,
        typer.Option(
            "--version",
            is_eager=True,
            callback=_print_version,
            help="Print version and commit, and end.",
        ),
    ] = False,
) -> None:
    """Options before any command."""


def _describe(words: list[str], arguments: list[str] | None) -> CommandLine:
    """Return the command line; where its words are those of the process it began with that."""
    begun = time.clock_gettime(time.CLOCK_BOOTTIME)
    if arguments is None:
        with open("/proc/self/stat") as file:  # noqa: PTH123 (no pathlib at start-up)
            ticks = file.read().rpartition(")")[2].split()[19]
        begun = int(ticks) / os.sysconf("SC_CLK_TCK")
    return CommandLine(tuple(words), begun)


def main(arguments: list[str] | None = None) -> int:
    """Run a command line and return its exit code."""
    prepare_streams()
    find_home()
    try:
        words = sys.argv[1:] if arguments is None else arguments
        code = typer.main.get_command(app).main(
            args=words, prog_name=PROGRAM, standalone_mode=False, obj=_describe(words, arguments)
        )
    except click.ClickException as error:
        error.show()
        return error.exit_code
    except (click.Abort, KeyboardInterrupt):
        typer.echo("interrupted", err=True)
        return 130
    return int(code or 0)


if __name__ == "__main__":
    ending = hand_over(main())
    gc.freeze()  # all memory is given back anyway: a last search for garbage would be for nothing
    sys.exit(ending)
