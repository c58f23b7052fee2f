"""Sensors and point masses on a reduced component: the motion at their places per dof, and what
their masses add to its matrices.

A sensor is no boundary dof: the motion at its place is a row of the recovery basis.
"""

import contextlib
import dataclasses
import importlib
from collections.abc import Iterable, Sequence

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.machine import Sensor
from headstock.geometry.parts.components import Material
from headstock.geometry.parts.nearest_places import describe_distance, find_nearest_place
from headstock.meshing.component_mesh import ComponentMesh, IntArray
from headstock.meshing.components.skins import mesh_surface
from headstock.reduction.superelement import SensorRows, StaticLoad, Superelement
from headstock.solvers.errors import ModelError

RECOVERY = "headstock.solvers.elastic.stress_recovery"  # loads PETSc
# flat triangles of curved facets pass beside their cells by less than this share of a cell
FACET_SLACK = 0.2


class SensorPlaceError(ModelError):
    """A sensor that does not lie on its component.

    Attributes:
        nearest: ``(3,)`` place of the component's surface, in its frame [m].
        distance: To it [m].
    """

    def __init__(self, sensor: Sensor, nearest: FloatArray, distance: float) -> None:
        """Say how far off it is."""
        self.sensor, self.nearest, self.distance = sensor, nearest, distance
        super().__init__(
            f"{sensor.name} {describe_distance(sensor.component, nearest, distance, {})}"
        )


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
    find_point_rows = importlib.import_module(RECOVERY).find_point_rows
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


def observe_points(element: Superelement, sensors: Iterable[Sensor]) -> dict[str, SensorRows]:
    """Return the motion at sensors that lie at points whose motion an imported superelement recovers.

    Raises:
        SensorPlaceError: There is no such point within reach.
        ModelError: The superelement has no recovery basis.
    """
    recovery = element.recovery
    if recovery is None:
        raise ModelError(
            f"component {element.name!r} is an imported superelement without recovery basis, so sensors cannot be placed on it; "
            "use a point at one of its interfaces"
        )
    rows = {}
    for sensor in sensors:
        distances = np.linalg.norm(recovery.points - sensor.position, axis=1)
        nearest = int(np.argmin(distances))
        if distances[nearest] > sensor.reach:
            raise SensorPlaceError(sensor, recovery.points[nearest], float(distances[nearest]))
        rows[sensor.name] = SensorRows(recovery.basis[3 * nearest : 3 * nearest + 3])
    return rows


def drop_masses(element: Superelement, sensors: Sequence[Sensor]) -> Superelement:
    """Return a superelement that carries the masses of no sensor; see ``carry_masses``."""
    return carry_masses(element, [dataclasses.replace(one, mass=0.0) for one in sensors])


def carry_masses(element: Superelement, sensors: Sequence[Sensor]) -> Superelement:
    """Return a superelement whose mass, weight and unit loads of gravity include the masses of its
    sensors, whatever it carried there before.

    Args:
        sensors: All of them observed.
    """
    added = {one.name: one.mass - element.sensors[one.name].mass for one in sensors}
    if not any(added.values()):
        return element
    mass, loads = element.mass.copy(), dict(element.loads)
    for sensor in sensors:
        motion, more = element.sensors[sensor.name].motion, added[sensor.name]
        if element.mass.any():  # a static reduction has none
            mass += more * motion.T @ motion
        for row, axis in zip(motion, "xyz", strict=True):
            name = f"gravity:{axis}"
            if name in loads:
                loads[name] = _add_force(loads[name], more * row)
    carried = {
        one.name: dataclasses.replace(element.sensors[one.name], mass=one.mass) for one in sensors
    }
    whole = dataclasses.replace(element, mass=mass, loads=loads, sensors=element.sensors | carried)
    return _sum_mass_properties(whole, sensors, added) if element.mass.any() else whole


def _add_force(load: StaticLoad, vector: FloatArray) -> StaticLoad:
    return dataclasses.replace(load, vector=load.vector + vector)


def _sum_mass_properties(
    element: Superelement, sensors: Sequence[Sensor], added: dict[str, float]
) -> Superelement:
    """Return the superelement with mass, centre and inertia of the body and the added masses."""
    masses = np.array([element.mass_kg, *(added[one.name] for one in sensors)])
    places = np.array([element.center_of_mass, *(one.position for one in sensors)])
    total = float(masses.sum())
    center = masses @ places / total
    arms = places - center
    squares = np.einsum("ij,ij->i", arms, arms)
    inertia = element.inertia + (masses @ squares) * np.eye(3) - (masses * arms.T) @ arms
    return dataclasses.replace(element, mass_kg=total, center_of_mass=center, inertia=inertia)
