"""Arguments and options that commands share, and how their texts are read."""

import functools
import inspect
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import click
import typer

from headstock.app.terminal.guard import run_guarded

if TYPE_CHECKING:
    from headstock.pipeline.storage.provenance import Provenance, SceneChoice
    from headstock.solvers.mpi import MPI


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


SceneFile = Annotated[Path, typer.Argument(metavar="SCENE", help="Scene file (.toml).")]
Variant = Annotated[
    str | None,
    typer.Option(
        "--variant", metavar="NAME", help="Apply a variant of the scene; A+B applies A, then B."
    ),
]
Overrides = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Override a key of the scene; repeatable."),
]
JsonFile = Annotated[
    Path | None,
    typer.Option(
        "--json", metavar="FILE", callback=_check_file, help="Also write the output as JSON."
    ),
]
Debug = Annotated[bool, typer.Option("--debug", help="Show tracebacks.")]
Ranks = Annotated[
    int | None,
    typer.Option("--ranks", metavar="N", min=1, help="MPI ranks; the launcher starts them."),
]
NoHost = Annotated[
    bool, typer.Option("--no-host", help="Leave host and command line out of the files.")
]
Names = Annotated[
    list[str] | None,
    typer.Option("--analysis", metavar="NAME", help="Run this analysis only; repeatable."),
]


Accuracy = Annotated[
    str | None,
    typer.Option(
        "--accuracy",
        metavar="SHARE",
        help="Choose meshes and modes for this largest relative error, such as 1%.",
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
On = Annotated[
    str | None,
    typer.Option("--on", metavar="slurm", help="Compute in a job of this cluster."),
]
Partition = Annotated[
    str | None, typer.Option("--partition", metavar="NAME", help="With --on: partition.")
]
TimeLimit = Annotated[
    str | None,
    typer.Option("--time", metavar="LIMIT", help="With --on: time limit per task, as in 0:30:00."),
]
Sbatch = Annotated[
    list[str] | None,
    typer.Option(
        "--sbatch",
        metavar="OPTION",
        help="With --on: option of sbatch, as in --sbatch=--account=ours; repeatable.",
    ),
]
NoWait = Annotated[
    bool,
    typer.Option("--no-wait", help="With --on: submit only; the same command again collects."),
]
CLUSTER_OPTIONS = {
    "on": (On, None),
    "partition": (Partition, None),
    "time_limit": (TimeLimit, None),
    "sbatch": (Sbatch, None),
    "no_wait": (NoWait, False),
}


def check_cluster(on: str | None, *others: object) -> None:
    """Refuse an unknown cluster, and options of a cluster without one.

    Raises:
        click.UsageError: They do not fit.
    """
    if on not in (None, "slurm"):
        raise click.UsageError(f"--on {on} is not known; write --on slurm")
    if on is None and any(others):
        raise click.UsageError(
            "--tasks, --partition, --time, --sbatch and --no-wait go with --on slurm"
        )


def on_cluster(command: Callable[..., int]) -> Callable[..., int]:
    """A command that may also be computed as one job of a cluster, with the options for it."""

    @functools.wraps(command)
    def with_cluster(
        *,
        on: str | None = None,
        partition: str | None = None,
        time_limit: str | None = None,
        sbatch: list[str] | None = None,
        no_wait: bool = False,
        **arguments: object,
    ) -> int:
        check_cluster(on, partition, time_limit, sbatch, no_wait)
        if on is None:
            return command(**arguments)
        ranks = arguments.get("ranks")
        words = click.get_current_context().find_root().obj

        def action(comm: "MPI.Comm") -> int:
            from headstock.app.actions.cluster_jobs import command_on_slurm
            from headstock.studies.sweeps.slurm import SlurmOptions

            count = ranks if isinstance(ranks, int) else 1
            options = SlurmOptions(1, count, partition, time_limit, tuple(sbatch or ()))
            return command_on_slurm(words, options, comm.size, wait=not no_wait)

        return run_guarded(action, debug=bool(arguments.get("debug")))

    signature = inspect.signature(command)
    added = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=kind)
        for name, (kind, default) in CLUSTER_OPTIONS.items()
    ]
    # typer reads the options of a command from its signature
    with_cluster.__signature__ = signature.replace(  # type: ignore[attr-defined]
        parameters=[*signature.parameters.values(), *added]
    )
    return with_cluster


def write_json_file(
    path: Path | None, content: Mapping[str, object] | Sequence[Mapping[str, object]]
) -> None:
    """Write what was printed, where a file was named."""
    if path is not None:
        from headstock.pipeline.storage.json_texts import dump_json
        from headstock.pipeline.storage.outputs import write_output

        write_output(path, dump_json(content).encode())


def choose_scene(
    scene: Path,
    variant: str | None,
    overrides: Sequence[str] | None,
    analyses: Sequence[str] | None = None,
) -> "SceneChoice":
    """What a command line says of a scene, as one thing.

    Args:
        overrides: ``KEY=VALUE`` of each ``--set``.
        analyses: Of each ``--analysis``; all where there is none.
    """
    from headstock.pipeline.storage.provenance import SceneChoice

    return SceneChoice(scene, variant, tuple(overrides or ()), tuple(analyses or ()))


def trace_command(choice: "SceneChoice", *, ranks: int = 1, with_host: bool) -> "Provenance | None":
    """Where the results of the present command come from; None where there is no scene that
    can be read, which is said elsewhere.

    Args:
        with_host: State host and command line.
    """
    from headstock.pipeline.storage.provenance import trace_content
    from headstock.scene.expansion.includes import scene_content
    from headstock.scene.reading.findings import SceneError

    if not choice.path.is_file():
        return None
    context = click.get_current_context(silent=True)
    words = None if context is None else context.find_root().obj
    try:
        content = scene_content(choice.path)
    except (OSError, SceneError):
        return None
    return trace_content(choice, content, ranks=ranks, command=words, with_host=with_host)


def read_solid(text: str | None) -> int | str | None:
    """A number of a solid, or its name."""
    return int(text) if text is not None and text.isdecimal() else text


def read_percent(text: str) -> float:
    """A share such as ``1 %`` or ``0.01``, above 0 and below 1."""
    number, percent, _ = text.strip().partition("%")
    try:
        share = float(number) / (100.0 if percent else 1.0)
    except ValueError:
        share = 0.0
    if not 0.0 < share < 1.0:
        raise click.BadParameter(f"{text!r} is no share; write 1% or 0.01")
    return share


def split_list(texts: list[str] | None) -> tuple[str, ...]:
    """The parts of ``A, B,C``, of an option given once or more often."""
    parts = (part.strip() for text in texts or [] for part in text.split(","))
    return tuple(part for part in parts if part)
