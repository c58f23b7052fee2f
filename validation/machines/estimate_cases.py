"""Small machines of very different components, on which error estimates are held against unreduced models."""

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.joints import Joint, JointEnd
from headstock.geometry.machine.machine import Machine, Point, Pose
from headstock.geometry.parts.components import Component, Interface, MeshSettings, Patch, ReductionSettings, Support
from headstock.geometry.parts.solids import HollowColumn, Plate, Solid
from headstock.meshing.component_mesh import ComponentMesh
from headstock.meshing.components.meshing import describe_component, mesh_component
from headstock.pipeline.storage.provenance import PROJECT
from headstock.reduction.components.rigid import reduce_rigid
from headstock.reduction.superelement import Superelement
from headstock.reduction.truncation import Truncation, lowest_participating
from headstock.scene.building.loader import load_scene
from headstock.validation.machines.guideway_models import fix_carriages, view_carriages
from headstock.validation.machines.monolithic_machines import MonolithicMachine, monolithic_machine
from headstock.validation.parts.beam_components import COLUMN_SIZE, column, face_interface, mesh_settings
from headstock.validation.parts.closed_form_cases import STEEL

MACHINES = PROJECT / "machines"
MOUNT = np.diag([2e8, 2e8, 4e8, 2e5, 2e5, 2e5])
CLAMP = np.diag([5e9, 5e9, 5e9, 5e6, 5e6, 5e6])


@dataclass(frozen=True, eq=False)
class Specimen:
    """A machine in a pose with the meshes of its elastic components."""

    name: str
    machine: Machine
    pose: Pose
    meshes: dict[str, ComponentMesh]
    point: str

    @property
    def rigid(self) -> dict[str, Superelement]:
        """Superelements of the components that are not meshed."""
        parts = self.machine.components
        return {name: reduce_rigid(part, describe_component(part)) for name, part in parts.items() if name not in self.meshes}


def unreduced(specimen: Specimen) -> MonolithicMachine:
    """The machine with every node of its meshes."""
    machine, pose, meshes = specimen.machine, specimen.pose, specimen.meshes
    if not any(joint.length for joint in machine.joints.values()):
        return monolithic_machine(machine, meshes, pose)
    return monolithic_machine(fix_carriages(machine, pose), meshes, pose, views=view_carriages(machine, meshes, pose))


def keep_fewer(element: Superelement, count: int) -> Superelement:
    """The superelement as it would have been with fewer modes, and the moments of those it leaves out then."""
    boundary, size = element.boundary_size, element.boundary_size + count
    if element.truncation is None or count >= element.modal_count:
        return element
    left, squares = element.mass[:boundary, size:], (2.0 * np.pi * element.modal_frequencies_hz[count:]) ** 2
    first = element.truncation.first + (left / squares) @ left.T
    second = element.truncation.second + (left / squares**2) @ left.T
    limit = float(squares[0]) if count else lowest_participating(first, second)
    return dataclasses.replace(
        element,
        labels=element.labels[:size],
        stiffness=element.stiffness[:size, :size],
        mass=element.mass[:size, :size],
        constraints=element.constraints[:, :size],
        recovery=None,
        modal_frequencies_hz=element.modal_frequencies_hz[:count],
        cutoff_hz=float(element.modal_frequencies_hz[count]) if count else 0.0,
        truncation=Truncation(first, second, limit),
        rails={name: dataclasses.replace(rail, control=rail.control[:, :size]) for name, rail in element.rails.items()},
    )


def clamped_beam() -> Specimen:
    """The seed's column on a stiff clamp, rigid faces."""
    interfaces = {name: face_interface(name, face, "rigid") for name, face in (("foot", "z-"), ("tip", "z+"))}
    part = column(mesh_settings("tet10", 0.025), interfaces)
    return _specimen("beam", {"column": part}, {"clamp": _spring("clamp", "column.foot", CLAMP)}, "column.tip")


def patched_column() -> Specimen:
    """A hollow column with round and square averaging patches on two sides, free at its top."""
    size = (0.20, 0.24, 0.70)
    interfaces = {
        "foot": Interface("foot", (Patch("z-"),), "average"),
        "rail": Interface("rail", (Patch("x+", "rect", (size[0] / 2, 0.06, 0.55), (0.05, 0.08)),), "average"),
        "other": Interface("other", (Patch("x+", "rect", (size[0] / 2, -0.06, 0.55), (0.05, 0.08)),), "average"),
        "screw": Interface("screw", (Patch("y+", "disk", (0.0, size[1] / 2, 0.35), (0.06,)),), "rigid"),
    }
    part = _component("column", HollowColumn(size, 0.012, 0.015, 0.01, ribs_z=2), interfaces, 0.05)
    joints = {"base": _spring("base", "column.foot", MOUNT), "drive": _spring("drive", "column.screw", 0.2 * MOUNT)}
    return _specimen("hollow column", {"column": part}, joints, "column.rail")


def ribbed_plate() -> Specimen:
    """A ribbed plate on four rigid feet, seen at a disk in its middle."""
    corners = {"foot_1": (0.24, 0.16), "foot_2": (-0.24, 0.16), "foot_3": (-0.24, -0.16), "foot_4": (0.24, -0.16)}
    interfaces = {name: Interface(name, (Patch("z-", "disk", (x, y, 0.0), (0.05,)),), "rigid") for name, (x, y) in corners.items()}
    interfaces["table"] = Interface("table", (Patch("z-", "disk", (0.0, 0.0, 0.0), (0.08,)),), "average")
    part = _component("plate", Plate((0.6, 0.4, 0.02), 0.05, 0.015, ribs_x=2, ribs_y=3), interfaces, 0.05)
    joints = {name: _spring(name, f"plate.{name}", MOUNT) for name in corners}
    return _specimen("ribbed plate", {"plate": part}, joints, "plate.table")


def free_pair() -> Specimen:
    """Two of the seed's columns, one on the other, with nothing to hold them: six rigid motions."""
    lower = column(
        mesh_settings("hex27", 0.05), {"foot": face_interface("foot", "z-", "rigid"), "top": face_interface("top", "z+", "average")}
    )
    upper = dataclasses.replace(
        column(
            mesh_settings("hex27", 0.05),
            {"bottom": face_interface("bottom", "z-", "average"), "tip": face_interface("tip", "z+", "rigid")},
        ),
        name="upper",
    )
    placed = dataclasses.replace(upper, placement=dataclasses.replace(upper.placement, origin=np.array([0.0, 0.0, COLUMN_SIZE[2]])))
    ends = (JointEnd("column", "top"), JointEnd("upper", "bottom"))
    joints = {"bolt": Joint("bolt", ends, "spring", stiffness=0.2 * CLAMP)}
    return _specimen("free pair", {"column": lower, "upper": placed}, joints, "upper.tip")


def cast_column() -> Specimen:
    """The shipped column from a STEP file alone, held at its foot by a support; averaging patches for rails and screw."""
    part = load_scene(MACHINES / "step_column.toml").machine.components["column"]
    patches = {name: interface for name, interface in part.interfaces.items() if interface.coupling == "average"}
    part = dataclasses.replace(part, interfaces=patches)
    support = Support("foot", "column", (Patch("z-"),), ("x", "y", "z"))
    machine = Machine("STEP column", {"column": part}, supports={"foot": support})
    return Specimen("STEP column", machine, Pose("reference"), {"column": mesh_component(part, (support,))}, "")


def guideway() -> Specimen:
    """The shipped table on rails, far from the bearing."""
    return _shipped("guideway", "guideway.toml", "far")


def three_axis() -> Specimen:
    """The shipped three-axis machine with three elastic components."""
    return _shipped("three-axis machine", "three_axis.toml", None)


SPECIMENS: tuple[Callable[[], Specimen], ...] = (
    clamped_beam,
    patched_column,
    ribbed_plate,
    free_pair,
    guideway,
    three_axis,
)


def _component(name: str, solid: Solid, interfaces: dict[str, Interface], size: float) -> Component:
    settings = MeshSettings(size=size, order=2, cells="tet")
    return Component(name, solid, STEEL, interfaces=interfaces, mesh=settings, reduction=ReductionSettings(modes=0))


def _spring(name: str, end: str, stiffness: FloatArray) -> Joint:
    component, interface = end.split(".")
    return Joint(name, (JointEnd(), JointEnd(component, interface)), "spring", stiffness=stiffness)


def _specimen(name: str, parts: dict[str, Component], joints: dict[str, Joint], tool: str) -> Specimen:
    component, interface = tool.split(".")
    points = {"tcp": Point("tcp", JointEnd(component, interface), JointEnd())}
    meshes = {key: mesh_component(part) for key, part in parts.items()}
    return Specimen(name, Machine(name, parts, joints, points), Pose("reference"), meshes, "tcp")


def _shipped(name: str, file: str, pose: str | None) -> Specimen:
    scene = load_scene(MACHINES / file)
    meshes = {key: mesh_component(part) for key, part in scene.machine.components.items() if part.fidelity == "elastic"}
    return Specimen(name, scene.machine, scene.poses[pose] if pose else next(iter(scene.poses.values())), meshes, "tcp")
