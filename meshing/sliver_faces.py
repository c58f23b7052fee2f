"""Faces of a CAD shape so narrow that no element fits them, found before a mesher hangs on them or leaves unusable elements."""

from collections.abc import Sequence
from dataclasses import dataclass

import gmsh
import numpy as np

from headstock.meshing.errors import MeshError

# an element on a narrower face would have a scaled Jacobian below the floor of the mesh checks
NARROWEST = 1e-3
NAMED_FACES = 5


@dataclass(frozen=True)
class Sliver:
    """A narrow face: what ``face:N`` calls it, and its width and length in the model's unit."""

    number: int
    width: float
    length: float


def find_slivers(faces: Sequence[int], size: float) -> list[Sliver]:
    """Faces of the open gmsh model that are narrower than a thousandth of the elements that must lie along them."""
    found = []
    for number, face in enumerate(faces, 1):
        curves = gmsh.model.getBoundary([(2, face)], combined=False, oriented=False)  # seams count on both sides
        perimeter = sum(float(gmsh.model.occ.getMass(1, abs(curve))) for _, curve in curves)
        box = np.array(gmsh.model.occ.getBoundingBox(2, face))
        length = float(np.linalg.norm(box[3:] - box[:3]))
        width = 2.0 * float(gmsh.model.occ.getMass(2, face)) / perimeter if perimeter > 0.0 else length
        if width < NARROWEST * min(size, length):
            found.append(Sliver(number, width, length))
    return found


def refuse_slivers(faces: Sequence[int], *, size: float, unit: float) -> None:
    """Refuse a shape with slivers.

    Raises:
        MeshError: Names the faces, their width and their length.
    """
    slivers = sorted(find_slivers(faces, size), key=lambda sliver: sliver.width)
    if not slivers:
        return
    named = ", ".join(
        f"face:{sliver.number} ({1e3 * sliver.width * unit:.4g} mm wide, {1e3 * sliver.length * unit:.4g} mm long)"
        for sliver in slivers[:NAMED_FACES]
    )
    raise MeshError(
        f"too narrow for elements of {1e3 * size * unit:.4g} mm, {len(slivers)} of {len(faces)} faces: {named}; remove them in the CAD"
        " system (gaps, overlaps and leftovers of chamfers show up so), or write a much smaller mesh size"
    )
