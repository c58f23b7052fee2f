"""Static loads on a component as vectors of nodal forces, one per direction of the component's axes."""

from collections.abc import Sequence

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Component, Load
from headstock.meshing.component_mesh import ComponentMesh, IntArray
from headstock.reduction.components.interface_patches import measure_patch
from headstock.reduction.requests import GRAVITY
from headstock.solvers.elastic.elasticity import ElasticOperators

AXES = "xyz"


def assemble_loads(
    component: Component, mesh: ComponentMesh, operators: ElasticOperators, loads: Sequence[Load], *, gravity: bool
) -> dict[str, FloatArray]:
    """Nodal forces ``(3 n_owned,)`` of each load.

    Pressures come as ``NAME`` at their full magnitude. Tractions, body loads and gravity come as ``NAME:x``, ``NAME:y``, ``NAME:z``:
    one unit (1 Pa, 1 m/s^2) along each axis of the component, so that the superelement does not depend on how it is placed.
    Forces at an interface need no vector of their own.
    """
    result: dict[str, FloatArray] = {}
    local_of = {int(point): row for row, point in enumerate(operators.nodes)}
    for load in loads:
        if load.component != component.name or load.kind == "force":
            continue
        if load.kind == "body":
            result |= _unit_accelerations(load.name, operators)
            continue
        patch = measure_patch(mesh, f"load:{load.name}")
        if load.kind == "pressure":
            result[load.name] = _scatter(-load.magnitude * patch.normals, patch.nodes, local_of, operators)
        else:
            uniform = np.asarray(patch.weights.sum(axis=1)).ravel()
            for axis in range(3):
                result[f"{load.name}:{AXES[axis]}"] = _scatter(uniform[:, None] * np.eye(3)[axis], patch.nodes, local_of, operators)
    if gravity:
        result |= _unit_accelerations(GRAVITY, operators)
    return result


def _unit_accelerations(name: str, operators: ElasticOperators) -> dict[str, FloatArray]:
    units = np.tile(np.eye(3), (len(operators.nodes), 1))
    forces = operators.apply_mass(units)
    return {f"{name}:{AXES[axis]}": forces[:, axis] for axis in range(3)}


def _scatter(values: FloatArray, nodes: IntArray, local_of: dict[int, int], operators: ElasticOperators) -> FloatArray:
    result = np.zeros((len(operators.nodes), 3))
    for value, point in zip(values, nodes, strict=True):
        row = local_of.get(int(point))
        if row is not None:
            result[row] = value
    return result.ravel()
