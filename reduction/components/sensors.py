"""Sensors and point masses on a reduced component: the motion at their places per dof, what their
masses add to its matrices, and the residual-attachment modes of forces there.

A sensor is no boundary dof: the motion at its place is a row of the recovery basis.
"""

import dataclasses
from collections.abc import Iterable, Sequence

import numpy as np

from headstock.geometry.frames import DOF_NAMES, FloatArray, Frame
from headstock.geometry.machine.machine import Sensor
from headstock.geometry.parts.nearest_places import describe_distance
from headstock.reduction.superelement import SensorRows, StaticLoad, Superelement
from headstock.solvers.errors import ModelError

# of the static response to a load: attachment modes that would add less are left out
ATTACHMENT_SHARE = 1e-9


class SensorPlaceError(ModelError):
    """A sensor that does not lie on its component.

    Attributes:
        nearest: ``(3,)`` place of the component's surface, in its frame [m].
        distance: To it [m].
    """

    def __init__(self, sensor: Sensor, nearest: FloatArray, distance: float) -> None:
        """Say how far off it is."""
        self.sensor, self.nearest, self.distance = sensor, nearest, distance
        place, frames = np.array(sensor.position), {sensor.component: Frame()}
        text = describe_distance(sensor.component, place, nearest, distance, {}, frames)
        super().__init__(f"{sensor.name} {text}")


def observe_recovered(element: Superelement, sensors: Iterable[Sensor]) -> dict[str, SensorRows]:
    """Return the motion at sensors of an imported superelement: at its nodes, and at points whose
    motion it recovers.

    Raises:
        SensorPlaceError: There is no such place within reach.
    """
    nodes = np.array([frame.origin for frame in element.frames]).reshape(-1, 3)
    moved = np.eye(len(DOF_NAMES) * len(nodes), len(element.labels))
    basis = moved.reshape(len(nodes), len(DOF_NAMES), -1)[:, :3]
    places, recovery = nodes, element.recovery
    if recovery is not None:
        places = np.concatenate([nodes, recovery.points])
        basis = np.concatenate([basis, recovery.basis.reshape(len(recovery.points), 3, -1)])
    rows = {}
    for sensor in sensors:
        distances = np.linalg.norm(places - sensor.position, axis=1)
        nearest = int(np.argmin(distances))
        if distances[nearest] > sensor.reach:
            raise SensorPlaceError(sensor, places[nearest], float(distances[nearest]))
        rows[sensor.name] = SensorRows(basis[nearest])
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


def combine_attachments(
    stiffness: FloatArray,
    mass: FloatArray | None,
    *,
    flexibility: FloatArray,
    stiffness_scale: float,
) -> tuple[FloatArray, FloatArray]:
    """Return combinations ``(k, a)`` of residual responses that are orthogonal in stiffness and mass,
    and their eigenvalues ``(a,)`` [rad^2/s^2], rising; those that add nothing are left out.

    Args:
        stiffness: ``(k, k)`` energy products of the responses.
        mass: ``(k, k)`` their products by mass; None where none was assembled.
        flexibility: ``(k,)`` displacement of each load's own point in its whole response [m/N].
        stiffness_scale: Largest entry of the whole stiffness [N/m].
    """
    # what acts on fixed points moves nothing but rounding
    moved = flexibility > ATTACHMENT_SHARE / stiffness_scale
    scale = np.where(moved, 1.0 / np.sqrt(np.where(moved, flexibility, 1.0)), 0.0)
    scaled = stiffness * scale * scale[:, None]
    shares, vectors = np.linalg.eigh(0.5 * (scaled + scaled.T))
    kept = shares > ATTACHMENT_SHARE
    combinations: FloatArray = scale[:, None] * vectors[:, kept] / np.sqrt(shares[kept])
    if mass is None or not kept.any():
        return combinations, np.ones(combinations.shape[1])  # normalised by stiffness
    products = combinations.T @ mass @ combinations
    softness, turned = np.linalg.eigh(0.5 * (products + products.T))
    values = 1.0 / softness[::-1]
    return combinations @ (turned[:, ::-1] * np.sqrt(values)), values
