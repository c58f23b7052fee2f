"""Rigid bodies as superelements: six dofs at the centre of mass that carry every interface."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from headstock.geometry.frames import DOF_NAMES, FloatArray, Frame, rigid_transfer
from headstock.geometry.machine.machine import Sensor
from headstock.geometry.parts.components import Component, Load
from headstock.geometry.parts.mass_properties import SolidProperties
from headstock.geometry.parts.solids import PointMass
from headstock.reduction.rails import (
    Rail,
    control_point_motion,
    control_point_positions,
    lay_out_rail,
)
from headstock.reduction.superelement import InterfaceMap, SensorRows, StaticLoad, Superelement
from headstock.reduction.superelement_checks import check_superelement
from headstock.solvers.errors import ModelError


def reduce_rigid(
    component: Component,
    properties: SolidProperties,
    loads: Sequence[Load] = (),
    sensors: Sequence[Sensor] = (),
) -> Superelement:
    """Return the superelement of a rigid body with one boundary node at its centre of mass.

    Args:
        component: Its ``mass`` scales mass and inertia when given.
        properties: Volume, centre, inertia and interface centroids of its solid.
        loads: Loads on this component: body loads and tractions become one unit load per component
            axis, ``NAME:x`` and so on; forces at interfaces need none; ``pressure`` needs a mesh
            and is refused.
        sensors: On this component.

    Raises:
        ModelError: A mass property is not finite, the volume is not positive, or a load cannot act
            on a rigid body.
        AccuracyError: The superelement fails its own check.
    """
    density = find_density(component, properties)
    mass_kg = density * properties.volume
    inertia = density * 0.5 * (properties.inertia + properties.inertia.T)
    mass = np.zeros((6, 6))
    mass[:3, :3] = mass_kg * np.eye(3)
    mass[3:, 3:] = inertia
    center = np.asarray(properties.center, dtype=float)
    fixed = [name for name, interface in component.interfaces.items() if interface.rail is None]
    superelement = Superelement(
        name=component.name,
        labels=tuple(("center", dof) for dof in DOF_NAMES),
        frames=(Frame(center),),
        interface_maps={
            name: InterfaceMap(0, Frame(properties.patch_centroids[name])) for name in fixed
        },
        stiffness=np.zeros((6, 6)),
        mass=mass,
        constraints=_unfelt_rotations(component, inertia),
        modal_frequencies_hz=np.zeros(0),
        cutoff_hz=np.inf,
        full_dofs=6,
        mass_kg=mass_kg,
        center_of_mass=center,
        inertia=inertia,
        loads={
            name: unit
            for load in loads
            if load.component == component.name
            for name, unit in _unit_loads(load, component, properties, mass_kg).items()
        },
        rails=_rigid_rails(component, properties, center),
        sensors={
            sensor.name: SensorRows(rigid_transfer(center, np.array(sensor.position))[:3])
            for sensor in sensors
        },
    )
    check_superelement(superelement)
    return superelement


def _unfelt_rotations(component: Component, inertia: FloatArray) -> FloatArray:
    """Return the rows ``(m, 6)`` of the rotations that a point mass without inertia does not
    resist: fixed unless a joint acts on them.
    """
    if not isinstance(component.solid, PointMass):
        return np.zeros((0, 6))
    return np.eye(6)[3:][inertia.diagonal() == 0.0]


def _rigid_rails(
    component: Component, properties: SolidProperties, origin: FloatArray
) -> dict[str, Rail]:
    """Return the rails that move rigidly with the body: exact for any carriage."""
    rails = {}
    for name, interface in component.interfaces.items():
        if interface.rail is not None:
            layout = lay_out_rail(component, interface, properties.patch_centroids[name])
            points = control_point_positions(layout.knots, layout.center, layout.axis)
            control = np.vstack(
                [control_point_motion(point, layout.axis, origin) for point in points]
            )
            rails[name] = dataclasses.replace(layout, control=control)
    return rails


def find_density(component: Component, properties: SolidProperties) -> float:
    """Return the density that gives the wanted mass [kg/m^3]."""
    if not (
        np.isfinite(properties.volume)
        and properties.volume > 0.0
        and np.isfinite(properties.inertia).all()
    ):
        raise ModelError(
            f"component {component.name!r}: its volume is {properties.volume:g} m^3; a rigid body needs a solid of finite volume"
        )
    density = (
        component.material.density if component.mass is None else component.mass / properties.volume
    )
    if not (np.isfinite(density) and density >= 0.0):
        raise ModelError(
            f"component {component.name!r}: its density is {density:g} kg/m^3; write a mass of zero or more"
        )
    return density


def _unit_loads(
    load: Load, component: Component, properties: SolidProperties, mass_kg: float
) -> dict[str, StaticLoad]:
    """Return the resultants at the centre of mass of one unit of a load along each axis of the
    component, as elastic components have them.
    """
    group = f"load:{load.name}"
    if load.kind == "force":
        return {}
    if load.kind == "body":
        resultants = mass_kg * np.eye(6, 3)
    elif load.kind == "traction" and group in properties.patch_centroids:
        resultants = (
            properties.patch_areas[group]
            * rigid_transfer(properties.center, properties.patch_centroids[group])[:3].T
        )
    else:
        raise ModelError(
            f"load {load.name!r}: {load.kind} cannot act on the rigid component {component.name!r}; "
            "write a force at one of its interfaces, or make the component elastic"
        )
    return {f"{load.name}:{axis}": StaticLoad(resultants[:, i]) for i, axis in enumerate("xyz")}
