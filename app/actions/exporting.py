"""``headstock export``: one component as a superelement file or as a mesh, or a machine as a state
space.
"""

from dataclasses import dataclass
from functools import partial
from pathlib import Path

import click

from headstock.app.actions.running import require_ranks
from headstock.app.terminal.console import warn_of_unused_accuracy
from headstock.app.terminal.guard import DONE
from headstock.meshing.errors import MeshError
from headstock.meshing.formats import find_format
from headstock.pipeline.exports import export_mesh, export_state_space, export_superelement
from headstock.pipeline.storage.provenance import Provenance, SceneChoice
from headstock.scene.building.loader import load_scene
from headstock.scene.reading.units import FREQUENCY, UnitError, parse_quantity
from headstock.scene.scene import Scene
from headstock.solvers.mpi import MPI
from headstock.solvers.ranks import make_on_root


@dataclass(frozen=True, kw_only=True)
class ExportRequest:
    """What the command line asked for."""

    scene: SceneChoice
    component: str
    output: Path
    ranks: int | None = None
    origin: Provenance | None = None


def export_component(request: ExportRequest, comm: MPI.Comm) -> int:
    """Reduce a component on all ranks, write it and say so.

    Raises:
        SceneError: The scene has problems.
        HeadstockError: The component does not exist, or a computation or the file failed.
    """
    require_ranks(request.ranks, comm)
    scene = make_on_root(comm, partial(_load, request))
    written = export_superelement(
        scene, request.component, request.output, comm=comm, origin=request.origin
    )
    if comm.rank == 0:
        click.echo(written)
    return DONE


def export_component_mesh(request: ExportRequest, component: str | None, comm: MPI.Comm) -> int:
    """Mesh a component, write the mesh and say so.

    Args:
        component: Its name; None for the only one that has a shape.

    Raises:
        click.UsageError: There is no format with this ending.
        SceneError: The scene has problems.
        HeadstockError: The component does not exist, cannot be meshed, or the file failed.
    """
    require_ranks(request.ranks, comm)
    try:
        find_format(request.output, written=True)
    except MeshError as error:
        raise click.UsageError(str(error)) from error
    scene = make_on_root(comm, partial(_load, request))
    written = export_mesh(scene, component, request.output, comm=comm)
    if comm.rank == 0:
        click.echo(written)
    return DONE


def export_machine(request: ExportRequest, up_to: str, pose: str | None, comm: MPI.Comm) -> int:
    """Write the state space of the machine and say so.

    Args:
        up_to: Frequency with its unit up to which modes are kept, such as ``500 Hz``.
        pose: Name of a pose; the first without it.

    Raises:
        click.UsageError: The frequency is none.
        SceneError: The scene has problems.
        HeadstockError: There is no such pose, or a computation or the file failed.
    """
    require_ranks(request.ranks, comm)
    try:
        up_to_hz = parse_quantity(up_to, FREQUENCY).value
    except UnitError as error:
        raise click.UsageError(f"--state-space {error}") from error
    scene = make_on_root(comm, partial(_load, request))
    written = export_state_space(
        scene, request.output, up_to_hz=up_to_hz, pose=pose, comm=comm, origin=request.origin
    )
    if comm.rank == 0:
        click.echo(written)
    return DONE


def _load(request: ExportRequest) -> Scene:
    chosen = request.scene
    scene = load_scene(chosen.path, variant=chosen.variant, overrides=chosen.overrides)
    warn_of_unused_accuracy(scene)
    return scene
