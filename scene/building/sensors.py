"""Sensors and point masses of a machine: built from their tables, and what may be wrong with them."""

import dataclasses
import importlib
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

from headstock.geometry.frames import DIRECTIONS, FloatArray, Frame, find_axis
from headstock.geometry.machine.machine import Machine, Sensor
from headstock.geometry.parts.nearest_places import describe_distance, find_nearest_place
from headstock.geometry.parts.patches import PlanarSolid, planar_boxes
from headstock.geometry.parts.skins import solid_skin
from headstock.geometry.parts.solids import Tube
from headstock.meshing.process.strangers import TEST_DATA
from headstock.scene.building.components import build_frame
from headstock.scene.building.draft import Draft
from headstock.scene.reading.csv_files import CsvError
from headstock.scene.reading.files import UFF_SUFFIXES, resolve_file
from headstock.scene.reading.findings import Findings, KeyPath
from headstock.scene.schema import types
from headstock.scene.schema.components import ComponentTable
from headstock.scene.schema.scene import SceneTable
from headstock.scene.schema.sensors import MassTable, SensorTable
from headstock.scene.test_data.errors import MeasurementError
from headstock.scene.test_data.records import TableRow, Vector

# loaded for scenes with such a table
TABLES = "headstock.scene.test_data.point_tables"
SUFFIXES = (".csv", *UFF_SUFFIXES)
OUTSIDE = 1e-9  # [m]: rounding of a place on a face


def build_sensors(scene: SceneTable, folder: Path, findings: Findings) -> dict[str, Sensor]:
    """Build the sensors and point masses of a scene by name; those of a table are called
    ``NAME.POINT``. What is wrong is reported.

    Args:
        folder: Of the scene, for the tables it refers to.
    """
    built: dict[str, Sensor] = {}
    for section, tables in (("sensors", scene.sensors), ("masses", scene.masses)):
        for name, table in tables.items():
            key: KeyPath = (section, name)
            try:
                built |= {one.name: one for one in _build_places(name, table, scene, folder)}
            except (CsvError, MeasurementError) as error:
                findings.add((*key, "file"), str(error))
            except ValueError as error:
                findings.add(key, str(error))
    return built


def _build_places(name: str, table: MassTable, scene: SceneTable, folder: Path) -> Iterator[Sensor]:
    if table.file is None:
        x, y, z = table.at or (0.0, 0.0, 0.0)
        row = TableRow(0, name, table.component or "", (x, y, z), "", table.mass)
        yield _build_place(name, table, row, scene)
        return
    file = resolve_file(folder, table.file, SUFFIXES, TEST_DATA)
    rows: tuple[TableRow, ...] = importlib.import_module(TABLES).read_places(file, table.unit or "")
    for row in rows:
        try:
            yield _build_place(f"{name}.{row.name}", table, row, scene)
        except ValueError as error:
            raise CsvError(f"{table.file}:{row.line}: {error}") from error


def _build_place(name: str, table: MassTable, row: TableRow, scene: SceneTable) -> Sensor:
    """Build a sensor or point mass from its table and its row there.

    Raises:
        ValueError: The row lacks a component or a mass, or its directions mean nothing.
    """
    component = row.component or table.component or ""
    if not component:
        raise ValueError('names no component; add a column component, or write component = "name"')
    sensor = Sensor(
        name,
        component,
        _place_in_component(row.position, table, scene.components.get(component)),
        mass=(table.mass if row.mass is None else row.mass) or 0.0,
        reach=table.reach,
    )
    if isinstance(table, SensorTable):
        written: Sequence[str | Vector] = row.measured[:3] or table.directions
        if row.directions:
            written = _read_directions(row.directions)
        return dataclasses.replace(
            sensor,
            directions=name_directions(written),
            fixed_axes=table.axes == "machine",
            is_loaded=table.residual_modes,
        )
    if sensor.mass == 0.0:
        raise ValueError('has no mass; add a column mass, or write mass = "100 g"')
    return dataclasses.replace(sensor, is_loaded=True)


def _place_in_component(
    position: Vector, table: MassTable, component: ComponentTable | None
) -> Vector:
    if table.frame == "component" or component is None:
        return position
    frame: Frame = build_frame(component.at, component.rotate)
    x, y, z = (float(value) for value in frame.rotation.T @ (np.array(position) - frame.origin))
    return x, y, z


def _read_directions(text: str) -> list[str | Vector]:
    """Read directions from a cell of a table: ``x z``, ``xyz``, or three numbers of one vector."""
    words = text.replace(";", " ").split()
    letters = "".join(words)
    if letters and set(letters) <= set(DIRECTIONS) and len(set(letters)) == len(letters):
        return list(letters)
    try:
        return [types.read_direction([float(word) for word in words])]
    except ValueError as error:
        raise ValueError(
            f'{text[:80]!r} names no directions; write "x z", or three numbers such as "0 0.7 0.7"'
        ) from error


def name_directions(written: Iterable[str | Vector]) -> dict[str, Vector]:
    """Return the vector of each dof: letters and vectors along axes are axes, others take the letters
    that are left in their order.
    """
    vectors = [types.read_direction(one) if isinstance(one, str) else one for one in written]
    axes = [find_axis(vector) for vector in vectors]
    named = {axis[0]: types.read_direction(axis[0]) for axis in axes if axis is not None}
    left = [letter for letter in DIRECTIONS if letter not in named]
    oblique = [vector for vector, axis in zip(vectors, axes, strict=True) if axis is None]
    named |= dict(zip(left, oblique, strict=False))
    return {dof: named[dof] for dof in DIRECTIONS if dof in named}


def check_sensors(draft: Draft) -> None:
    """Report sensors on unknown components, those that do not lie on their solid, and names that mean
    something else as well.
    """
    for sensor in draft.sensors.values():
        key = sensor_key(sensor)
        draft.check_name((*key, "component"), sensor.component, "components")
        if fault := _find_place_fault(sensor, draft):
            draft.add(key, f"{sensor.name} {fault}")
    for name in {**draft.table.sensors, **draft.table.masses}:
        section = "sensors" if name in draft.table.sensors else "masses"
        for other in ("points", "probes", "loads", "components", "sensors"):
            if other != section and name in draft.sections.get(other, ()):
                draft.add(
                    (section, name),
                    f"{name} is also the name of an entry of {other}; rename one of them",
                )


def _find_place_fault(sensor: Sensor, draft: Draft) -> str:
    """Why a sensor does not lie on a solid; empty where it does, and where only a file knows."""
    solid, place = draft.solids.get(sensor.component), np.array(sensor.position)
    if not isinstance(solid, PlanarSolid | Tube) or _lies_inside(place, solid):
        return ""
    parts = draft.table.components
    drawn = {name: solid_skin(draft.solids[name]) for name in draft.solids.keys() & parts.keys()}
    skins = {name: skin for name, skin in drawn.items() if skin is not None}
    if sensor.component not in skins:
        return ""
    nearest, distance = find_nearest_place(skins[sensor.component], place)
    if distance <= sensor.reach:
        return ""
    frames = {name: build_frame(part.at, part.rotate) for name, part in parts.items()}
    return describe_distance(sensor.component, place, nearest, distance, skins, frames)


def _lies_inside(place: FloatArray, solid: PlanarSolid | Tube) -> bool:
    """Return whether a place ``(3,)`` lies in the material of a solid, its surface included."""
    if isinstance(solid, Tube):
        radius = 2.0 * float(np.hypot(place[0], place[1]))
        return bool(
            solid.inner_diameter - OUTSIDE <= radius <= solid.outer_diameter + OUTSIDE
            and -OUTSIDE <= place[2] <= solid.length + OUTSIDE
        )
    return (
        sum(
            sign
            for sign, low, high in planar_boxes(solid)
            if (place >= low - sign * OUTSIDE).all() and (place <= high + sign * OUTSIDE).all()
        )
        > 0.0
    )


def load_places(machine: Machine, names: Iterable[str]) -> Machine:
    """Return the machine with those of its sensors marked at which forces act.

    Args:
        names: Of sensors, among others.
    """
    loaded = {
        name: dataclasses.replace(machine.sensors[name], is_loaded=True)
        for name in names
        if name in machine.sensors
    }
    return dataclasses.replace(machine, sensors=machine.sensors | loaded)


def sensor_key(sensor: Sensor) -> KeyPath:
    """Return where a sensor or point mass is written."""
    return "sensors" if sensor.directions else "masses", sensor.name.partition(".")[0]
