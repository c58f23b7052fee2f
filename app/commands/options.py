"""Options that commands share, and the command that typer makes of a dataclass of options."""

import importlib
import inspect
import time
from collections.abc import Callable
from dataclasses import MISSING, Field, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

import click

from headstock.app.commands.plain_typer import typer
from headstock.app.terminal.guard import run_guarded
from headstock.geometry.loading import without_collecting

if TYPE_CHECKING:
    from headstock.pipeline.storage.provenance import Provenance, SceneChoice
    from headstock.scene.reading.open_values import OpenValue
    from headstock.solvers.mpi import MPI
    from headstock.studies.sweeps.slurm import SlurmOptions

ACCEPT = "accept_defaults"  # a key of every scene
ACCEPT_DEFAULTS = f"{ACCEPT}=true"
SUBMIT = "cluster_jobs:command_on_slurm"


def _check_file(path: Path | None) -> Path | None:
    """Refuse a file that could not be written at the end, before anything is computed."""
    if path is None:
        return None
    from headstock.pipeline.storage.outputs import OutputError, check_output

    try:
        check_output(path)
    except OutputError as error:
        raise click.BadParameter(str(error)) from error
    return path


def option(name: str, metavar: str, words: str, **more: Any) -> Any:
    """Make an option with a value, and what the help says of it."""
    return typer.Option(name, metavar=metavar, help=words, **more)


def output_option(metavar: str, words: str) -> Any:
    """Make ``-o``."""
    return typer.Option("-o", "--output", metavar=metavar, help=words)


def flag(name: str, words: str) -> Any:
    """Make an option without a value."""
    return typer.Option(name, help=words)


SceneFile = Annotated[Path, typer.Argument(metavar="SCENE", help="Scene file (.toml).")]
Variant = Annotated[
    str | None, option("--variant", "NAME", "Apply a variant of the scene; A+B applies A, then B.")
]
Overrides = Annotated[
    list[str] | None, option("--set", "KEY=VALUE", "Override a key of the scene; repeatable.")
]
AcceptDefaults = Annotated[
    bool, flag("--accept-defaults", "Use the defaults of open values; results list them.")
]
JsonFile = Annotated[
    Path | None,
    # eager: options that end a command write it too
    option("--json", "FILE", "Also write the output as JSON.", callback=_check_file, is_eager=True),
]
Debug = Annotated[bool, flag("--debug", "Show tracebacks.")]
Ranks = Annotated[int | None, option("--ranks", "N", "MPI ranks; the launcher starts them.", min=1)]
NoHost = Annotated[bool, flag("--no-host", "Leave host and command line out of the files.")]
Names = Annotated[
    list[str] | None, option("--analysis", "NAME", "Run this analysis only; repeatable.")
]
Accuracy = Annotated[
    str | None,
    option(
        "--accuracy",
        "SHARE",
        "Choose meshes and modes for this largest relative error, such as 1%.",
    ),
]
Fidelities = Annotated[
    Literal["rigid", "segmented", "polynomial", "elastic"] | None,
    typer.Option(
        "--fidelity",
        click_type=click.Choice(["rigid", "segmented", "polynomial", "elastic"]),
        help="Fidelity of all parts that are not rigid in the scene.",
    ),
]
Solid = Annotated[
    str | None,
    option(
        "--solid",
        "NAME|N",
        "Which solid of a STEP file, set of cells of a mesh file, or * for all.",
    ),
]
Unit = Annotated[str | None, option("--unit", "LENGTH", "Length unit of a mesh file, as 1 mm.")]
On = Annotated[str | None, option("--on", "slurm", "Compute in a job of this cluster.")]
Partition = Annotated[str | None, option("--partition", "NAME", "With --on: partition.")]
TimeLimit = Annotated[
    str | None, option("--time", "LIMIT", "With --on: time limit per task, as in 0:30:00.")
]
Sbatch = Annotated[
    list[str] | None,
    option(
        "--sbatch",
        "OPTION",
        "With --on: option of sbatch, as in --sbatch=--account=ours; repeatable.",
    ),
]
NoWait = Annotated[
    bool, flag("--no-wait", "With --on: submit only; the same command again collects.")
]


class CommandOptions:
    """Options of a command, declared once for the command line and for what it does; the docstring of
    the class is the help of the command.

    Attributes:
        action: ``MODULE:FUNCTION`` in ``app/actions``, which takes the options and returns an exit code.
        collective: It also takes the ranks that compute together.
        as_one_job: It may also be computed as one job of a cluster, with the options for it.
    """

    action: ClassVar[str]
    collective: ClassVar[bool] = False
    as_one_job: ClassVar[bool] = False
    ranks: int | None = None
    json: Path | None = None
    debug: bool = False

    def write_json(self, text: str) -> None:
        """Write what was printed, where ``--json`` names a file."""
        if self.json is not None:
            from headstock.pipeline.storage.outputs import write_output

            write_output(self.json, text.encode())


class SceneOptions(CommandOptions):
    """Options of a command on a scene."""

    scene: Path
    set_: list[str] | None
    variant: str | None = None
    analysis: list[str] | None = None
    accept_defaults: bool = False
    no_host: bool = False

    @property
    def chosen(self) -> "SceneChoice":
        """Scene, variant, settings and analyses of the command line."""
        from headstock.pipeline.storage.provenance import SceneChoice

        overrides, analyses = tuple(self.set_ or ()), tuple(self.analysis or ())
        if self.accept_defaults:
            overrides += (ACCEPT_DEFAULTS,)
        return SceneChoice(self.scene, self.variant, overrides, analyses)

    def trace(self, ranks: int = 1) -> "Provenance | None":
        """Return where results of the command come from; None without a scene that can be read."""
        return trace_command(self.chosen, ranks=ranks, with_host=not self.no_host)


class PartOptions(CommandOptions):
    """Options of a command on the file of a part."""

    solid: str | None

    @property
    def solid_choice(self) -> int | str | None:
        """Number of a solid, or its name."""
        text = self.solid
        return int(text) if text is not None and text.isdecimal() else text


class ClusterOptions:
    """What a command line says of a cluster."""

    on: str | None
    partition: str | None
    time_limit: str | None
    sbatch: list[str] | None
    no_wait: bool
    tasks: int | None = None

    def __post_init__(self) -> None:
        """Refuse an unknown cluster, and options of a cluster without one.

        Raises:
            click.UsageError: They do not fit.
        """
        if self.on not in (None, "slurm"):
            raise click.UsageError(f"--on {self.on} is not known; write --on slurm")
        others = (self.tasks, self.partition, self.time_limit, self.sbatch, self.no_wait)
        if self.on is None and any(others):
            raise click.UsageError(
                "--tasks, --partition, --time, --sbatch and --no-wait go with --on slurm"
            )

    def describe_job(self, tasks: int, ranks: int | None) -> "SlurmOptions":
        """Return what Slurm is asked for."""
        from headstock.studies.sweeps.slurm import SlurmOptions

        more = tuple(self.sbatch or ())
        return SlurmOptions(tasks, ranks or 1, self.partition, self.time_limit, more)


@dataclass(frozen=True, kw_only=True)
class _JobOptions(ClusterOptions):
    """Options of the job of a whole command."""

    on: On = None
    partition: Partition = None
    time_limit: TimeLimit = None
    sbatch: Sbatch = None
    no_wait: NoWait = False


def make_command(kind: type[CommandOptions]) -> Callable[..., int]:
    """Return the function that typer makes a command of; its parameters are the fields of the options."""
    of_job = fields(_JobOptions) if kind.as_one_job else ()

    def command(**arguments: Any) -> int:
        job = _JobOptions(**{item.name: arguments.pop(item.name) for item in of_job})
        options = kind(**arguments)

        def act(*comm: "MPI.Comm") -> int:
            if job.on is None:
                code = load_action(kind.action)(options, *comm)
                if isinstance(options, SceneOptions) and not (comm and comm[0].rank):
                    _print_accepted(options.chosen)
                return code
            described, words = job.describe_job(1, options.ranks), _command_words()
            return load_action(SUBMIT)(words, described, comm[0].size, wait=not job.no_wait)

        if kind.collective:
            return run_guarded(lambda comm: act(comm), debug=options.debug)
        return run_guarded(lambda: act(), debug=options.debug)

    declared: tuple[Field[Any], ...] = fields(kind)  # type: ignore[arg-type]
    # typer reads the options of a command from its signature
    command.__signature__ = inspect.Signature(  # type: ignore[attr-defined]
        [
            inspect.Parameter(
                item.name,
                inspect.Parameter.KEYWORD_ONLY,
                default=inspect.Parameter.empty if item.default is MISSING else item.default,
                annotation=item.type,
            )
            for item in (*declared, *of_job)
        ]
    )
    command.__doc__ = kind.__doc__
    return command


def load_action(place: str) -> Callable[..., int]:
    """Load a function of ``app/actions``, ``MODULE:FUNCTION``, which returns an exit code."""
    module, _, name = place.partition(":")
    with without_collecting(for_good=True):
        loaded = importlib.import_module(f"headstock.app.actions.{module}")
    action: Callable[..., int] = getattr(loaded, name)
    return action


@dataclass(frozen=True)
class CommandLine:
    """The present command line: its words, and when its process began, in seconds since the boot."""

    words: tuple[str, ...]
    begun: float

    @property
    def seconds(self) -> float:
        """Return how long it has taken so far, loading what it needs included [s]."""
        return time.clock_gettime(time.CLOCK_BOOTTIME) - self.begun


def find_command_line() -> CommandLine | None:
    """Return the present command line; None without one."""
    context = click.get_current_context(silent=True)
    line: CommandLine | None = None if context is None else context.find_root().obj
    return line


def _command_words() -> tuple[str, ...] | None:
    line = find_command_line()
    return None if line is None else line.words


def trace_command(choice: "SceneChoice", *, ranks: int = 1, with_host: bool) -> "Provenance | None":
    """Return where the results of the present command come from; None where there is no scene that
    can be read, which is said elsewhere.

    Args:
        with_host: State host and command line.
    """
    from headstock.pipeline.storage.provenance import trace_content
    from headstock.scene.expansion.includes import scene_content
    from headstock.scene.reading.findings import SceneError

    if not choice.path.is_file():
        return None
    try:
        content = scene_content(choice.path)
    except (OSError, SceneError):
        return None
    return trace_content(
        choice,
        content,
        ranks=ranks,
        accepted=_list_accepted(choice, content),
        command=_command_words(),
        with_host=with_host,
    )


def _print_accepted(choice: "SceneChoice") -> None:
    """Name the open values whose defaults a command has used."""
    origin = trace_command(choice, with_host=False)
    if origin is not None and origin.accepted_defaults:
        from headstock.app.terminal.console import print_open

        print_open("accepted defaults of open values:", origin.accepted_defaults)


def _list_accepted(choice: "SceneChoice", content: bytes) -> "tuple[OpenValue, ...]":
    """Return the open values of a scene whose defaults are used.

    Args:
        content: Of the scene file with what it includes.
    """
    if ACCEPT_DEFAULTS not in choice.overrides and ACCEPT.encode() not in content:
        return ()
    from headstock.scene.building.loader import read_tables
    from headstock.scene.reading.findings import Findings
    from headstock.scene.reading.open_values import close_values

    findings = Findings(str(choice.path))
    raw = read_tables(choice.path, findings, variant=choice.variant, overrides=choice.overrides)
    return close_values(raw, findings)[1] if raw.get(ACCEPT) is True else ()


def read_percent(text: str) -> float:
    """Read a share such as ``1 %`` or ``0.01``, above 0 and below 1."""
    number, percent, _ = text.strip().partition("%")
    try:
        share = float(number) / (100.0 if percent else 1.0)
    except ValueError:
        share = 0.0
    if not 0.0 < share < 1.0:
        raise click.BadParameter(f"{text!r} is no share; write 1% or 0.01")
    return share


def split_list(texts: list[str] | None) -> tuple[str, ...]:
    """Return the parts of ``A, B,C``, of an option given once or more often."""
    parts = (part.strip() for text in texts or [] for part in text.split(","))
    return tuple(part for part in parts if part)
