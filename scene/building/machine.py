"""From a checked scene to the machine in SI units.

Which components hang together, which stand on ground, and which an axis moves.
"""

from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from headstock.geometry.machine.joints import GROUND, Axis, Joint
from headstock.geometry.machine.machine import Machine, Point, Pose, Probe, find_limit_fault, orient_machine
from headstock.geometry.parts.components import Component, Load, Support
from headstock.scene.building.components import (
    NO_MATERIAL,
    build_component,
    build_frame,
    build_material,
    build_patch,
    build_solid,
)
from headstock.scene.building.joints import build_joint, connects, tie_bearings
from headstock.scene.building.mechanism import build_mechanism
from headstock.scene.building.rails import choose_stations
from headstock.scene.reading.units import ANGLE, LENGTH, Quantity
from headstock.scene.schema.components import PatchTable
from headstock.scene.schema.connections import AxisTable, LoadTable, SupportTable
from headstock.scene.schema.effects import read_gravity
from headstock.scene.schema.scene import SceneTable

Edge = tuple[str, str]


def reachable_from_ground(edges: Iterable[Edge]) -> frozenset[str]:
    """Components with a chain of edges to ground; an edge names two components or ground."""
    neighbours: dict[str, set[str]] = {}
    for first, second in edges:
        neighbours.setdefault(first, set()).add(second)
        neighbours.setdefault(second, set()).add(first)
    reached, frontier = {GROUND}, [GROUND]
    while frontier:
        fresh = neighbours.get(frontier.pop(), set()) - reached
        reached |= fresh
        frontier.extend(fresh)
    return frozenset(reached - {GROUND})


def floating_groups(components: Iterable[str], edges: Iterable[Edge]) -> list[list[str]]:
    """Groups of connected components without a chain to ground, in the order of the scene."""
    edges = list(edges)
    left = [name for name in components if name not in reachable_from_ground(edges)]
    groups: list[list[str]] = []
    while left:
        seeded = [*((first, second) for first, second in edges if GROUND not in (first, second)), (GROUND, left[0])]
        group = reachable_from_ground(seeded)
        groups.append([name for name in left if name in group])
        left = [name for name in left if name not in group]
    return groups


def moved_components(components: Iterable[str], edges: Mapping[str, Edge], joints: Iterable[str]) -> tuple[str, ...]:
    """Components that are cut off from ground when an axis' joints are taken away.

    Args:
        components: Component names in the order of the scene.
        edges: The two sides of every joint (and support) by name.
        joints: Names of the joints of the axis.

    Returns:
        Names in the order of the scene; those that reach ground in no case are left out.
    """
    own = set(joints)
    before = reachable_from_ground(edges.values())
    after = reachable_from_ground(edge for name, edge in edges.items() if name not in own)
    return tuple(name for name in components if name in before and name not in after)


def find_position_fault(axis: str, value: Quantity, scene: SceneTable) -> str:
    """Why an axis of the scene cannot stand at a position; empty where it can.

    Args:
        axis: Its name.
        value: Length or angle as written.
        scene: With the axis.
    """
    table = scene.axes[axis]
    if fault := find_unit_fault(value, table):
        return fault
    if table.limits is None or value.dimension != table.limits[0].dimension:
        return ""
    low, high = (limit.value for limit in table.limits)
    return find_limit_fault(axis, value.value, (low, high), value.dimension.unit)


def find_unit_fault(value: Quantity, axis: AxisTable) -> str:
    """Why a quantity is no position of an axis: an angle where it is linear, or a length; empty where it is one."""
    wanted = LENGTH if axis.kind == "linear" else ANGLE
    if value.dimension == wanted:
        return ""
    article = "an" if value.dimension == ANGLE else "a"
    return f'is {article} {value.dimension.name}, but the axis is {axis.kind}; write for example "{wanted.example}"'


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
    supports = {key: _build_support(key, table, components) for key, table in scene.supports.items()}
    machine = Machine(
        name=name,
        components=components,
        joints=joints,
        points={key: Point(key, table.tool, table.work) for key, table in scene.points.items()},
        axes={key: _build_axis(key, table, scene, joints, supports) for key, table in scene.axes.items()},
        supports=supports,
        loads={key: _build_load(key, table, components) for key, table in scene.loads.items()},
        probes={key: Probe(key, table.component, (table.at[0], table.at[1], table.at[2])) for key, table in scene.probes.items()},
        gravity=read_gravity(scene.effects.get("gravity", True)),
        mechanism=None if scene.mechanism is None else build_mechanism(scene.mechanism),
    )
    if "orientation" not in scene.model_fields_set:
        return machine
    return orient_machine(machine, build_frame(scene.orientation.at, scene.orientation.rotate))


def build_poses(scene: SceneTable) -> dict[str, Pose]:
    """Poses by name; ``reference`` with every axis at zero when the scene names none."""
    poses = {name: Pose(name, {axis: value.value for axis, value in table.items()}) for name, table in scene.poses.items()}
    return poses or {"reference": Pose("reference")}


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


def _build_support(name: str, table: SupportTable, components: dict[str, Component]) -> Support:
    if table.at is not None:
        component, _, interface = table.at.partition(".")
        return Support(name, component, components[component].interfaces[interface].patches, tuple(table.fix))
    component, _, face = (table.face or "").partition(".")
    patch = PatchTable(face=face, disk=table.disk, rect=table.rect, strip=table.strip)
    return Support(name, component, (build_patch(patch, components[component].solid),), tuple(table.fix))


def _build_load(name: str, table: LoadTable, components: dict[str, Component]) -> Load:
    if table.kind == "body":
        return Load(name, table.component or "", "body", vector=tuple(table.body or ()))
    component, _, area = (table.at or table.face or "").partition(".")
    if table.kind == "force":
        vector = (*(table.force or (0.0, 0.0, 0.0)), *(table.moment or (0.0, 0.0, 0.0)))
        return Load(name, component, "force", interface=area, vector=vector)
    if table.at is not None:
        patches = components[component].interfaces[area].patches
    else:
        patch = PatchTable(face=area, disk=table.disk, rect=table.rect, strip=table.strip)
        patches = (build_patch(patch, components[component].solid),)
    if table.kind == "pressure":
        return Load(name, component, "pressure", patches, magnitude=table.pressure or 0.0)
    return Load(name, component, "traction", patches, vector=tuple(table.traction or ()))


def _build_axis(name: str, table: AxisTable, scene: SceneTable, joints: dict[str, Joint], supports: dict[str, Support]) -> Axis:
    edges: dict[str, Edge] = {f"supports.{key}": (support.component, GROUND) for key, support in supports.items()}
    for key, joint in joints.items():
        if connects(joint):
            first, second = (end.component or GROUND for end in joint.ends)
            edges[key] = (first, second)
    moves = tuple(table.moves or moved_components(scene.components, edges, table.joint_names()))
    low, high = (-np.inf, np.inf) if table.limits is None else (limit.value for limit in table.limits)
    return Axis(
        name=name,
        joints=table.joint_names(),
        moves=moves,
        direction=np.array(axis_direction(table, scene)),
        kind=table.kind,
        center=np.array(table.center),
        limits=(low, high),
    )


def axis_direction(table: AxisTable, scene: SceneTable) -> tuple[float, float, float]:
    """Direction of an axis: as written, or that of the first guiding joint that has one."""
    if table.direction is not None:
        return table.direction
    kinds = ("linear_guide", "ball_screw", "prismatic") if table.kind == "linear" else ("revolute", "bearing")
    for name in table.joint_names():
        joint = scene.joints[name]
        if joint.kind in kinds and joint.axis is not None:
            return joint.axis
    raise ValueError("an axis needs a direction")
