"""What there is to draw of a machine before anything is computed: every body is rigid and stands
where a pose puts it.
"""

import dataclasses
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import DIRECTIONS, FloatArray, Frame
from headstock.geometry.machine.carriages import rail_span
from headstock.geometry.machine.joints import Joint
from headstock.geometry.machine.machine import Machine, Pose, place_components
from headstock.geometry.parts.components import (
    NORMAL,
    Component,
    FixedDirection,
    Interface,
    Support,
)
from headstock.geometry.parts.solids import SuperelementFile
from headstock.meshing.components.skins import unmeshed_skin
from headstock.pipeline.exchange.files import read_body
from headstock.pipeline.results.views import MachineView, component_skin, place_view
from headstock.pipeline.storage.part_files import describe_solid
from headstock.pipeline.storage.store import Store, default_store_root
from headstock.reduction.components.rigid import reduce_rigid
from headstock.reduction.coupling.dof_layout import DofLayout, is_rail, lay_out_dofs
from headstock.reduction.coupling.joint_springs import place_joint
from headstock.reduction.superelement import Superelement
from headstock.scene.scene import Scene


@dataclass(frozen=True, eq=False)
class SupportView:
    """Where patches of a component are fixed, machine axes.

    Attributes:
        places: ``(n, 3)`` middle of each patch [m].
        directions: ``(k, 3)`` fixed directions, unit vectors out of the component.
    """

    places: FloatArray
    directions: FloatArray


def view_rigid(scene: Scene, pose: Pose) -> tuple[MachineView, dict[str, SupportView]]:
    """Solids, joints and points of a scene in a pose, and its supports by name, without a mesh.

    Raises:
        HeadstockError: A part cannot be read, a mechanism cannot take the pose, or a joint cannot
            be placed in it.
        ValueError: The pose leaves an axis' limits.
    """
    machine = scene.machine
    placements = place_components(machine, pose)
    parts = {name: _with_supports(part, scene) for name, part in machine.components.items()}
    solids = dict.fromkeys(part.solid for part in parts.values())
    # both wait for child processes where parts come from CAD
    with ThreadPoolExecutor(2) as pool:
        waiting = {solid: pool.submit(unmeshed_skin, solid, thinned=False) for solid in solids}
        bodies = dict(zip(parts, pool.map(_rigid_body, parts.values()), strict=True))
    skins = {
        name: component_skin(part, bodies[name], waiting[part.solid].result())
        for name, part in parts.items()
    }
    layout = lay_out_dofs(bodies, placements)
    frames = {
        name: place_joint(_carry_joint(joint, machine, layout), machine, layout).frame
        for name, joint in machine.joints.items()
    }
    view = MachineView(
        skins,
        {name: axis.direction for name, axis in machine.axes.items()},
        {pose.name: place_view(machine, layout, frames)},
    )
    supports = {
        name: _view_support(support, bodies[support.component], placements[support.component])
        for name, support in machine.supports.items()
        if not isinstance(parts[support.component].solid, SuperelementFile)
    }
    return view, supports


def _with_supports(component: Component, scene: Scene) -> Component:
    """The component with an interface at each supported patch, which has a middle then; a rail whose
    ends only a mesh knows is an area like others.
    """
    extra = {
        name: Interface(name, (patch,))
        for support in scene.machine.supports.values()
        if support.component == component.name
        for name, patch in zip(
            _patch_names(support), (*support.patches, *support.edge), strict=True
        )
    }
    interfaces = {
        name: dataclasses.replace(interface, rail=None)
        if interface.rail is not None and rail_span(component.solid, interface) is None
        else interface
        for name, interface in component.interfaces.items()
    }
    return dataclasses.replace(component, interfaces=interfaces | extra)


def _carry_joint(joint: Joint, machine: Machine, layout: DofLayout) -> Joint:
    """The joint, carried along by its carriage also where that rides on a rail shown as an area."""
    if joint.length is None or any(is_rail(layout, end) for end in joint.ends):
        return joint
    first, second = joint.ends
    part = machine.components.get(first.component or "")
    on_rail = part is not None and part.interfaces[first.interface or ""].rail is not None
    ends = (second, first) if on_rail else (first, second)
    return dataclasses.replace(joint, ends=ends, length=None)


def _patch_names(support: Support) -> list[str]:
    return [
        f"support:{support.name}:{number}" for number in range(len(support.patches + support.edge))
    ]


def _view_support(support: Support, body: Superelement, placement: Frame) -> SupportView:
    middles = np.array([body.interface_maps[name].frame.origin for name in _patch_names(support)])
    if support.edge:
        middles = _edge_middle(support, middles)
    outward = middles.mean(axis=0) - body.center_of_mass
    directions = np.array([_show_direction(each, support, outward) for each in support.directions])
    signs = np.where(directions @ outward > 0.0, 1.0, -1.0)
    return SupportView(
        placement.origin + middles @ placement.rotation.T,
        (signs[:, None] * directions) @ placement.rotation.T,
    )


def _show_direction(direction: FixedDirection, support: Support, outward: FloatArray) -> FloatArray:
    """Unit vector of a fixed direction; a normal that only a mesh knows points away from the body."""
    if not isinstance(direction, str):
        return np.array(direction)
    axis = support.patches[0].face[0] if direction == NORMAL else direction
    if axis in DIRECTIONS and (direction != NORMAL or support.patches[0].face[1:] in ("-", "+")):
        return np.eye(3)[DIRECTIONS.index(axis)]
    return outward / (np.linalg.norm(outward) or 1.0)


def _edge_middle(support: Support, middles: FloatArray) -> FloatArray:
    """Middle ``(1, 3)`` of an edge between flat faces, from those of its faces."""
    middle: FloatArray = np.array([middles[:, axis].mean() for axis in range(3)])
    for number, patch in enumerate((*support.patches, *support.edge)):
        if patch.face[0] in DIRECTIONS and patch.face[1:] in ("-", "+"):
            axis = DIRECTIONS.index(patch.face[0])
            middle[axis] = middles[number, axis]
    return middle.reshape(1, 3)


def _rigid_body(component: Component) -> Superelement:
    if isinstance(component.solid, SuperelementFile):
        return dataclasses.replace(read_body(component.solid), name=component.name)
    return reduce_rigid(component, describe_solid(component, Store(default_store_root())))
