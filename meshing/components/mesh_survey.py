"""What a mesh file holds: its named sets, and the faces of its surface as `cad_survey` lists those of a
STEP file.
"""

import re
from typing import cast

import numpy as np

from headstock.geometry.parts.components import Patch
from headstock.geometry.parts.interface_suggestions import LikelyInterface
from headstock.geometry.parts.solids import MeshFile
from headstock.meshing.component_mesh import CellKind
from headstock.meshing.components.cad_survey import CadSurvey, NamedSet
from headstock.meshing.components.meshing import read_mesh_file
from headstock.meshing.components.skins import surface_triangles
from headstock.meshing.elements.quality import facet_moments
from headstock.meshing.elements.regions import describe_faces, split_surface
from headstock.meshing.elements.surface import extract_surface
from headstock.meshing.errors import MeshError
from headstock.meshing.files.patches import select_facets

MOST_SUGGESTED = 24
# a part in metres is seldom longer, one in millimetres seldom shorter
LONGEST_IN_METRES = 3.0


def survey_mesh(solid: MeshFile, unit: str | None = None) -> CadSurvey:
    """List the sets and the faces of a mesh file, in metres.

    Args:
        solid: The file; its unit counts where ``unit`` names it.
        unit: Its length unit in words; None to guess metres or millimetres from the size.

    Raises:
        MeshError: The file is missing or holds no usable mesh.
    """
    data = read_mesh_file(solid, solid.path.name)
    points = data.points
    if unit is None:
        unit, length = (
            ("mm", 1e-3) if np.ptp(points, axis=0).max() > LONGEST_IN_METRES else ("m", 1.0)
        )
        points = np.asarray(points * (length / solid.unit), dtype=float)
    surface = extract_surface(data.cells, cast(CellKind, data.kind))
    owners = split_surface(points, surface)
    areas, centers = facet_moments(points, surface.facets)
    sets = []
    for name in [*data.facets, *data.node_sets]:
        try:
            chosen = select_facets(data, surface, Patch(f"set:{name}"))
        except MeshError:
            continue  # it is not on the surface
        if len(chosen):
            x, y, z = (
                float(value) for value in areas[chosen] @ centers[chosen] / areas[chosen].sum()
            )
            sets.append(NamedSet(name, len(chosen), float(areas[chosen].sum()), (x, y, z)))
    triangles, sources = surface_triangles(surface)
    faces = tuple(describe_faces(points, surface, owners))
    return CadSurvey(faces, points, triangles, owners[sources], unit, tuple(sets))


def suggest_sets(survey: CadSurvey) -> list[LikelyInterface]:
    """Return the interfaces from the named sets of a file."""
    likely: dict[str, LikelyInterface] = {}
    for one in survey.sets[:MOST_SUGGESTED]:
        name = re.sub(r"\W+", "_", one.name, flags=re.ASCII).strip("_")
        if not name or name[0].isdigit():
            name = f"set_{name}"
        if name not in likely and '"' not in one.name and "\\" not in one.name:
            reason = f"set of {one.facets} facets, {one.area * 1e4:.4g} cm^2"
            likely[name] = LikelyInterface(name, (f"set:{one.name}",), reason, "set")
    return list(likely.values())
