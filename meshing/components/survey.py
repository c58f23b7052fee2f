"""What a file of a part holds: the faces of its surface with their triangles, its size, and the unit of
a STEP file or the named sets of a mesh file.
"""

import dataclasses
import re
from dataclasses import dataclass
from typing import cast

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.cad_faces import CadFace, Vector
from headstock.geometry.parts.components import Patch
from headstock.geometry.parts.interface_suggestions import LikelyInterface
from headstock.geometry.parts.solids import MeshFile, StepFile
from headstock.meshing.component_mesh import CellKind, IntArray
from headstock.meshing.components.meshing import read_mesh_file
from headstock.meshing.elements.quality import facet_moments
from headstock.meshing.elements.regions import describe_faces, split_surface
from headstock.meshing.elements.surface import extract_surface, surface_triangles
from headstock.meshing.errors import MeshError
from headstock.meshing.files.patches import select_facets
from headstock.meshing.length_units import STEP_UNIT, read_length_unit
from headstock.meshing.process.job import MeshJob
from headstock.meshing.process.running import run_job

TIME_LIMIT = 120.0
MOST_SUGGESTED = 24
# a part in metres is seldom longer, one in millimetres seldom shorter
LONGEST_IN_METRES = 3.0


@dataclass(frozen=True)
class _NamedSet:
    """A set of a mesh file, where it lies on the surface.

    Attributes:
        area: [m^2].
        center: Centroid [m].
    """

    name: str
    facets: int
    area: float
    center: Vector


@dataclass(frozen=True, eq=False)
class CadSurvey:
    """The faces of one solid of a STEP file, or of a mesh file, in metres.

    Attributes:
        faces: In the order in which ``face:N`` counts them.
        points: ``(n, 3)`` [m].
        triangles: ``(m, 3)`` outward, indices into ``points``.
        owners: ``(m,)`` number of the face each triangle belongs to.
        unit: Length unit the file names, as far as it was understood.
        sets: Named sets of a mesh file.
    """

    faces: tuple[CadFace, ...]
    points: FloatArray
    triangles: IntArray
    owners: IntArray
    unit: str | None
    sets: tuple[_NamedSet, ...] = ()

    @property
    def size(self) -> Vector:
        """Sides of the bounding box [m]."""
        x, y, z = (
            max(face.high[i] for face in self.faces) - min(face.low[i] for face in self.faces)
            for i in range(3)
        )
        return x, y, z


def survey_step(solid: StepFile) -> CadSurvey:
    """List and triangulate the faces of a STEP file's solid in a worker process.

    Raises:
        MeshError: The file is missing, is no STEP file, holds no solid or several of which none was
            chosen.
    """
    if not solid.path.is_file():
        raise MeshError(
            f"{solid.path} is no regular file"
            if solid.path.exists()
            else f"there is no file {solid.path}"
        )
    job = MeshJob("faces", solid, unit=STEP_UNIT)
    data = run_job(job, what=solid.path.name, time_limit=TIME_LIMIT)
    faces = tuple(_in_metres(face) for face in data.faces)
    groups = [data.facets[f"face:{face.number}"] for face in faces]
    owners = np.repeat([face.number for face in faces], [len(group) for group in groups])
    return CadSurvey(
        faces, data.points * STEP_UNIT, np.concatenate(groups), owners, read_length_unit(solid.path)
    )


def _in_metres(face: CadFace) -> CadFace:
    """Return a face in metres from one in millimetres."""

    def scale(place: Vector) -> Vector:
        return place[0] * STEP_UNIT, place[1] * STEP_UNIT, place[2] * STEP_UNIT

    return dataclasses.replace(
        face,
        area=face.area * STEP_UNIT**2,
        radius=face.radius * STEP_UNIT,
        center=scale(face.center),
        low=scale(face.low),
        high=scale(face.high),
        axis_point=scale(face.axis_point),
        span=(face.span[0] * STEP_UNIT, face.span[1] * STEP_UNIT),
    )


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
            sets.append(_NamedSet(name, len(chosen), float(areas[chosen].sum()), (x, y, z)))
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
