"""From validated tables to solids, patches, materials and components."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from headstock.geometry.frames import Frame, rotation_about
from headstock.geometry.parts.components import (
    Component,
    Interface,
    MeshSettings,
    Patch,
    RailSettings,
    ReductionSettings,
    SegmentSettings,
)
from headstock.geometry.parts.materials import Material
from headstock.geometry.parts.solids import Box, HollowColumn, MeshFile, Plate, Solid, StepFile, SuperelementFile, Tube
from headstock.scene.reading.files import resolve_file
from headstock.scene.schema.components import (
    ComponentTable,
    InterfaceTable,
    MaterialTable,
    MeshTable,
    PatchTable,
    RotationTable,
    SolidTable,
)

FEWEST_STATIONS = 4
FILE_SUFFIXES: dict[str, tuple[str, ...]] = {
    "step": (".step", ".stp"),
    "mesh": (".msh", ".inp", ".bdf", ".nas"),
    "superelement": (".h5", ".hdf5"),
}
# matrices from a file bring their own stiffness and mass
NO_MATERIAL = Material("from the file", 0.0, 0.0, 0.0)


def build_material(name: str, table: MaterialTable) -> Material:
    """The material a table stands for."""
    return Material(name, table.E, table.nu, table.rho, table.loss_factor)


def build_solid(table: SolidTable, folder: Path) -> Solid:
    """The solid a table stands for.

    Raises:
        ValueError: A file it refers to is missing or out of bounds.
    """
    if table.tube is not None:
        return Tube(table.tube.outer, table.tube.inner, table.tube.length)
    if table.plate is not None:
        plate = table.plate
        return Plate(_three(plate.size), plate.rib_height, plate.rib, plate.ribs_x, plate.ribs_y)
    if table.column is not None:
        c = table.column
        return HollowColumn(_three(c.size), c.wall, c.cap, c.rib, c.ribs_z, c.ribs_x, c.ribs_y, c.core_hole)
    if table.step is not None:
        return StepFile(resolve_file(folder, table.step, FILE_SUFFIXES["step"]), table.solid)
    if table.mesh is not None:
        return MeshFile(resolve_file(folder, table.mesh, FILE_SUFFIXES["mesh"]), 1.0 if table.unit is None else table.unit)
    if table.superelement is not None:
        return SuperelementFile(resolve_file(folder, table.superelement, FILE_SUFFIXES["superelement"]))
    return Box(_three(table.box or []))


def bounding_box(solid: Solid) -> tuple[tuple[float, float], tuple[float, float], tuple[float, float]] | None:
    """Lowest and highest x, y, z of a parametric solid [m]; None where only a file knows."""
    if isinstance(solid, Tube):
        radius = 0.5 * solid.outer_diameter
        return (-radius, radius), (-radius, radius), (0.0, solid.length)
    if isinstance(solid, Box | Plate | HollowColumn):
        x, y, z = solid.size
        ribbed = isinstance(solid, Plate) and bool(solid.ribs_x or solid.ribs_y)
        height = z + solid.rib_height if ribbed and isinstance(solid, Plate) else z
        return (-0.5 * x, 0.5 * x), (-0.5 * y, 0.5 * y), (0.0, height)
    return None


def patch_center(table: PatchTable, solid: Solid) -> tuple[float, float, float] | None:
    """Centre of an imprint in component coordinates: as written, or the middle of the face; None where it is not known."""
    shape = table.disk or table.rect or table.strip
    normal = "xyz".find(table.face[0]) if table.face[1:] in ("-", "+") else -1
    if shape is not None and shape.center is not None:
        center = list(shape.center)
        if len(center) == 2:
            if normal < 0:
                return None
            center.insert(normal, 0.0)
        x, y, z = center
        return x, y, z
    box = bounding_box(solid)
    if box is None or normal < 0:
        return None
    x, y, z = (0.5 * (low + high) if axis != normal else 0.0 for axis, (low, high) in enumerate(box))
    return x, y, z


def build_patch(table: PatchTable, solid: Solid) -> Patch:
    """The patch a table stands for."""
    center = patch_center(table, solid) or (0.0, 0.0, 0.0)
    if table.disk is not None:
        return Patch(table.face, "disk", center, (table.disk.diameter,))
    if table.rect is not None:
        return Patch(table.face, "rect", center, tuple(table.rect.size))
    if table.strip is not None:
        return Patch(table.face, "strip", center, (table.strip.width,), table.strip.along)
    return Patch(table.face)


def build_frame(at: list[float], rotate: list[RotationTable]) -> Frame:
    """Placement from a position and rotations, the first of them applied first, about the parent's axes."""
    rotation = np.eye(3)
    for turn in rotate:
        rotation = rotation_about(np.array(turn.axis), turn.angle) @ rotation
    return Frame(np.array(at), rotation)


def build_interface(name: str, table: InterfaceTable, solid: Solid, stations: int | None = None) -> Interface:
    """The interface a table stands for; a rail takes the given number of stations where the table names none."""
    patches = tuple(build_patch(patch, solid) for patch in table.patch_tables())
    if table.rail is None:
        return Interface(name, patches, table.coupling, table.force)
    return Interface(
        name, patches, "average", table.force, RailSettings(table.rail.along, table.rail.stations or stations or FEWEST_STATIONS)
    )


def build_component(
    name: str, table: ComponentTable, solid: Solid, material: Material, *, free: bool, stations: Mapping[str, int]
) -> Component:
    """The component a faultless table stands for; ``stations`` are those of rails whose tables name none."""
    interfaces = {key: build_interface(key, entry, solid, stations.get(key)) for key, entry in table.interfaces.items()}
    return Component(
        name=name,
        solid=solid,
        material=material,
        placement=build_frame(table.at, table.rotate),
        interfaces=interfaces,
        fidelity=table.fidelity,
        mesh=_build_mesh_settings(table.mesh),
        reduction=ReductionSettings(table.reduction.modes_to, table.reduction.modes, table.reduction.verify),
        segments=SegmentSettings(table.segments.count, table.segments.along),
        mass=table.mass,
        free=free or table.free,
    )


def _build_mesh_settings(table: MeshTable) -> MeshSettings:
    return MeshSettings(
        table.size,
        table.order,
        table.cells,
        table.force,
        table.across_patches,
        growth=table.growth,
        rim_size=table.rim_size,
        smallest=table.smallest,
    )


def _three(values: list[float]) -> tuple[float, float, float]:
    x, y, z = values
    return x, y, z
