"""CAD shapes of solids in the open gmsh model (OpenCASCADE kernel)."""

import re
from collections.abc import Collection
from pathlib import Path

import gmsh
import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.patches import column_cells, planar_boxes
from headstock.geometry.parts.plane_shapes import PlaneShape, Polygon
from headstock.geometry.parts.solids import (
    Box,
    HollowColumn,
    ParametricSolid,
    Plate,
    StepFile,
    Tube,
)
from headstock.meshing.component_mesh import IntArray
from headstock.meshing.errors import MeshError, PartFileError
from headstock.meshing.length_units import STEP_UNIT, doubt_size

Shape = ParametricSolid | StepFile
DimTags = list[tuple[int, int]]
# OpenCASCADE's tolerances are absolute, 1e-7 of its unit: far outside, gmsh makes no triangles and
# says nothing
SHORTEST, LONGEST = 1e-6, 1e3  # [m]
LEAST_POLYGON = 12
# what makes OpenCASCADE open other files, wherever they lie; second names are those of short
# exchange files
OTHER_FILES = rb"PRODUCT_DEFINITION_WITH_ASSOCIATED_DOCUMENTS|PDWAD|APDCRF"
OTHER_FILES_BESIDE_DOCUMENT_FILE = rb"APPLIED_DOCUMENT_REFERENCE"
FILE_WORDS = (b"DOCUMENT", b"DCMFL", b"PDWAD", b"APDCRF")  # one of them is in each of these names
DOCUMENT_FILE = rb"\b(?:DOCUMENT_FILE|DCMFL)\b"


def build_shape(solid: Shape) -> int:
    """Build a solid and return the tag of its volume.

    Raises:
        MeshError: The shape cannot be built or is not one solid.
    """
    if isinstance(solid, StepFile):
        volume = _import_step(solid)
    elif isinstance(solid, Tube):
        volume = _build_tube(solid)
    else:
        volume = _build_planar(solid)
    gmsh.model.occ.synchronize()
    return volume


def _build_tube(tube: Tube) -> int:
    occ = gmsh.model.occ
    outer = occ.addCylinder(0, 0, 0, 0, 0, tube.length, tube.outer_diameter / 2)
    if tube.inner_diameter == 0.0:
        return int(outer)
    inner = occ.addCylinder(0, 0, 0, 0, 0, tube.length, tube.inner_diameter / 2)
    return _one_volume(occ.cut([(3, outer)], [(3, inner)])[0])


def _build_planar(solid: Box | Plate | HollowColumn) -> int:
    occ = gmsh.model.occ
    boxes = planar_boxes(solid)
    # ribs overlap where they cross: fuse them instead of subtracting the crossings
    if isinstance(solid, Plate):
        boxes = [box for box in boxes if box[0] > 0.0]
    tags = [(3, int(occ.addBox(*low, *(high - low)))) for _, low, high in boxes]
    if len(tags) == 1:
        return tags[0][1]
    if isinstance(solid, HollowColumn):
        tools = tags[1:] + (_core_holes(solid) if solid.core_hole > 0.0 else [])
        return _one_volume(occ.cut(tags[:1], tools)[0])
    return _one_volume(occ.fuse(tags[:1], tags[1:])[0])


def _core_holes(column: HollowColumn) -> DimTags:
    """Return the cylinders that pierce caps and horizontal ribs along z, and vertical ribs along
    their normals, in every cell.
    """
    occ = gmsh.model.occ
    x_cells, y_cells, z_cells = column_cells(column)
    middles = [[(low + high) / 2 for low, high in cells] for cells in (x_cells, y_cells, z_cells)]
    radius = column.core_hole / 2
    length = column.size[2]
    tags = [
        occ.addCylinder(x, y, -0.1 * length, 0, 0, 1.2 * length, radius)
        for x in middles[0]
        for y in middles[1]
    ]
    spans = [(cells[0][0], cells[-1][1]) for cells in (x_cells, y_cells)]
    if column.ribs_x:
        reach = spans[0][1] - spans[0][0]
        tags += [
            occ.addCylinder(spans[0][0], y, z, reach, 0, 0, radius)
            for y in middles[1]
            for z in middles[2]
        ]
    if column.ribs_y:
        reach = spans[1][1] - spans[1][0]
        tags += [
            occ.addCylinder(x, spans[1][0], z, 0, reach, 0, radius)
            for x in middles[0]
            for z in middles[2]
        ]
    return [(3, int(tag)) for tag in tags]


def add_prism(corners: FloatArray, sweep: FloatArray) -> int:
    """Add a prism to the open model and return the tag of its volume.

    Args:
        corners: Of its base, ``(n, 3)``, around it.
        sweep: From there to its other end, ``(3,)``.
    """
    occ = gmsh.model.occ
    points = [occ.addPoint(*corner) for corner in corners]
    lines = [occ.addLine(a, b) for a, b in zip(points, points[1:] + points[:1], strict=True)]
    base = occ.addPlaneSurface([occ.addWire(lines)])
    swept = occ.extrude([(2, base)], *sweep)
    occ.synchronize()
    return int(next(tag for dim, tag in swept if dim == 3))


def add_swept(
    shape: PlaneShape,
    base: FloatArray,
    axes: FloatArray,
    sweep: FloatArray,
    *,
    side: float | None = None,
) -> int:
    """Add the volume that a plane shape sweeps and return its tag.

    Args:
        base: Where its middle begins, ``(3,)``.
        axes: In-plane axes, ``(2, 3)``.
        sweep: From there to its other end, ``(3,)``.
        side: Length of the sides of regular polygons with the area of its circles; None keeps those.
    """
    if isinstance(shape, Polygon):
        return add_prism(base + shape.corners @ axes, sweep)
    occ, tools = gmsh.model.occ, list[int]()
    for radius in filter(None, (shape.radius, shape.hole)):
        if side is None:
            tools.append(int(occ.addCylinder(*base, *sweep, radius)))
            continue
        count = 4 * int(np.ceil(max(LEAST_POLYGON, 2 * np.pi * radius / side) / 4))
        angles = 2 * np.pi * (np.arange(count) + 0.5) / count
        # circumradius of the regular polygon with the disk's area
        reach = radius * np.sqrt(2 * np.pi / (count * np.sin(2 * np.pi / count)))
        corners = reach * np.column_stack([np.cos(angles), np.sin(angles)])
        tools.append(add_prism(base + corners @ axes, sweep))
    if len(tools) > 1:
        cut, _ = occ.cut([(3, tools[0])], [(3, tools[1])])
        tools = [int(tag) for _, tag in cut]
    occ.synchronize()
    return tools[0]


def _import_step(solid: StepFile) -> int:
    path = Path(solid.path)
    imported = import_step(path)
    volumes = [tag for dim, tag in imported if dim == 3]
    chosen = _choose_solid(solid.solid, volumes, path.name)
    gmsh.model.occ.remove(
        [(dim, tag) for dim, tag in imported if (dim, tag) != (3, chosen)], recursive=True
    )
    box = gmsh.model.occ.getBoundingBox(3, chosen)
    extent = STEP_UNIT * max(box[axis + 3] - box[axis] for axis in range(3))
    if not SHORTEST <= extent <= LONGEST:
        raise MeshError(
            f"{doubt_size(path, extent)}; parts of {SHORTEST:g} to {LONGEST:g} m can be meshed and drawn"
        )
    return chosen


def import_step(path: Path) -> DimTags:
    """Import a STEP file into the open model and return its shapes, one of them a solid at least.

    Raises:
        MeshError: The file is missing, is no STEP file, refers to other files or holds no solid.
    """
    text = re.sub(
        rb"'[^']*'",
        lambda imported: b"'" + b"\n" * imported[0].count(b"\n") + b"'",
        read_step_text(path),
    )
    _refuse_odd_numbers(text, path.name)
    _refuse_other_files(text, path.name)
    try:
        imported: DimTags = gmsh.model.occ.importShapes(str(path), highestDimOnly=True)
    except Exception as error:  # gmsh raises the bare class
        raise MeshError(f"{path.name} cannot be read as STEP: {error}") from error
    gmsh.model.occ.synchronize()
    if not any(dim == 3 for dim, _ in imported):
        raise PartFileError(
            f"{path.name} holds no solid, only {len(imported)} surfaces or curves; export it as a solid body"
        )
    return imported


def read_step_text(path: Path) -> bytes:
    """Return the text of a STEP file.

    Raises:
        MeshError: The file is missing or is none.
    """
    if not path.is_file():
        raise MeshError(f"there is no file {path}")
    text = path.read_bytes()
    if b"ISO-10303-21" not in text[:4096]:
        raise PartFileError(f"{path.name} is not a STEP file (no ISO-10303-21 header)")
    return text


def _refuse_odd_numbers(text: bytes, file: str) -> None:
    """Refuse coordinates that are no numbers: they keep the kernel busy for minutes, or end it."""
    odd = re.search(rb"[(,]\s*([+-]?(?:nan|inf(?:inity)?|1\.#\w+))\b", text, re.IGNORECASE)
    if odd is not None:
        line = text[: odd.start()].count(b"\n") + 1
        raise PartFileError(
            f"{file}:{line} holds {odd[1].decode()} in place of a number; export the part again"
        )


def _refuse_other_files(text: bytes, file: str) -> None:
    """Refuse a part that names documents: the kernel would open whatever file they name, even where
    the part has all its geometry.
    """
    upper = text.upper()
    if not any(word in upper for word in FILE_WORDS):
        return  # patterns take half a second for a large file
    names = OTHER_FILES
    if re.search(DOCUMENT_FILE, text, re.IGNORECASE):
        names += b"|" + OTHER_FILES_BESIDE_DOCUMENT_FILE
    match = re.search(rb"\b(" + names + rb")\b", text, re.IGNORECASE)
    if match is not None:
        line = text[: match.start()].count(b"\n") + 1
        raise PartFileError(
            f"{file}:{line} refers to other files ({match[1].decode().upper()}), and these are never read; export the part with all its"
            " geometry in one file, without documents"
        )


def _choose_solid(wanted: int | str | None, volumes: list[int], file: str) -> int:
    names = [str(gmsh.model.getEntityName(3, tag)).split("/")[-1] for tag in volumes]
    # the translator numbers what nobody named
    named = {
        i: name for i, name in enumerate(names, 1) if name and not name.startswith("Open CASCADE")
    }
    listing = (
        ", ".join(f"{i}: {name}" for i, name in named.items())
        or f"1 to {len(volumes)}, without names"
    )
    if wanted is None and len(volumes) == 1:
        return volumes[0]
    if wanted is None:
        raise PartFileError(
            f'{file} holds {len(volumes)} solids; choose one: --solid 1 (in a scene: solid = {{ step = "{file}", solid = 1 }}), or by its name; '
            f"it holds {listing}"
        )
    if isinstance(wanted, int):
        if not 1 <= wanted <= len(volumes):
            raise PartFileError(
                f"{file} has no solid number {wanted}, counted from 1; it holds {listing}"
            )
        return volumes[wanted - 1]
    matches = [tag for tag, name in zip(volumes, names, strict=True) if name == wanted]
    if len(matches) != 1:
        raise PartFileError(
            f"{file} has {len(matches)} solids named {wanted!r}; it holds {listing}"
        )
    return matches[0]


def _one_volume(shapes: DimTags) -> int:
    volumes = [tag for dim, tag in shapes if dim == 3]
    if len(volumes) != 1:
        raise MeshError(
            f"the solid falls into {len(volumes)} parts; check wall, rib and hole sizes"
        )
    return int(volumes[0])


def boundary_faces(volume: int) -> list[int]:
    """Return the tags of a volume's faces in the order in which ``face:N`` counts them."""
    return sorted(abs(tag) for _, tag in gmsh.model.getBoundary([(3, volume)], oriented=False))


def face_curves(face: int) -> set[int]:
    """Return the tags of the curves around a face."""
    return {abs(curve) for _, curve in gmsh.model.getBoundary([(2, face)], oriented=False)}


def total_area(faces: Collection[int]) -> float:
    """Return the area of faces together."""
    return sum(float(gmsh.model.occ.getMass(2, face)) for face in faces)


def read_nodes() -> tuple[FloatArray, IntArray]:
    """Return the nodes of the open mesh ``(n, 3)``, and each row by tag, -1 for tags of none."""
    tags, coordinates, _ = gmsh.model.mesh.getNodes()
    row = np.full(int(tags.max(initial=0)) + 1, -1, dtype=np.int64)
    row[tags] = np.arange(len(tags))
    return coordinates.reshape(-1, 3), row
