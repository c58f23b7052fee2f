"""What a STEP file holds: its faces with their triangles, its size and the unit it was written
in.
"""

import dataclasses
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.cad_faces import CadFace, Vector
from headstock.geometry.parts.solids import StepFile
from headstock.meshing.component_mesh import IntArray
from headstock.meshing.errors import MeshError
from headstock.meshing.process.job import MeshJob
from headstock.meshing.process.running import run_job
from headstock.meshing.step_units import STEP_UNIT, read_length_unit

TIME_LIMIT = 120.0


@dataclass(frozen=True)
class NamedSet:
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
    sets: tuple[NamedSet, ...] = ()

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
