"""Machines of rigid and two-node bodies on springs, small enough to be written out by hand."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from headstock.geometry.frames import DOF_NAMES, FloatArray, Frame, rigid_transfer
from headstock.geometry.machine.joints import Joint, JointEnd
from headstock.geometry.machine.machine import Machine, Point, Pose
from headstock.geometry.parts.components import Component, Interface, Load, Material, Patch
from headstock.geometry.parts.mass_properties import SolidProperties, closed_form_properties
from headstock.geometry.parts.solids import Box
from headstock.reduction.components.rigid import reduce_rigid
from headstock.reduction.components.segmented import reduce_segmented
from headstock.reduction.coupling.coupling import CoupledMachine, couple
from headstock.reduction.superelement import InterfaceMap, Superelement

Body = tuple[Component, Superelement]


def rigid_body(
    name: str,
    mass: float,
    interfaces: Mapping[str, Sequence[float]],
    *,
    inertia: Sequence[float] = (1.0, 1.0, 1.0),
    center: Sequence[float] | FloatArray = (0.0, 0.0, 0.0),
    placement: Frame | None = None,
) -> Body:
    """A rigid body with principal moments of inertia [kg m^2] and interfaces at given places
    [m].
    """
    component = _component(name, mass, interfaces, placement)
    moments = np.diag(np.asarray(inertia, dtype=float)) / (mass or 1.0)
    centroids = {key: np.asarray(place, dtype=float) for key, place in interfaces.items()}
    properties = SolidProperties(
        1.0, np.asarray(center, dtype=float), moments, dict.fromkeys(interfaces, 1.0), centroids
    )
    return component, reduce_rigid(component, properties)


def two_node_body(
    name: str,
    mass: float,
    length: float,
    stiffness: Sequence[float] | FloatArray,
    *,
    placement: Frame | None = None,
) -> Body:
    """Two equal rigid halves at ``z = 0`` and ``z = length`` (interfaces ``foot`` and ``head``),
    sprung at half length.

    Args:
        name: Component name.
        mass: Mass of both halves [kg], each with the radius of gyration ``length / 10``.
        length: Distance of the halves [m].
        stiffness: Six stiffnesses between them [N/m, N m/rad].
        placement: Frame in the machine.
    """
    places = {"foot": np.zeros(3), "head": np.array([0.0, 0.0, length])}
    component = _component(name, mass, places, placement)
    middle = np.array([0.0, 0.0, 0.5 * length])
    foot, head = (rigid_transfer(place, middle) for place in places.values())
    stretch = np.hstack([-foot, head])
    half = 0.5 * mass * np.diag([1.0, 1.0, 1.0, *([(0.1 * length) ** 2] * 3)])
    inertia = mass * length**2 * np.diag([0.26, 0.26, 0.01])
    return component, Superelement(
        name=name,
        labels=tuple((node, dof) for node in places for dof in DOF_NAMES),
        frames=tuple(Frame(place) for place in places.values()),
        interface_maps={
            node: InterfaceMap(i, Frame(places[node])) for i, node in enumerate(places)
        },
        stiffness=stretch.T @ np.diag(np.asarray(stiffness, dtype=float)) @ stretch,
        mass=np.asarray(np.kron(np.eye(2), half), dtype=np.float64),
        constraints=np.zeros((0, 12)),
        modal_frequencies_hz=np.zeros(0),
        cutoff_hz=0.0,
        full_dofs=12,
        mass_kg=mass,
        center_of_mass=middle,
        inertia=inertia,
    )


def joint_between(
    name: str,
    first: str,
    second: str,
    *,
    stiffness: Sequence[float] | FloatArray = (0.0,) * 6,
    fixed: Sequence[int] = (),
    point: Sequence[float] | None = None,
    rotation: FloatArray | None = None,
) -> Joint:
    """A joint between ``component.interface`` or ``ground``; six stiffnesses or a full matrix."""
    matrix = np.asarray(stiffness, dtype=float)
    return Joint(
        name,
        (_end(first), _end(second)),
        "rigid" if len(fixed) == 6 else "spring",
        rotation=np.eye(3) if rotation is None else rotation,
        fixed=tuple(fixed),
        stiffness=np.diag(matrix) if matrix.ndim == 1 else matrix,
        point=None if point is None else np.asarray(point, dtype=float),
    )


def lumped_machine(
    bodies: Sequence[Body],
    joints: Sequence[Joint],
    points: Mapping[str, tuple[str, str]] | None = None,
) -> tuple[dict[str, Superelement], Machine]:
    """Superelements and the machine they make; points map a name to tool and work."""
    machine = Machine(
        "lumped",
        {component.name: component for component, _ in bodies},
        {joint.name: joint for joint in joints},
        {
            name: Point(name, _end(tool), _end(work))
            for name, (tool, work) in (points or {}).items()
        },
    )
    return {superelement.name: superelement for _, superelement in bodies}, machine


def reduce_shape(component: Component, *loads: Load) -> Superelement:
    """A component without a mesh, rigid or of segments, from the closed form of its solid."""
    properties = closed_form_properties(component)
    assert properties is not None
    reduce = reduce_segmented if component.fidelity == "segmented" else reduce_rigid
    return reduce(component, properties, loads)


def clamped_machine(component: Component, **more: Any) -> Machine:
    """A component that is clamped at its foot, with the point ``tcp`` at its tip."""
    name = component.name
    clamp = joint_between("clamp", "ground", f"{name}.foot", fixed=range(6))
    point = Point("tcp", _end(f"{name}.tip"), JointEnd())
    return Machine(name, {name: component}, {"clamp": clamp}, {"tcp": point}, **more)


def couple_clamped(component: Component, element: Superelement) -> CoupledMachine:
    return couple({component.name: element}, clamped_machine(component), Pose("reference"))


def _component(
    name: str, mass: float, interfaces: Mapping[str, object], placement: Frame | None
) -> Component:
    return Component(
        name,
        Box((1.0, 1.0, 1.0)),
        Material("lumped", 1.0, 0.0, mass),
        placement=placement or Frame(),
        interfaces={key: Interface(key, (Patch("z-"),)) for key in interfaces},
        fidelity="rigid",
    )


def _end(text: str) -> JointEnd:
    return JointEnd() if text == "ground" else JointEnd(*text.split("."))
