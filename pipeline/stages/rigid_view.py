"""What there is to draw of a machine before anything is computed: every body is rigid and stands
where a pose puts it.
"""

import dataclasses
from concurrent.futures import ThreadPoolExecutor

from headstock.geometry.machine.machine import Pose, place_components
from headstock.geometry.parts.components import Component
from headstock.geometry.parts.solids import SuperelementFile
from headstock.meshing.components.meshing import describe_component
from headstock.meshing.components.skins import unmeshed_skin
from headstock.pipeline.results.views import MachineView, component_skin, place_view
from headstock.pipeline.storage.superelements import read_superelement
from headstock.reduction.components.rigid import reduce_rigid
from headstock.reduction.coupling.dof_layout import lay_out_dofs
from headstock.reduction.coupling.joint_springs import place_joint
from headstock.reduction.superelement import Superelement
from headstock.scene.scene import Scene


def view_rigid(scene: Scene, pose: Pose) -> MachineView:
    """Solids, joints and points of a scene in a pose, without a mesh.

    Raises:
        HeadstockError: A part cannot be read, a mechanism cannot take the pose, or a joint cannot
            be placed in it.
        ValueError: The pose leaves an axis' limits.
    """
    machine = scene.machine
    placements = place_components(machine, pose)
    parts = machine.components
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
        name: place_joint(joint, machine, layout).frame for name, joint in machine.joints.items()
    }
    return MachineView(
        skins,
        {name: axis.direction for name, axis in machine.axes.items()},
        {pose.name: place_view(machine, layout, frames)},
    )


def _rigid_body(component: Component) -> Superelement:
    if isinstance(component.solid, SuperelementFile):
        return dataclasses.replace(read_superelement(component.solid.path), name=component.name)
    return reduce_rigid(component, describe_component(component))
