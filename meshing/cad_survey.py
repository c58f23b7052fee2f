"""What a STEP file holds: its faces with their triangles, its size and the unit it was written in."""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from headstock.geometry.cad_faces import CadFace, Vector
from headstock.geometry.frames import FloatArray
from headstock.geometry.solids import StepFile
from headstock.meshing.component_mesh import IntArray
from headstock.meshing.errors import MeshError
from headstock.meshing.mesh_job import MeshJob
from headstock.meshing.mesh_process import run_job

STEP_UNIT = 1e-3
TIME_LIMIT = 120.0
# one casting is seldom longer or shorter than that
PLAUSIBLE_LENGTHS = (1e-3, 3.0)
# an inch instead of a millimetre, and a metre instead of one, are what goes wrong
UNITS = (("inch", 0.0254), ("m", 1.0), ("mm", 1e-3), ("µm", 1e-6))


@dataclass(frozen=True, eq=False)
class CadSurvey:
    """The faces of one solid of a STEP file, in metres.

    Attributes:
        faces: In the order in which ``face:N`` counts them.
        points: ``(n, 3)`` [m].
        triangles: ``(m, 3)`` outward, indices into ``points``.
        owners: ``(m,)`` number of the face each triangle belongs to.
        unit: Length unit the file names, as far as it was understood.
    """

    faces: tuple[CadFace, ...]
    points: FloatArray
    triangles: IntArray
    owners: IntArray
    unit: str | None

    @property
    def size(self) -> Vector:
        """Sides of the bounding box [m]."""
        x, y, z = (max(face.high[i] for face in self.faces) - min(face.low[i] for face in self.faces) for i in range(3))
        return x, y, z


def survey_step(solid: StepFile, *, time_limit: float = TIME_LIMIT) -> CadSurvey:
    """List and triangulate the faces of a STEP file's solid in a child process.

    Raises:
        MeshError: The file is missing, is no STEP file, holds no solid or several of which none was chosen.
    """
    if not solid.path.is_file():
        raise MeshError(f"{solid.path} is no regular file" if solid.path.exists() else f"there is no file {solid.path}")
    job = MeshJob("faces", {"kind": "StepFile", "path": str(solid.path), "solid": solid.solid}, unit=STEP_UNIT)
    data = run_job(job, what=solid.path.name, time_limit=time_limit)
    faces = tuple(_read_face(fields) for fields in data.faces)
    groups = [data.facets[f"face:{face.number}"] for face in faces]
    owners = np.repeat([face.number for face in faces], [len(group) for group in groups])
    return CadSurvey(faces, data.points * STEP_UNIT, np.concatenate(groups), owners, read_length_unit(solid.path))


def read_length_unit(path: Path) -> str | None:
    """Length unit a STEP file names: ``mm``, ``m``, ``inch`` or another; None where there is none or several."""
    text = path.read_bytes()
    found = {name.decode().lower() for name in re.findall(rb"CONVERSION_BASED_UNIT\s*\(\s*'(INCH|FOOT)'", text, re.IGNORECASE)}
    if not found:  # a unit made from mm names mm too
        prefixes = set(re.findall(rb"SI_UNIT\s*\(\s*(?:\$|\.(\w+)\.)\s*,\s*\.METRE\.\s*\)", text))
        found = {{b"": "m", b"MILLI": "mm", b"CENTI": "cm"}.get(prefix, "other") for prefix in prefixes}
    return found.pop() if len(found) == 1 else None


def doubt_size(path: Path, extent: float) -> str | None:
    """A warning where a STEP part is so long or short [m] that its unit is in doubt; None where it is plausible."""
    lowest, highest = PLAUSIBLE_LENGTHS
    if lowest <= extent <= highest:
        return None
    unit = read_length_unit(path)
    length = dict(UNITS).get(unit or "")
    others = [] if length is None else [(name, extent * factor / length) for name, factor in UNITS if factor != length]
    fitting = [(name, value) for name, value in others if lowest <= value <= highest]
    if others and not fitting:
        fitting = [min(others, key=lambda other: abs(math.log(other[1] / highest)))]
    likely = ", ".join(f"{value:.4g} m if the numbers are in {name}" for name, value in fitting)
    return (
        f"{path.name} reads as {extent:.4g} m long, in the unit its header names ({unit or 'not understood'})"
        f"{'; it would be ' + likely if likely else ''}: this looks like a slip of units, check the export of the CAD system"
    )


def _read_face(fields: Mapping[str, Any]) -> CadFace:
    """A face in metres from the fields of one in millimetres."""
    values: dict[str, Any] = {name: tuple(value) if isinstance(value, list) else value for name, value in fields.items()}
    values["area"] *= STEP_UNIT**2
    values["radius"] *= STEP_UNIT
    for name in ("center", "low", "high", "axis_point", "span"):
        values[name] = tuple(value * STEP_UNIT for value in values[name])
    return CadFace(**values)
