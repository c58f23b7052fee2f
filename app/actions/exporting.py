"""``headstock export``: one component as a superelement file or as a mesh, or a machine as a state
space or with modes and responses as a test has them.
"""

from pathlib import Path

import click

from headstock.app.actions.running import require_ranks
from headstock.app.commands.scene_commands import ExportOptions
from headstock.app.terminal.console import warn_of_unused_accuracy
from headstock.app.terminal.guard import DONE
from headstock.meshing.errors import MeshError
from headstock.meshing.formats import find_format
from headstock.pipeline.exchange.names import ENDINGS
from headstock.pipeline.exports import (
    DEFAULT_STEP_S,
    export_mesh,
    export_state_space,
    export_superelement,
)
from headstock.pipeline.test_data_export import export_test_data
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.files import UFF_SUFFIXES
from headstock.scene.reading.units import FREQUENCY, TIME, UnitError, parse_quantity
from headstock.scene.scene import Scene
from headstock.solvers.mpi import MPI
from headstock.solvers.ranks import make_on_root


def export_command(options: ExportOptions, comm: MPI.Comm) -> int:
    """Reduce or mesh a component on all ranks, or find the state space of the machine; write it and
    say so.

    Raises:
        click.UsageError: There is no format with the ending of the file, or the frequency is none.
        SceneError: The scene has problems.
        HeadstockError: The component or pose does not exist, or a computation or the file failed.
    """
    origin = options.trace(comm.size)
    require_ranks(options.ranks, comm)
    up_to_hz = _read_options(options)
    scene = make_on_root(comm, lambda: _load(options))
    if options.mesh is not None:
        written = export_mesh(scene, options.component, options.mesh, comm=comm)
    elif options.uff is not None:
        written = export_test_data(scene, options.uff, pose=options.pose, comm=comm)
    elif up_to_hz is None:
        component = options.component or ""
        form = options.to or "h5"
        output = options.output or Path(f"{component}.h5")
        written = export_superelement(scene, component, output, comm=comm, form=form, origin=origin)
    else:
        form = options.to or "mat"
        output = options.output or Path(options.scene.stem + ENDINGS[form])
        written = export_state_space(
            scene,
            output,
            up_to_hz=up_to_hz,
            pose=options.pose,
            comm=comm,
            form=form,
            step_s=_read_step(options),
            origin=origin,
        )
    if comm.rank == 0:
        click.echo(written)
    return DONE


def _read_options(options: ExportOptions) -> float | None:
    """Return up to where a state space has modes [Hz]; None where none is asked for."""
    try:
        if options.mesh is not None:
            find_format(options.mesh, written=True)
        elif options.uff is not None:
            if options.uff.suffix.lower() not in UFF_SUFFIXES:
                raise click.UsageError(f"--uff FILE ends in {', '.join(UFF_SUFFIXES)}")
        elif options.state_space is not None:
            return parse_quantity(options.state_space, FREQUENCY).value
    except MeshError as error:
        raise click.UsageError(str(error)) from error
    except UnitError as error:
        raise click.UsageError(f"--state-space {error}") from error
    return None


def _read_step(options: ExportOptions) -> float:
    """Return the step of an FMU [s].

    Raises:
        click.UsageError: It is no time above zero.
    """
    try:
        step = DEFAULT_STEP_S if options.step is None else parse_quantity(options.step, TIME).value
    except UnitError as error:
        raise click.UsageError(f"--step {error}") from error
    if not step > 0.0:
        raise click.UsageError(f"--step {options.step} must be above zero")
    return step


def _load(options: ExportOptions) -> Scene:
    chosen = options.chosen
    scene = load_scene(chosen.path, variant=chosen.variant, overrides=chosen.overrides)
    warn_of_unused_accuracy(scene)
    return scene
