"""The machine of a checked scene, in SI units."""

from pathlib import Path

from headstock.geometry.machine.joints import Joint
from headstock.geometry.machine.machine import Machine, Point, Probe, orient_machine
from headstock.geometry.parts.components import Component
from headstock.scene.building.axes import build_axis
from headstock.scene.building.components import NO_MATERIAL, build_component, build_frame, build_material, build_solid
from headstock.scene.building.joints import build_joint, tie_bearings
from headstock.scene.building.loads import build_load, build_support
from headstock.scene.building.mechanism import build_mechanism
from headstock.scene.building.rails import choose_stations
from headstock.scene.schema.effects import read_gravity
from headstock.scene.schema.scene import SceneTable


def build_machine(scene: SceneTable, name: str, folder: Path) -> Machine:
    """Build the machine of a scene that has passed every check.

    Args:
        scene: Validated and checked tables.
        name: Name of the machine.
        folder: Folder of the scene, for the files it refers to.

    Returns:
        The machine, set up in the orientation the scene asks for.
    """
    components = _build_components(scene, folder)
    joints = _build_joints(scene, components)
    supports = {key: build_support(key, table, components) for key, table in scene.supports.items()}
    machine = Machine(
        name=name,
        components=components,
        joints=joints,
        points={key: Point(key, table.tool, table.work) for key, table in scene.points.items()},
        axes={key: build_axis(key, table, scene, joints, supports) for key, table in scene.axes.items()},
        supports=supports,
        loads={key: build_load(key, table, components) for key, table in scene.loads.items()},
        probes={key: Probe(key, table.component, (table.at[0], table.at[1], table.at[2])) for key, table in scene.probes.items()},
        gravity=read_gravity(scene.effects.get("gravity", True)),
        mechanism=None if scene.mechanism is None else build_mechanism(scene.mechanism),
    )
    if "orientation" not in scene.model_fields_set:
        return machine
    return orient_machine(machine, build_frame(scene.orientation.at, scene.orientation.rotate))


def _build_components(scene: SceneTable, folder: Path) -> dict[str, Component]:
    materials = {name: build_material(name, table) for name, table in scene.materials.items()}
    solids = {name: build_solid(table.solid, folder) for name, table in scene.components.items()}
    stations = choose_stations(scene, solids)
    return {
        name: build_component(
            name,
            table,
            solids[name],
            NO_MATERIAL if table.material is None else materials[table.material],
            free=scene.free,
            stations=stations[name],
        )
        for name, table in scene.components.items()
    }


def _build_joints(scene: SceneTable, components: dict[str, Component]) -> dict[str, Joint]:
    """The joints of a scene, and behind each screw with two fixed bearings its shaft as a tie between them."""
    joints: dict[str, Joint] = {}
    for key, table in scene.joints.items():
        joints[key] = build_joint(key, table)
        tie = tie_bearings(f"{key}_shaft", joints[key])
        if tie is not None and any(components[end.component or ""].fidelity != "rigid" for end in tie.ends):
            joints[tie.name] = tie
    return joints
