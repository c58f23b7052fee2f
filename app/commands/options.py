"""Arguments and options that commands share, and how their texts are read."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import click
import typer

if TYPE_CHECKING:
    from headstock.pipeline.storage.provenance import Provenance, SceneChoice
    from headstock.scene.scene import Scene


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


def load_checked(scene: Path, variant: str | None, overrides: list[str] | None) -> "Scene":
    """The scene; raises SceneError with every problem.

    Args:
        scene: Scene file.
        variant: To apply.
        overrides: ``KEY=VALUE`` of each ``--set``.
    """
    from headstock.scene.building.loader import load_scene

    return load_scene(scene, variant=variant, overrides=overrides or [])


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
        scene: Scene file.
        variant: To apply.
        overrides: ``KEY=VALUE`` of each ``--set``.
        analyses: Of each ``--analysis``; all where there is none.
    """
    from headstock.pipeline.storage.provenance import SceneChoice

    return SceneChoice(scene, variant, tuple(overrides or ()), tuple(analyses or ()))


def trace_command(choice: "SceneChoice", *, ranks: int = 1, with_host: bool) -> "Provenance | None":
    """Where the results of the present command come from; None where there is no scene that
    can be read, which is said elsewhere.

    Args:
        choice: Of the command line.
        ranks: MPI ranks.
        with_host: State host and command line.
    """
    from headstock.pipeline.storage.provenance import trace_content
    from headstock.scene.reading.findings import SceneError
    from headstock.scene.schema.includes import scene_content

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


def split_list(text: str | None) -> tuple[str, ...]:
    """The parts of ``A, B,C``."""
    return tuple(part.strip() for part in (text or "").split(",") if part.strip())
