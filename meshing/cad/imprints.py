"""Patches on the faces of a CAD shape: choosing faces, imprinting shapes on them, and where they
end up.
"""

from dataclasses import dataclass
from itertools import combinations

import gmsh
import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import Patch
from headstock.geometry.parts.patches import FACE_DIRECTIONS
from headstock.geometry.parts.plane_shapes import (
    flatten_patch,
    patch_width,
    plane_axes,
    strip_direction,
)
from headstock.geometry.parts.solids import Tube
from headstock.meshing.cad.curved_imprints import cut_curved_face
from headstock.meshing.cad.shapes import add_swept, boundary_faces, total_area
from headstock.meshing.errors import MeshError, PartFileError, PatchError

END_TOLERANCE = 1e-6
BOX_TOLERANCE = 1e-3
NORMAL_TOLERANCE = 1e-6
IMPRINT_TOLERANCE = 1e-4
OVERHANG = 0.01  # of a patch: what may lie beyond its face without a word
RIM_PLACES = 24  # on the outline of a patch, at which that is looked for


@dataclass(frozen=True, eq=False)
class OpenShape:
    """A volume in the open gmsh model.

    Attributes:
        faces: Tags of its faces in the order in which ``face:N`` counts them.
        low: Lower corner ``(3,)`` of the bounding box.
        high: Upper corner ``(3,)`` of the bounding box.
        unit: Length of the model's unit [m], for messages.
        refinement: How many times finer than that imprints are meshed.
        polygons: Imprint disks as regular polygons of equal area, so that straight-sided elements
            keep the area.
    """

    volume: int
    solid: object
    faces: tuple[int, ...]
    low: FloatArray
    high: FloatArray
    size: float
    unit: float
    across: int
    refinement: float
    polygons: bool

    @property
    def extent(self) -> float:
        """Longest side of the bounding box."""
        return float((self.high - self.low).max())


@dataclass(frozen=True)
class Imprints:
    """Faces on which patches ended up.

    Attributes:
        sizes: Element size on each face that was imprinted.
    """

    faces: dict[str, list[int]]
    sizes: dict[int, float]
    remarks: list[str]


def imprint_patches(shape: OpenShape, groups: dict[str, list[Patch]]) -> Imprints:
    """Imprint every patch on the shape.

    Overlapping patches share the faces of their overlap; a remark names them. Imprints get points
    with a mesh size that puts at least two elements across them.

    Raises:
        PatchError: A patch names no face, lies outside its face or cannot lie there.
        MeshError: The patches cannot be imprinted together.
    """
    inputs: dict[str, list[int]] = {}
    widths: dict[int, float] = {}
    struck: set[int] = set()
    remarks: list[str] = []
    for name, patches in groups.items():
        inputs[name] = []
        for patch in patches:
            try:
                faces = _choose_faces(shape, patch.face)
                if patch.shape != "whole":
                    pieces = _cut_pieces(shape, faces, patch)
                    struck |= set(pieces.values())
                    widths |= dict.fromkeys(pieces, patch_width(patch))
                    remarks += [f"{name}: {text}" for text in _find_overhang(faces, pieces, patch)]
                    faces = list(pieces)
            except (PartFileError, ValueError) as error:
                raise PatchError(f"{name}: {error}", name) from error
            inputs[name] += faces
    wanted = {tag for tags in inputs.values() for tag in tags}
    children = _fragment_faces(
        shape, sorted(wanted & (struck | set(widths))), sorted(wanted - struck - set(widths))
    )
    sizes: dict[int, float] = {}
    for tag, width in widths.items():
        size = min(width / (shape.across * shape.refinement), shape.size)
        _refine(children[tag], size)
        sizes |= {child: min(size, sizes.get(child, size)) for child in children[tag]}
    made = {
        name: sorted({child for tag in tags for child in children[tag]})
        for name, tags in inputs.items()
    }
    return Imprints(made, sizes, remarks + _find_overlaps(made, shape.unit))


def _find_overlaps(faces: dict[str, list[int]], unit: float) -> list[str]:
    """Name interfaces that lie partly on each other; one within another, or on the same area, is
    meant.

    Args:
        faces: Of each group of patches; supports and loads have a colon in their names.
        unit: Length of the model's unit [m].
    """
    remarks = []
    for (one, first), (other, second) in combinations(
        [(name, set(tags)) for name, tags in faces.items() if ":" not in name], 2
    ):
        if first & second and first - second and second - first:
            area = 1e6 * unit**2 * total_area(first & second)
            remarks.append(
                f"{one} and {other} overlap by {area:.4g} mm^2, which both hold; move one or make it smaller"
            )
    return remarks


def _refine(faces: list[int], size: float) -> None:
    """Give the corner points of faces a mesh size unless they have a smaller one."""
    for corner in gmsh.model.getBoundary(
        [(2, face) for face in faces], combined=False, oriented=False, recursive=True
    ):
        sizes = gmsh.model.mesh.getSizes([corner])
        if not len(sizes) or sizes[0] == 0.0 or size < sizes[0]:
            gmsh.model.mesh.setSize([corner], size)


def _choose_faces(shape: OpenShape, face: str) -> list[int]:
    """Return the tags of the faces a name selects.

    Raises:
        PartFileError: There is no such face; the message lists what there is.
    """
    if face in FACE_DIRECTIONS:
        faces = _end_faces(shape, face)
    elif face.startswith("face:"):
        number = face.removeprefix("face:")
        if not number.isdigit() or not 1 <= int(number) <= len(shape.faces):
            raise PartFileError(
                f"there is no {face!r}; CAD faces are face:1 .. face:{len(shape.faces)}"
            )
        faces = [shape.faces[int(number) - 1]]
    elif face in ("outer", "inner") and isinstance(shape.solid, Tube):
        round_faces = [tag for tag in shape.faces if gmsh.model.getType(2, tag) == "Cylinder"]
        round_faces.sort(key=lambda tag: float(gmsh.model.occ.getMass(2, tag)))
        faces = round_faces[-1:] if face == "outer" else round_faces[:-1]
    else:
        faces = []
    if not faces:
        names = [name for name in FACE_DIRECTIONS if _end_faces(shape, name)]
        if isinstance(shape.solid, Tube):
            names += ["outer", "inner"] if shape.solid.inner_diameter > 0.0 else ["outer"]
        names.append(f"face:1 .. face:{len(shape.faces)}")
        raise PartFileError(f"face {face!r} selects nothing; available: {', '.join(names)}")
    return faces


def _plane_normal(face: int) -> FloatArray | None:
    """Return the unit normal ``(3,)`` of a plane face, either way; None for a curved one."""
    if gmsh.model.getType(2, face) != "Plane":
        return None
    low, _ = gmsh.model.getParametrizationBounds(2, face)
    return np.array(gmsh.model.getNormal(face, list(low)))


def _end_faces(shape: OpenShape, name: str) -> list[int]:
    axis, sign = FACE_DIRECTIONS[name]
    end = shape.high[axis] if sign > 0.0 else shape.low[axis]
    places: dict[int, float] = {}
    for tag in set(shape.faces) & {
        face for _, face in gmsh.model.getEntities(2)
    }:  # narrow ones may be left out
        normal = _plane_normal(tag)
        if normal is not None and abs(normal[axis]) > 1.0 - NORMAL_TOLERANCE:
            places[tag] = float(gmsh.model.occ.getCenterOfMass(2, tag)[axis])
    if not places:
        return []
    outermost = max(places.values(), key=lambda height: sign * height)
    if abs(outermost - end) > BOX_TOLERANCE * shape.extent:
        return []
    return [
        tag
        for tag, height in places.items()
        if abs(height - outermost) <= END_TOLERANCE * shape.extent
    ]


def _cut_pieces(shape: OpenShape, faces: list[int], patch: Patch) -> dict[int, int]:
    """Return trimmed copies of the faces inside the imprint, each with its original face."""
    occ = gmsh.model.occ
    sources: dict[int, int] = {}
    tool: int | None = None
    for face in faces:
        normal = _plane_normal(face)
        if normal is None:
            pieces = cut_curved_face(face, patch, shape.extent, shape.unit)
        else:  # several plane faces that one name selects lie in one plane
            tool = _plane_tool(shape, face, patch, normal) if tool is None else tool
            cut, _ = occ.intersect([(2, face)], [(3, tool)], removeObject=False, removeTool=False)
            pieces = [int(tag) for dim, tag in cut if dim == 2]
        sources |= dict.fromkeys(pieces, face)
    if tool is not None:
        occ.remove([(3, tool)], recursive=True)
    if not sources:
        center, low, high = (
            ", ".join(f"{value * shape.unit:.5g}" for value in values)
            for values in (patch.center, shape.low, shape.high)
        )
        raise PartFileError(
            f"the {patch.shape} around ({center}) m does not touch face {patch.face!r}; the solid spans ({low}) .. ({high}) m"
        )
    return sources


def _find_overhang(faces: list[int], pieces: dict[int, int], patch: Patch) -> list[str]:
    """Find what a closed shape on a plane face loses where it reaches beyond the face; holes that
    lie within it are meant.
    """
    normal = _plane_normal(faces[0])
    if len(faces) > 1 or normal is None or patch.shape == "strip":
        return []
    axes = plane_axes(normal)
    shape, taken = flatten_patch(patch, axes), total_area(pieces)
    if taken >= (1.0 - OVERHANG) * shape.area:
        return []
    middle = _project_center(faces[0], patch, normal)
    rim = shape.rim(RIM_PLACES, 0.5 * OVERHANG * shape.width)
    if all(gmsh.model.isInside(2, faces[0], list(point)) for point in middle + rim @ axes):
        return []
    return [
        f"the {patch.shape} reaches beyond face {patch.face!r}: {taken / shape.area:.0%} of its area lies on it, and the rest is left out; move it or "
        "make it smaller"
    ]


def _project_center(face: int, patch: Patch, normal: FloatArray) -> FloatArray:
    """Return the centre ``(3,)`` of a patch in a plane face."""
    origin, center = np.array(gmsh.model.occ.getCenterOfMass(2, face)), np.array(patch.center)
    return np.asarray(center - ((center - origin) @ normal) * normal)


def _plane_tool(shape: OpenShape, face: int, patch: Patch, normal: FloatArray) -> int:
    """Return a prism or cylinder across a plane face, without what lies in the hole of a ring."""
    axes, center = plane_axes(normal), _project_center(face, patch, normal)
    reach = 2.0 * shape.extent + float(np.linalg.norm(patch.center))
    depth = max(patch.size, default=shape.extent) * normal
    if patch.shape == "strip" and strip_direction(patch, axes):
        axes = axes[::-1]  # meshes depend on the order of corners: that of a strip begins along it
    flat = flatten_patch(patch, axes, reach)
    return add_swept(
        flat, center - depth, axes, 2 * depth, side=shape.size if shape.polygons else None
    )


def _fragment_faces(
    shape: OpenShape, pieces: list[int], untouched: list[int]
) -> dict[int, list[int]]:
    """Split the volume's faces by the pieces; what each piece and each untouched face became."""
    if not pieces:
        return {tag: [tag] for tag in untouched}
    occ = gmsh.model.occ
    areas = {tag: float(occ.getMass(2, tag)) for tag in [*pieces, *untouched]}
    middles = {tag: np.array(occ.getCenterOfMass(2, tag)) for tag in untouched}
    _, mapping = occ.fragment([(3, shape.volume)], [(2, tag) for tag in pieces])
    occ.synchronize()
    if [entity for entity in mapping[0] if entity[0] == 3] != [(3, shape.volume)]:
        raise MeshError(
            "imprinting the patches changed the solid; move patches that touch edges or each other slightly"
        )
    boundary = boundary_faces(shape.volume)
    children = {
        tag: [child for dim, child in parts if dim == 2]
        for tag, parts in zip(pieces, mapping[1:], strict=True)
    }
    # the kernel renumbers untouched faces and does not say how: find them by their place
    centers = np.array([occ.getCenterOfMass(2, tag) for tag in boundary])
    for tag, middle in middles.items():
        children[tag] = [boundary[int(np.argmin(np.linalg.norm(centers - middle, axis=1)))]]
    _check_areas(children, areas, boundary, shape.unit)
    return children


def _check_areas(
    children: dict[int, list[int]], areas: dict[int, float], boundary: list[int], unit: float
) -> None:
    """Refuse imprints that changed the area of a face.

    Args:
        unit: Length of the model's unit [m].
    """
    for tag, parts in children.items():
        area = total_area([child for child in parts if child in boundary])
        if abs(area - areas[tag]) > IMPRINT_TOLERANCE * areas[tag]:
            raise MeshError(
                f"a patch of {areas[tag] * unit**2:.6g} m^2 became {area * unit**2:.6g} m^2 when imprinted; move "
                "patches that touch edges or each other slightly"
            )
