"""Sensors in a mesh: the motion at their places from the recovery basis, and forces there on its
points.
"""

import contextlib
from collections.abc import Iterable

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.machine import Sensor
from headstock.geometry.parts.components import Material
from headstock.geometry.parts.nearest_places import find_nearest_place
from headstock.meshing.component_mesh import ComponentMesh, IntArray
from headstock.meshing.components.skins import mesh_surface
from headstock.reduction.components.sensors import SensorPlaceError
from headstock.reduction.superelement import SensorRows, Superelement
from headstock.solvers.elastic.stress_recovery import find_point_rows
from headstock.solvers.errors import ModelError

# flat triangles of curved facets pass beside their cells by less than this share of a cell
FACET_SLACK = 0.2


def observe_mesh(
    element: Superelement, mesh: ComponentMesh, material: Material, sensors: Iterable[Sensor]
) -> dict[str, SensorRows]:
    """Return the motion at sensors on a meshed component, by name.

    Args:
        element: With recovery of the motion of the mesh.

    Raises:
        SensorPlaceError: A sensor lies farther from the component than it may.
        ModelError: The superelement has no recovery basis.
    """
    if element.recovery is None:
        raise ModelError(f"component {element.name!r} was reduced without recovery")
    basis = element.recovery.basis.reshape(len(mesh.points), 3, -1)
    rows = {}
    for sensor in sensors:
        nodes, shares = _find_shares(mesh, material, sensor)
        rows[sensor.name] = SensorRows(np.einsum("i,ijk->jk", shares, basis[nodes]))
    return rows


def _find_shares(
    mesh: ComponentMesh, material: Material, sensor: Sensor
) -> tuple[IntArray, FloatArray]:
    """Return the mesh points around a sensor and their shares in its motion."""
    place = np.array(sensor.position)
    try:
        found = find_point_rows(mesh, material, place)
    except ModelError:
        nearest, distance = find_nearest_place(mesh_surface(mesh), place)
        if distance > sensor.reach:
            raise SensorPlaceError(sensor, nearest, distance) from None
        found = find_point_rows(mesh, material, nearest, slack=FACET_SLACK)
    return found.nodes, found.shares


def load_sensors(
    mesh: ComponentMesh, material: Material, sensors: Iterable[Sensor]
) -> tuple[IntArray, FloatArray]:
    """Return the mesh points ``(n,)`` around sensors and nodal forces ``(n, 3, 3 s)`` of a unit force
    along each component axis at each; sensors beside the component are left out.
    """
    shares = []
    for sensor in sensors:
        with contextlib.suppress(SensorPlaceError):  # reported where the sensor is observed
            shares.append(_find_shares(mesh, material, sensor))
    nodes = np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *(one for one, _ in shares)]))
    forces = np.zeros((len(nodes), 3, len(shares), 3))
    for column, (own, parts) in enumerate(shares):
        rows = np.searchsorted(nodes, own)
        forces[rows, :, column] = parts[:, None, None] * np.eye(3)
    return nodes, forces.reshape(len(nodes), 3, -1)
