"""Sensors and point masses on the components of a run, once these are reduced: what is stored of an
elastic component does not depend on them.
"""

import dataclasses
import importlib
from collections.abc import Iterable, Sequence

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.machine import Sensor
from headstock.geometry.parts.components import Component
from headstock.geometry.parts.nearest_places import (
    describe_distance,
    encloses,
    find_nearest_place,
)
from headstock.geometry.parts.skins import Skin, solid_skin
from headstock.geometry.parts.solids import SuperelementFile
from headstock.pipeline.stages.components import load_or_make_mesh
from headstock.pipeline.stages.run_state import PoseModel, RunState, component_sensors
from headstock.reduction.components.sensors import (
    SensorPlaceError,
    carry_masses,
    observe_recovered,
)
from headstock.reduction.coupling.channels import place_rows
from headstock.reduction.superelement import SensorRows, Superelement
from headstock.scene.building.sensors import sensor_key
from headstock.scene.reading.findings import SceneError

# loads finite elements, which runs whose sensors are on other bodies do without
MESH_MODULE = "headstock.reduction.components.sensor_places"


def place_sensors(state: RunState, names: Iterable[str]) -> None:
    """Add sensors and point masses to the superelements of components that are reduced; on rank 0.

    Raises:
        SceneError: A sensor does not lie on its component.
    """
    for name in dict.fromkeys(names):
        component = state.plan.components[name]
        sensors = component_sensors(state, component)
        if not sensors or name not in state.reduced:
            continue
        reduced = state.reduced[name]
        element = reduced.superelement
        missing = [sensor for sensor in sensors if sensor.name not in element.sensors]
        try:
            if component.fidelity == "rigid":
                _check_surface(reduced.skin, sensors)
            rows = _observe(state, component, element, missing)
        except SensorPlaceError as error:
            raise _locate_place(state, error) from error
        placed = dataclasses.replace(element, sensors=element.sensors | rows)
        state.reduced[name] = dataclasses.replace(
            reduced, superelement=carry_masses(placed, sensors)
        )


def sensor_motions(model: PoseModel, motions: FloatArray) -> FloatArray:
    """Return the motion ``(k, s, 3)`` along machine axes at every sensor and point mass, in the order of
    ``scene.machine.sensors``, of motions of superelement dofs ``(n_all, k)``.
    """
    elements, sensors = model.parts.superelements, model.parts.scene.machine.sensors
    moved = [
        place_rows(elements[one.component], model.placements[one.component], one)
        @ motions[model.offsets[one.component]]
        for one in sensors.values()
    ]
    return np.array(moved).reshape(len(sensors), 3, motions.shape[1]).transpose(2, 0, 1)


def _check_surface(skin: Skin | None, sensors: Sequence[Sensor]) -> None:
    """Raise SensorPlaceError for a sensor that is not on a rigid part from a file; of other solids the
    scene has been checked.
    """
    if skin is None:
        return
    for sensor in sensors:
        position = np.array(sensor.position)
        nearest, distance = find_nearest_place(skin, position)
        if distance > sensor.reach and not encloses(skin, position):
            raise SensorPlaceError(sensor, nearest, distance)


def _observe(
    state: RunState, component: Component, element: Superelement, sensors: list[Sensor]
) -> dict[str, SensorRows]:
    if not sensors:
        return {}
    if isinstance(component.solid, SuperelementFile):
        return observe_recovered(element, sensors)
    mesh, _ = load_or_make_mesh(state, component)
    places = importlib.import_module(MESH_MODULE)
    rows: dict[str, SensorRows] = places.observe_mesh(element, mesh, component.material, sensors)
    return rows


def _locate_place(state: RunState, error: SensorPlaceError) -> SceneError:
    """The error of a sensor with its place in the scene, and the component that is nearer."""
    scene, sensor, components = state.scene, error.sensor, state.scene.machine.components
    skins = {}
    for name, component in components.items():
        skin = solid_skin(component.solid)
        if skin is None and name in state.reduced:
            skin = state.reduced[name].skin
        if skin is not None:
            skins[name] = skin
    text = describe_distance(
        sensor.component,
        np.array(sensor.position),
        error.nearest,
        error.distance,
        skins,
        {name: component.placement for name, component in components.items()},
    )
    return SceneError([scene.findings.describe(sensor_key(sensor), f"{sensor.name} {text}")])
