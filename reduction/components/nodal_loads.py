"""Static loads on a mesh as nodal forces."""

import functools
from collections.abc import Callable, Sequence

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Component, Load
from headstock.meshing.component_mesh import ComponentMesh, IntArray
from headstock.reduction.components.interface_patches import measure_patch
from headstock.reduction.requests import GRAVITY
from headstock.solvers.elastic.elasticity import ElasticOperators
from headstock.solvers.mpi import MPI
from headstock.solvers.ranks import make_on_root

AXES = "xyz"


def assemble_loads(
    component: Component,
    mesh: ComponentMesh | None,
    operators: ElasticOperators,
    loads: Sequence[Load],
    *,
    gravity: bool,
) -> dict[str, FloatArray]:
    """Return the nodal forces ``(3 n_owned,)`` of each load.

    Pressures come as ``NAME`` at their full magnitude. Tractions, body loads and gravity come as
    ``NAME:x``, ``NAME:y``, ``NAME:z``: one unit (1 Pa, 1 m/s^2) along each axis of the component,
    so that the superelement does not depend on how it is placed. Forces at an interface need no
    vector of their own.

    Args:
        component: Its name picks its loads.
        mesh: On rank 0 its mesh, with a patch ``load:NAME`` for each pressure and traction.
        operators: Nodes of this rank and, for body loads and gravity, the mass.
        loads: Static loads of the whole machine.
        gravity: Add a unit acceleration of gravity along each axis.

    Returns:
        By name, ``(3 n_owned,)`` [N per unit of the load].
    """
    result: dict[str, FloatArray] = {}
    for load in loads:
        if load.component != component.name or load.kind == "force":
            continue
        if load.kind == "body":
            result |= _unit_accelerations(load.name, operators)
            continue
        patch = make_of_mesh(
            operators.comm, mesh, functools.partial(measure_patch, name=f"load:{load.name}")
        )
        if load.kind == "pressure":
            pressed = -load.magnitude * patch.normals
            result[load.name] = scatter_rows(pressed, patch.nodes, operators).ravel()
        else:
            uniform = np.asarray(patch.weights.sum(axis=1)).ravel()
            for axis in range(3):
                pulled = uniform[:, None] * np.eye(3)[axis]
                result[f"{load.name}:{AXES[axis]}"] = scatter_rows(
                    pulled, patch.nodes, operators
                ).ravel()
    if gravity:
        result |= _unit_accelerations(GRAVITY, operators)
    return result


def _unit_accelerations(name: str, operators: ElasticOperators) -> dict[str, FloatArray]:
    units = np.tile(np.eye(3), (len(operators.nodes), 1))
    forces = operators.apply_mass(units)
    return {f"{name}:{AXES[axis]}": forces[:, axis] for axis in range(3)}


def scatter_rows(values: FloatArray, nodes: IntArray, operators: ElasticOperators) -> FloatArray:
    """Return the values ``(n_owned, ...)`` of this rank's nodes, zero where none are given.

    Args:
        values: ``(n, ...)`` by node.
        nodes: ``(n,)`` mesh points, each once.
    """
    result = np.zeros((len(operators.nodes), *values.shape[1:]))
    _, given, local_rows = np.intersect1d(
        nodes, operators.nodes, assume_unique=True, return_indices=True
    )
    result[local_rows] = values[given]
    return result


def make_of_mesh[T](
    comm: MPI.Comm, mesh: ComponentMesh | None, make: Callable[[ComponentMesh], T]
) -> T:
    """Return what ``make`` makes of the mesh that rank 0 holds, on every rank; collective.

    Raises:
        SharedFailure: It failed, on every rank of several; a single rank gets the error itself.
    """

    def make_here() -> T:
        if mesh is None:
            raise ValueError("rank 0 has no mesh")
        return make(mesh)

    return make_on_root(comm, make_here)
