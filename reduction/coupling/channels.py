"""Where a coupled machine is loaded and observed: interfaces, points and static loads in free
coordinates.
"""

from collections.abc import Collection

import numpy as np

from headstock.geometry.frames import DOF_NAMES, FloatArray, Frame
from headstock.geometry.machine.joints import JointEnd
from headstock.geometry.machine.machine import Machine, Point, Sensor
from headstock.geometry.parts.components import Load
from headstock.reduction.coupling.dof_layout import (
    DofLayout,
    locate_interface,
    motion_rows,
    turn_dofs,
)
from headstock.reduction.coupling.matrices import ComponentMatrices
from headstock.reduction.superelement import Superelement
from headstock.reduction.superelement_checks import rigid_motions
from headstock.solvers.errors import ModelError

GRAVITY = "gravity"
AXES = "xyz"


def machine_channels(
    layout: DofLayout, machine: Machine, basis: FloatArray, wanted: Collection[str] | None = None
) -> dict[tuple[str, str], FloatArray]:
    """Return the row ``(n,)`` of each channel, all in machine axes: motion there, and by work also
    the load of a unit force there.

    Every interface dof is a channel ``("component.interface", dof)``; every point is one as tool
    less work, at the tool; a sensor has those that it measures. Where names are wanted, only those.

    Args:
        layout: Places of the components' dofs among the ``n_all`` stacked ones.
        basis: ``(n_all, n)`` stacked dofs per free coordinate.
        wanted: Names of interfaces (``component.interface``), points and sensors; None for all.
    """
    ends = [
        JointEnd(name, interface)
        for name, superelement in layout.superelements.items()
        for interface in (*superelement.interface_maps, *superelement.rails)
    ]
    rows = {
        str(end): motion_rows(layout, end, locate_interface(layout, end))
        for end in ends
        if wanted is None or str(end) in wanted
    }
    rows |= {
        point.name: point_rows(layout, point)
        for point in machine.points.values()
        if wanted is None or point.name in wanted
    }
    channels: dict[tuple[str, str], FloatArray] = {}
    for name, stacked in rows.items():
        columns = np.flatnonzero(stacked.any(axis=0))  # the few dofs that the rows see
        reduced = stacked[:, columns] @ basis[columns]
        channels |= {(name, dof): reduced[row] for row, dof in enumerate(DOF_NAMES)}
    for sensor in machine.sensors.values():
        if sensor.directions and (wanted is None or sensor.name in wanted):
            name = sensor.component
            local = sensor_rows(layout.superelements[name], layout.placements[name], sensor)
            measured = local @ basis[layout.offsets[name]]
            channels |= {
                (sensor.name, dof): row
                for dof, row in zip(sensor.directions, measured, strict=True)
            }
    return channels


def channel_rows(layout: DofLayout, machine: Machine, name: str) -> FloatArray:
    """Return the rows ``(6, n_all)`` of the motion at a point, a sensor or an interface
    (``component.interface``) in stacked dofs; zero for what a sensor does not measure.
    """
    if name in machine.points:
        return point_rows(layout, machine.points[name])
    if name in machine.sensors:
        sensor, rows = machine.sensors[name], np.zeros((6, layout.size))
        measured = [AXES.index(dof) for dof in sensor.directions]
        owner = sensor.component
        rows[measured, layout.offsets[owner]] = sensor_rows(
            layout.superelements[owner], layout.placements[owner], sensor
        )
        return rows
    component, _, interface = name.partition(".")
    end = JointEnd(component, interface)
    return motion_rows(layout, end, locate_interface(layout, end))


def sensor_rows(superelement: Superelement, placement: Frame, sensor: Sensor) -> FloatArray:
    """Return the rows ``(k, n_c)`` of the motion in each direction of a sensor per dof of its
    component, boundary dofs in machine axes.
    """
    directions = sensor.turn_directions(placement.rotation)
    return directions @ place_rows(superelement, placement, sensor)


def place_rows(superelement: Superelement, placement: Frame, sensor: Sensor) -> FloatArray:
    """Return the rows ``(3, n_c)`` of the motion along machine axes at a sensor or point mass, whatever
    it measures; see ``sensor_rows``.

    Raises:
        ModelError: The superelement knows nothing of the sensor.
    """
    if sensor.name not in superelement.sensors:
        raise ModelError(
            f"component {sensor.component!r} was reduced without the sensor {sensor.name!r}"
        )
    local = superelement.sensors[sensor.name].motion
    return placement.rotation @ local @ turn_dofs(superelement, placement)


def point_rows(layout: DofLayout, point: Point) -> FloatArray:
    """Return the rows ``(6, n_all)`` of the motion of the tool relative to the work, both carried
    to the tool's place.
    """
    if point.tool.component is None and point.work.component is None:
        raise ModelError(
            f"point {point.name!r}: tool and work are both ground; name an interface of a component"
        )
    tool_point = locate_interface(layout, point.carrier, point.offset)
    return motion_rows(layout, point.tool, tool_point) - motion_rows(layout, point.work, tool_point)


def machine_loads(
    layout: DofLayout,
    machine: Machine,
    matrices: ComponentMatrices,
    basis: FloatArray,
    gravity: FloatArray | None,
) -> dict[str, FloatArray]:
    """Return the generalised load ``(n,)`` of every load of the machine by name, of a ground that moves,
    and of gravity where it acts.

    Args:
        layout: Places of the components' dofs among the ``n_all`` stacked ones.
        matrices: Matrices of each component in machine axes; their masses weigh gravity.
        basis: ``(n_all, n)`` stacked dofs per free coordinate.
        gravity: ``(3,)`` acceleration in machine axes [m/s^2]; None without.

    Raises:
        ModelError: A superelement was reduced without a load that acts on it.
    """
    stacked = {load.name: _stacked_load(layout, load) for load in machine.loads.values()}
    fields = list_fields(machine, gravity)
    for name, acceleration in fields.items():
        stacked[name] = np.zeros(layout.size)
        for component in layout.superelements:
            stacked[name][layout.offsets[component]] = _weight(
                layout, matrices, component, acceleration
            )
    return {name: basis.T @ vector for name, vector in stacked.items()}


def list_fields(machine: Machine, gravity: FloatArray | None) -> dict[str, FloatArray]:
    """Return the accelerations ``(3,)`` that act on the mass of every component, by load, machine axes
    [m/s^2]: gravity, and seen from a ground that moves minus what it does.
    """
    fields = {name: -np.array(given) for name, given in machine.base_motions.items()}
    return fields if gravity is None else {**fields, GRAVITY: np.asarray(gravity, dtype=float)}


def load_factors(placement: Frame, load: Load) -> dict[str, float]:
    """Return how much of each of its superelement's unit loads a load takes where its component
    stands in the pose; empty for a force at an interface.
    """
    if load.kind == "force":
        return {}
    if load.kind == "pressure":
        return {load.name: 1.0}
    return _by_axis(load.name, placement, np.asarray(load.vector))


def gravity_factors(placement: Frame, gravity: FloatArray) -> dict[str, float]:
    """Return how much of each unit of gravity of a superelement an acceleration ``(3,)`` in machine
    axes [m/s^2] takes.
    """
    return _by_axis(GRAVITY, placement, gravity)


def _by_axis(name: str, placement: Frame, vector: FloatArray) -> dict[str, float]:
    local = placement.rotation.T @ np.asarray(vector, dtype=float)
    return {f"{name}:{axis}": float(value) for axis, value in zip(AXES, local, strict=True)}


def _stacked_load(layout: DofLayout, load: Load) -> FloatArray:
    if load.component not in layout.superelements:
        raise ModelError(
            f"load {load.name!r}: there is no component {load.component!r}; components: {sorted(layout.superelements)}"
        )
    if load.kind == "force":
        end = JointEnd(load.component, load.interface)
        return motion_rows(layout, end, locate_interface(layout, end)).T @ np.asarray(
            load.vector, dtype=float
        )
    stacked = np.zeros(layout.size)
    local = _combine(layout, load.component, load_factors(layout.placements[load.component], load))
    if local is None:
        raise ModelError(
            f"load {load.name!r}: component {load.component!r} was reduced without it; reduce it again with its loads"
        )
    stacked[layout.offsets[load.component]] = local
    return stacked


def _combine(layout: DofLayout, name: str, factors: dict[str, float]) -> FloatArray | None:
    """Return the sum of a superelement's unit loads, turned to machine axes; None if lacking."""
    superelement = layout.superelements[name]
    if not all(key in superelement.loads for key in factors):
        return None
    local = sum(
        (factor * superelement.loads[key].vector for key, factor in factors.items()),
        np.zeros(len(superelement.labels)),
    )
    return turn_dofs(superelement, layout.placements[name]).T @ local


def _weight(
    layout: DofLayout, matrices: ComponentMatrices, name: str, gravity: FloatArray
) -> FloatArray:
    """Return the weight of a component ``(n_c,)`` in machine axes: its own unit loads, or its mass
    times the acceleration.
    """
    superelement, placement = layout.superelements[name], layout.placements[name]
    local = placement.rotation.T @ gravity
    weight = _combine(layout, name, gravity_factors(placement, gravity))
    if weight is not None:
        return weight
    if superelement.mass_kg > 0.0 and (superelement.supported or not superelement.mass.any()):
        raise ModelError(f"component {name!r} was reduced without gravity; reduce it again with it")
    motions = (
        turn_dofs(superelement, placement).T
        @ rigid_motions(superelement, superelement.center_of_mass)[:, :3]
    )
    return matrices.masses[name] @ (motions @ local)
