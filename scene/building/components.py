"""Components: solids, patches, materials and interfaces built from their tables, and what may be
wrong with them.
"""

import math
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from headstock.geometry.frames import Frame, rotation_about
from headstock.geometry.machine.joints import GROUND
from headstock.geometry.machine.machine import show_position
from headstock.geometry.parts.components import (
    Component,
    Interface,
    Material,
    MeshSettings,
    Patch,
    RailSettings,
    RayleighDamping,
    ReductionSettings,
    SegmentSettings,
)
from headstock.geometry.parts.mass_properties import solid_box, solid_volume
from headstock.geometry.parts.patches import OVERHANG_TOLERANCE, imprint_window, in_plane_axes
from headstock.geometry.parts.plane_shapes import (
    find_outline_fault,
    flatten_patch,
    patch_width,
)
from headstock.geometry.parts.prismatic_bars import patch_span, prismatic_bar
from headstock.geometry.parts.size_field import SizeField
from headstock.geometry.parts.solid_checks import find_solid_faults
from headstock.geometry.parts.solids import (
    CENTER_FACE,
    Box,
    HollowColumn,
    Imported,
    MeshFile,
    Plate,
    PointMass,
    Solid,
    StepFile,
    SuperelementFile,
    Tube,
)
from headstock.meshing.errors import MeshError
from headstock.meshing.formats import MESH_SUFFIXES
from headstock.meshing.process.strangers import ELEMENT_SIZES, files_beside, read_apart
from headstock.meshing.size_files import SUFFIX as SIZES_SUFFIX
from headstock.meshing.size_files import parse_sizes
from headstock.meshing.sizing import (
    PATCH_CELLS,
    count_patch_cells,
    default_size,
    dense_patch_message,
    largest_extent,
    thinnest_feature,
)
from headstock.scene.building.draft import Draft
from headstock.scene.reading.files import resolve_file
from headstock.scene.reading.findings import Findings, KeyPath, suggest_names
from headstock.scene.schema.components import (
    ComponentTable,
    InterfaceTable,
    MaterialTable,
    MeshTable,
    RotationTable,
    SolidTable,
)
from headstock.scene.schema.patches import PatchTable
from headstock.scene.schema.scene import SceneTable

FEWEST_CONTROL_POINTS = 4
BULK_DATA = (".bdf", ".dat", ".nas", ".pch")
FILE_SUFFIXES: dict[str, tuple[str, ...]] = {
    "step": (".step", ".stp"),
    "mesh": MESH_SUFFIXES,
    "superelement": (".h5", ".hdf5", ".op4", *BULK_DATA, ".mtx", ".sti"),
    "points": (*BULK_DATA, ".inp"),
}
ARRAY_SUFFIXES = (".h5", ".hdf5")
FLAT_OUTLINE = 1e-4  # of its extent: how far corners of an outline may lie beside their plane
# matrices from a file bring their own stiffness and mass
NO_MATERIAL = Material("from the file", 0.0, 0.0, 0.0)
PLANAR_FACES = ("x-", "x+", "y-", "y+", "z-", "z+")
# what only our own mesher can follow; the order of a mesh file's elements is raised and its
# refusals are overruled
OWN_MESH_KEYS = (
    "size",
    "cells",
    "across_patches",
    "growth",
    "rim_size",
    "smallest",
    "leave_out",
    "details",
    "sizes",
)
OTHER_SIZES = ("size", "growth", "rim_size")


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
        return table.plate.fill(Plate, rib_thickness=table.plate.rib)
    if table.column is not None:
        return table.column.fill(HollowColumn)
    if table.step is not None:
        return StepFile(resolve_file(folder, table.step, FILE_SUFFIXES["step"]), table.solid)
    if table.mesh is not None:
        path = resolve_file(folder, table.mesh, FILE_SUFFIXES["mesh"])
        chosen = None if table.solid is None else str(table.solid)
        unit = 1.0 if table.unit is None else table.unit
        return MeshFile(path, unit, _beside(path, folder), chosen)
    if table.superelement is not None:
        return SuperelementFile(
            resolve_file(folder, table.superelement, FILE_SUFFIXES["superelement"]),
            None
            if table.points is None
            else resolve_file(folder, table.points, FILE_SUFFIXES["points"]),
            table.supported,
        )
    if table.point_mass is not None:
        return PointMass(table.point_mass, _three(table.inertia or [0.0, 0.0, 0.0]))
    return Box(_three(table.box or []))


def build_sizes(table: MeshTable, folder: Path) -> SizeField | None:
    """Element sizes from place to place; None where no file gives them.

    Raises:
        ValueError: The file is missing, out of bounds or no such file.
    """
    if table.sizes is None:
        return None
    try:
        path = resolve_file(folder, table.sizes, (SIZES_SUFFIX,), ELEMENT_SIZES)
        return SizeField(**read_apart(path, ELEMENT_SIZES, parse_sizes, error=MeshError))
    except MeshError as error:
        raise ValueError(str(error)) from error


def _beside(path: Path, folder: Path) -> tuple[Path, ...]:
    """The files that hold the arrays of a mesh file, which lie in its folder.

    Raises:
        ValueError: One is missing or out of bounds.
    """
    try:
        names = files_beside(path)
    except (MeshError, OSError) as error:
        raise ValueError(str(error)) from error
    inside = path.parent.relative_to(folder.resolve())
    try:
        return tuple(resolve_file(folder, str(inside / name), ARRAY_SUFFIXES) for name in names)
    except ValueError as error:
        raise ValueError(f"{path.name} reads its arrays from another file: {error}") from error


def bounding_box(solid: Solid) -> tuple[tuple[float, float], ...] | None:
    """Lowest and highest x, y, z of a parametric solid [m]; None where only a file knows."""
    if isinstance(solid, Imported):
        return None
    low, high = solid_box(solid)
    return tuple((float(start), float(end)) for start, end in zip(low, high, strict=True))


def _patch_center(table: PatchTable, solid: Solid) -> tuple[float, float, float] | None:
    """Centre of an imprint in component coordinates: as written, or the middle of the face; None
    where it is not known.
    """
    shape = next(iter(table.shapes.values()), None)
    normal = "xyz".find(table.face[0]) if table.face[1:] in ("-", "+") else -1
    if shape is not None and shape.points:
        x, y, z = np.mean(shape.points, axis=0).tolist()
        return x, y, z
    if (written := getattr(shape, "center", None)) is not None:
        center = list(written)
        if len(center) == 2:
            if normal < 0:
                return None
            center.insert(normal, 0.0)
        x, y, z = center
        return x, y, z
    box = bounding_box(solid)
    if box is None or (normal < 0 and not table.band):
        return None
    x, y, z = (
        0.5 * (low + high) if axis != normal else 0.0 for axis, (low, high) in enumerate(box)
    )
    return x, y, z


def build_patch(table: PatchTable, solid: Solid) -> Patch:
    """The patch a table stands for."""
    center = _patch_center(table, solid) or (0.0, 0.0, 0.0)
    if not table.shapes:
        return Patch(table.face)
    ((name, shape),) = table.shapes.items()
    return shape.fill(
        Patch,
        face=table.face,
        shape=name,
        center=center,
        size=shape.lengths,
        corners=shape.points,
    )


def build_frame(at: list[float], rotate: list[RotationTable]) -> Frame:
    """Placement from a position and rotations, the first of them applied first, about the parent's
    axes.
    """
    rotation = np.eye(3)
    for turn in rotate:
        rotation = rotation_about(np.array(turn.axis), turn.angle) @ rotation
    return Frame(np.array(at), rotation)


def build_interface(
    name: str, table: InterfaceTable, solid: Solid, control_points: int | None = None
) -> Interface:
    """The interface a table stands for; a rail takes the given number of control points where the table
    names none.

    Args:
        solid: Of its component, in whose frame patches are placed.
        control_points: Of a rail whose table names none; as few as a cubic needs without.
    """
    patches = tuple(build_patch(patch, solid) for patch in table.patch_tables())
    if table.rail is None:
        return Interface(
            name,
            patches,
            table.kind,
            table.allow_singular,
            flexible=table.flexible,
            auto=table.auto,
            open_kind=table.open_kind,
        )
    return Interface(
        name,
        patches,
        "average",
        table.allow_singular,
        RailSettings(
            table.rail.along, table.rail.control_points or control_points or FEWEST_CONTROL_POINTS
        ),
    )


def build_component(
    name: str,
    table: ComponentTable,
    solid: Solid,
    material: Material,
    *,
    sizes: SizeField | None,
    free: bool,
    control_points: Mapping[str, int],
) -> Component:
    """The component a faultless table stands for; ``control_points`` are those of rails whose tables name
    none.

    Args:
        sizes: Element sizes from place to place; None for none.
        free: Every component of the scene may float.
        control_points: Of rails whose tables name none, by interface.
    """
    interfaces = {
        key: build_interface(key, entry, solid, control_points.get(key))
        for key, entry in table.interfaces.items()
    }
    return Component(
        name=name,
        solid=solid,
        material=material,
        placement=build_frame(table.at, table.rotate),
        interfaces=interfaces,
        fidelity=table.fidelity,
        mesh=table.mesh.fill(
            MeshSettings,
            size=table.mesh.size if sizes is None else float(sizes.sizes.max()),
            sizes=sizes,
        ),
        reduction=table.reduction.fill(ReductionSettings, modes_to_hz=table.reduction.modes_to),
        segments=table.segments.fill(SegmentSettings),
        mass=table.mass if table.solid.point_mass is None else table.solid.point_mass,
        free=free or table.free,
        rayleigh=RayleighDamping()
        if table.rayleigh is None
        else table.rayleigh.fill(RayleighDamping),
    )


def _three(values: list[float]) -> tuple[float, float, float]:
    x, y, z = values
    return x, y, z


def _face_names(solid: Solid) -> tuple[str, ...]:
    """Face names a solid answers to, besides ``face:N`` and ``set:NAME``."""
    if isinstance(solid, PointMass):
        return (CENTER_FACE,)
    if isinstance(solid, Tube):
        return (
            ("z-", "z+", "outer", "inner") if solid.inner_diameter > 0.0 else ("z-", "z+", "outer")
        )
    return PLANAR_FACES


def _find_face_fault(face: str, solid: Solid) -> str:
    """Why a solid has no such face; empty when it has one as far as can be said without meshing."""
    names = list(_face_names(solid))
    if face in names:
        return ""
    if isinstance(solid, PointMass):
        return f"{face[:80]!r} is not a face of a point mass, which has one: {CENTER_FACE}"
    prefix, colon, rest = face.partition(":")
    if colon and prefix == "face":
        if rest.isdecimal() and int(rest[:9]) > 0:
            return ""
        return f"{face!r}: faces are counted from 1; write face:1"
    if colon and prefix == "set" and isinstance(solid, MeshFile):
        return "" if rest else "names no set; write set:NAME with a surface set of the mesh"
    more = ["face:N", "set:NAME"] if isinstance(solid, MeshFile) else ["face:N"]
    return (
        f"{face[:80]!r} is not a face of this {_kind_of(solid)}; faces: {', '.join(names + more)}"
    )


def find_patch_fault(table: PatchTable, solid: Solid) -> str:
    """Say why a patch cannot be laid on a solid; empty when it can as far as can be said without
    meshing.
    """
    fault = _find_face_fault(table.face, solid)
    if fault or not table.shapes:
        return fault
    ((name, shape),) = table.shapes.items()
    if shape.points:
        fault = find_outline_fault(np.array(shape.points), flatness=FLAT_OUTLINE)
        if fault:
            return f"outline: {fault}"
    if table.face in ("outer", "inner"):
        return _find_band_fault(table, solid)
    if table.face not in PLANAR_FACES:
        if not isinstance(solid, StepFile | MeshFile):
            return f"a {name} needs a named face of this {_kind_of(solid)}, {table.face!r} is not one; remove the shape to use the whole face"
        center = getattr(shape, "center", None)
        if shape.points or (center is not None and len(center) == 3):
            return ""
        return "write the centre with all three coordinates"
    if table.band is not None:
        return f"a band goes around a cylinder, and {table.face} is plane; write a strip, disk, rect or ring"
    if _patch_center(table, solid) is None:
        return "the centre of this face is known from the file only; write the centre of the patch"
    box, patch = bounding_box(solid), build_patch(table, solid)
    if box is None:
        return ""
    return _find_overhang(patch, box) or _find_hole(patch, solid)


def _find_band_fault(table: PatchTable, solid: Solid) -> str:
    """Why a patch cannot be laid on the round face of a tube; empty when it can."""
    if table.band is None or not isinstance(solid, Tube):
        return f"a {next(iter(table.shapes))} needs a flat face, {table.face!r} is not one; write a band, or remove the shape to use the whole face"
    if table.band.center is not None and len(table.band.center) < 3:
        return "write the centre of the band with all three coordinates"
    patch, slack = build_patch(table, solid), OVERHANG_TOLERANCE * solid.length
    middle, half = patch.center[2], 0.5 * table.band.width
    if middle - half >= -slack and middle + half <= solid.length + slack:
        return ""
    return (
        f"the band reaches beyond the face: along z it spans {show_position(middle - half)} to {show_position(middle + half)}, "
        f"face {table.face} 0 mm to {show_position(solid.length)}; move it or make it smaller"
    )


def _kind_of(solid: Solid) -> str:
    """Word for a solid in messages."""
    words = {
        "Box": "box",
        "Tube": "tube",
        "Plate": "plate",
        "HollowColumn": "column",
        "StepFile": "STEP solid",
        "MeshFile": "mesh",
        "PointMass": "point mass",
    }
    return words.get(type(solid).__name__, "superelement")


def _find_overhang(patch: Patch, box: tuple[tuple[float, float], ...]) -> str:
    normal = "xyz".index(patch.face[0])
    axes = in_plane_axes(normal)
    if patch.shape == "strip" and patch.along not in ["xyz"[axis] for axis in axes]:
        return f"a strip on {patch.face} runs along {' or '.join('xyz'[axis] for axis in axes)}, not {patch.along}"
    window = imprint_window(normal, patch)
    for axis, start, stop in zip(axes, window[::2], window[1::2], strict=True):
        low, high = box[axis]
        slack = OVERHANG_TOLERANCE * (high - low)
        if math.isfinite(start) and (start < low - slack or stop > high + slack):
            outside = "outside" if stop <= low or start >= high else "beyond"
            return (
                f"the patch reaches {outside} the face: along {'xyz'[axis]} it spans {show_position(start)} to {show_position(stop)}, "
                f"face {patch.face} {show_position(low)} to {show_position(high)}; move it or make it smaller"
            )
    return ""


def _find_hole(patch: Patch, solid: Solid) -> str:
    """A tube's end face is a ring: refuse a disk or rect that leaves it or covers none of it."""
    if not isinstance(solid, Tube) or patch.shape == "strip":
        return ""
    center, shape = np.array(patch.center[:2]), flatten_patch(patch, np.eye(3)[:2])
    reach = shape.farthest(-center)
    if reach <= 0.5 * solid.inner_diameter * (1.0 + OVERHANG_TOLERANCE):
        return f"the patch is empty: it lies in the bore of {show_position(solid.inner_diameter)}; move it onto the ring"
    if reach > 0.5 * solid.outer_diameter * (1.0 + OVERHANG_TOLERANCE):
        return f"the patch reaches beyond the round face of {show_position(solid.outer_diameter)}; move it or make it smaller"
    return ""


def build_solids(scene: SceneTable, folder: Path, findings: Findings) -> dict[str, Solid]:
    """The solid of every component whose solid can be built; why others cannot is reported.

    Args:
        folder: Of the scene, for the files it refers to.
    """
    solids: dict[str, Solid] = {}
    for name, table in scene.components.items():
        try:
            solid = build_solid(table.solid, folder)
            faults = find_solid_faults(solid)
        except ValueError as error:
            faults = [str(error)]
        for fault in faults:
            findings.add(("components", name, "solid", table.solid.kind), fault)
        if not faults:
            solids[name] = solid
        try:
            build_sizes(table.mesh, folder)
        except ValueError as error:
            findings.add(("components", name, "mesh", "sizes"), str(error))
    return solids


def check_presence(draft: Draft) -> None:
    """Report a scene without components."""
    if not draft.table.components:
        draft.add(
            ("components",),
            "there are no components; write [components.NAME] with a solid and a material",
        )


def check_components(draft: Draft) -> None:
    """Report what is wrong with components: materials, names, meshes, segments, patches."""
    for name, table in draft.table.components.items():
        key: KeyPath = ("components", name)
        if table.material is not None:
            draft.check_name((*key, "material"), table.material, "materials")
        elif table.solid.superelement is None and table.solid.point_mass is None:
            hint = suggest_names("", draft.sections.get("materials", ()), what="materials")
            draft.add((*key, "material"), f"'material' is missing; {hint}")
        if name == GROUND:
            draft.add(
                key,
                'a component cannot be called "ground", the name of the foundation; choose another name',
            )
        if name in draft.solids:
            _check_solid(key, table, draft.solids[name], draft.findings)


def _check_solid(key: KeyPath, table: ComponentTable, solid: Solid, findings: Findings) -> None:
    for part, fault in (
        *_find_segment_faults(table, solid),
        *_find_polynomial_faults(table, solid),
        *_find_mesh_faults(table, solid),
    ):
        findings.add((*key, *part), fault)
    if isinstance(solid, SuperelementFile):
        if table.fidelity != "elastic":
            findings.add((*key, "fidelity"), "a superelement is always elastic; remove fidelity")
        if table.mass is not None:
            findings.add((*key, "mass"), "a superelement file brings its own mass; remove mass")
        return
    if isinstance(solid, PointMass):
        for name in ("mass", "material"):
            if getattr(table, name) is not None:
                findings.add((*key, name), f"a point mass has its mass in solid; remove {name}")
        if table.fidelity != "rigid":
            findings.add((*key, "fidelity"), "a point mass is always rigid; remove fidelity")
            return
    for name, interface in table.interfaces.items():
        _check_interface((*key, "interfaces", name), interface, table, solid, findings)


def _check_interface(
    key: KeyPath, table: InterfaceTable, part: ComponentTable, solid: Solid, findings: Findings
) -> None:
    if table.flexible and (len(table.patch_tables()) > 1 or table.face in ("outer", "inner")):
        findings.add(
            (*key, "coupling"),
            "deforms in shapes over one flat patch; write one interface for each patch, or "
            'coupling = "rigid" or "average"',
        )
    for index, patch in enumerate(table.patch_tables()):
        if fault := find_patch_fault(patch, solid) or _find_dense_patch(
            part, build_patch(patch, solid), solid
        ):
            findings.add((*key, *(("patches", index) if table.patches is not None else ())), fault)


def _find_mesh_faults(table: ComponentTable, solid: Solid) -> Iterator[tuple[KeyPath, str]]:
    """What is wrong with how an elastic component is to be meshed: the key below it and what to
    write.
    """
    if table.fidelity != "elastic" or not _has_shape(table):
        return
    mesh = table.mesh
    if isinstance(solid, MeshFile):
        for key in OWN_MESH_KEYS:
            if key in mesh.model_fields_set:
                yield (
                    ("mesh", key),
                    f"the mesh is that of {solid.path.name}; remove {key}, or mesh a STEP file of the part",
                )
        return
    if mesh.sizes is not None:
        for key in OTHER_SIZES:
            if key in mesh.model_fields_set:
                yield ("mesh", key), f"sizes gives them all; remove {key}, or sizes"
    for key, fault in (
        *_hex_faults(mesh, table.solid.kind),
        *_size_faults(mesh, solid),
        *_step_part_faults(mesh, solid),
        *_rim_faults(table),
    ):
        yield ("mesh", key), fault


def _hex_faults(mesh: MeshTable, kind: str) -> Iterator[tuple[str, str]]:
    """What is wrong with hexes, which fill boxes with elements of one size, by key."""
    if mesh.cells != "hex":
        return
    if mesh.sizes is not None:
        yield "cells", 'only tets take sizes from a file; write cells = "tet"'
    if kind != "box":
        yield "cells", f'hexes are made of boxes only, not of a {kind}; write cells = "tet"'
    if mesh.growth is not None:
        yield "growth", 'only tets grow from rims; write cells = "tet", or remove growth'


def _size_faults(mesh: MeshTable, solid: Solid) -> Iterator[tuple[str, str]]:
    """What is wrong with sizes at rims and at curved faces beside that of the part, by key."""
    rim, smallest, size = mesh.rim_size, mesh.smallest, mesh.size or math.inf
    if rim is not None and mesh.growth is None:
        yield "rim_size", "has no effect without growth; write growth = 0.3 too"
    if rim is not None and rim >= size:
        yield (
            "rim_size",
            "is not smaller than size; write a smaller one, or remove rim_size and growth",
        )
    if smallest is not None and (isinstance(solid, Box) or mesh.cells == "hex"):
        yield "smallest", "a box has no curved faces and no short edges; remove smallest"
    if smallest is not None and smallest > size:
        yield "smallest", "is larger than size; write a smaller one, or remove it"


def _step_part_faults(mesh: MeshTable, solid: Solid) -> Iterator[tuple[str, str]]:
    """What cannot be left out of a part that comes from no STEP file, by key."""
    if isinstance(solid, StepFile):
        return
    if mesh.leave_out is not None:
        yield "leave_out", "removes fillets and holes of STEP parts only; remove leave_out"
    if mesh.details is not None:
        yield "details", "closes holes, recesses and pads of STEP parts only; remove details"


def _find_dense_patch(table: ComponentTable, patch: Patch, solid: Solid) -> str:
    """Why a patch asks for more elements than a mesh should have; empty when it does not, or when
    only the CAD kernel can say.
    """
    if table.fidelity != "elastic" or table.mesh.cells == "hex" or table.mesh.growth is not None:
        return ""
    if isinstance(solid, Imported):
        return ""
    across = table.mesh.across_patches
    size = table.mesh.size or default_size(
        solid_volume(solid), thinnest_feature(solid), largest_extent(solid)
    )
    count = count_patch_cells(patch, solid, across=across, size=size)
    return dense_patch_message(count, patch_width(patch), across) if count > PATCH_CELLS else ""


def _rim_faults(table: ComponentTable) -> Iterator[tuple[str, str]]:
    """What is wrong with rims that a mesh is to grow from where there are none, by key."""
    mesh, interfaces = table.mesh, table.interfaces.values()
    if mesh.growth is None:
        return
    rigid = any(entry.kind == "rigid" and entry.rail is None for entry in interfaces)
    imprinted = any(patch.shapes for entry in interfaces for patch in entry.patch_tables())
    if mesh.rim_size is not None and not rigid:
        yield "rim_size", 'no interface has the coupling "rigid"; remove rim_size'
    elif mesh.rim_size is None and not imprinted:
        remedy = (
            'write rim_size = "2 mm", say, for those of rigid interfaces'
            if rigid
            else "remove growth"
        )
        yield "growth", f"there is no patch from whose rim elements could grow; {remedy}"


def _has_shape(table: ComponentTable) -> bool:
    return table.solid.superelement is None and table.solid.point_mass is None


def _find_segment_faults(table: ComponentTable, solid: Solid) -> list[tuple[KeyPath, str]]:
    """Why a segmented component cannot be one: the key below it and what to write."""
    if table.fidelity != "segmented" or not _has_shape(table):
        return []
    try:
        bar = prismatic_bar(solid, table.segments.along)
    except ValueError as error:
        return [(("fidelity",), f'cannot be segmented: {error}; write "elastic" or "rigid"')]
    faults: list[tuple[KeyPath, str]] = []
    for name, interface in table.interfaces.items():
        for patch in interface.patch_tables():
            try:
                patch_span(bar, build_patch(patch, solid))
            except ValueError as error:
                faults.append((("interfaces", name), f"cannot be attached to segments: {error}"))
    return faults


def _find_polynomial_faults(table: ComponentTable, solid: Solid) -> list[tuple[KeyPath, str]]:
    """Why the displacements of a component cannot be polynomials: the key below it and what to
    write.
    """
    if table.fidelity != "polynomial" or not _has_shape(table):
        return []
    try:
        prismatic_bar(solid)
    except ValueError as error:
        return [(("fidelity",), f'cannot be "polynomial": {error}; write "elastic" or "rigid"')]
    return [
        (
            ("interfaces", name, "coupling"),
            'deforms in shapes, which polynomials have not; write fidelity = "elastic", or coupling = "rigid" or "average"',
        )
        for name, interface in table.interfaces.items()
        if interface.flexible
    ]
