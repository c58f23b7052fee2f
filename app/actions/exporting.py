"""``headstock export``: a component as matrices or as a mesh, or a machine as a state space or with
modes and responses as a test has them.
"""

from pathlib import Path

import click

from headstock.app.actions.running import require_ranks
from headstock.app.commands.options import split_list
from headstock.app.commands.scene_commands import ExportOptions
from headstock.app.terminal.console import warn_of_unused_accuracy
from headstock.app.terminal.guard import DONE
from headstock.pipeline.exports import export
from headstock.scene.building.loader import load_scene
from headstock.scene.exports import EXPORT_FORMATS, MOTORS, Export, find_share_fault
from headstock.scene.reading.units import (
    FREQUENCY,
    RATIO,
    TIME,
    Dimension,
    UnitError,
    parse_quantity,
)
from headstock.scene.scene import Scene
from headstock.solvers.mpi import MPI
from headstock.solvers.ranks import make_on_root


def export_command(options: ExportOptions, comm: MPI.Comm) -> int:
    """Reduce or mesh a component on all ranks, or find the state space of the machine; write it and
    say so.

    Raises:
        click.UsageError: Options do not go together, or one is no quantity.
        SceneError: The scene has problems.
        HeadstockError: The component or pose does not exist, or a computation or the file failed.
    """
    origin = options.trace(comm.size)
    require_ranks(options.ranks, comm)
    wanted = read_export(options)
    scene = make_on_root(comm, lambda: _load(options))
    path = wanted.name_file(options.component or options.scene.stem)
    written = export(scene, wanted, path, comm=comm, origin=origin)
    if comm.rank == 0:
        click.echo(written)
    return DONE


def read_export(options: ExportOptions) -> Export:
    """Return what the options ask for.

    Raises:
        click.UsageError: They do not go together, or one is no quantity.
    """
    alone = [file for file in (options.mesh, options.uff) if file is not None]
    if alone and (len(alone) > 1 or options.to or options.output):
        raise click.UsageError("--mesh FILE and --uff FILE go without each other, --to and -o")
    file = alone[0] if alone else options.output
    form = options.to
    if options.mesh is not None:
        form = _find_mesh_format(options.mesh)
    elif options.uff is not None:
        form = "uff"
    elif form is None:
        form = "mat" if options.hz else "h5" if options.component else None
    if form is None:
        raise click.UsageError(
            f"name a component to reduce, or write --to FORMAT: {', '.join(EXPORT_FORMATS)}"
        )
    if options.motors is not None and options.motors not in MOTORS:
        raise click.UsageError(f"--motors {options.motors} is unknown; write {', '.join(MOTORS)}")
    wanted = Export(
        form,
        options.component,
        options.pose,
        _read_positive("hz", options.hz, FREQUENCY),
        _read_positive("step", options.step, TIME),
        _read_positive("balanced", options.balanced, RATIO),
        MOTORS[options.motors or "locked"],
        split_list(options.travel),
        _read_positive("error", options.error, RATIO),
        None if file is None else str(file),
    )
    for name, share in (("balanced", wanted.balanced), ("error", wanted.error)):
        if share is not None and (fault := find_share_fault(share)):
            raise click.UsageError(f"--{name} {fault}")
    for _, fault in wanted.find_faults():
        raise click.UsageError(fault)
    return wanted


def _find_mesh_format(file: Path) -> str:
    formats = {
        ending: name
        for name, form in EXPORT_FORMATS.items()
        if form.of == "mesh"
        for ending in form.endings
    }
    if file.suffix.lower() not in formats:
        raise click.UsageError(f"{file.name}: mesh files end in {', '.join(formats)}")
    return formats[file.suffix.lower()]


def _read_positive(name: str, text: str | None, dimension: Dimension) -> float | None:
    """Return a quantity in SI units; None where none is given."""
    if text is None:
        return None
    try:
        value = parse_quantity(text, dimension).value
    except UnitError as error:
        raise click.UsageError(f"--{name} {error}") from error
    if not value > 0.0:
        raise click.UsageError(f"--{name} {text} must be above zero")
    return value


def _load(options: ExportOptions) -> Scene:
    chosen = options.chosen
    scene = load_scene(chosen.path, variant=chosen.variant, overrides=chosen.overrides)
    warn_of_unused_accuracy(scene)
    return scene
