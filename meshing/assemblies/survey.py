"""What an assembly file holds: its solids, the parts they are copies of, and the tree of products."""

import math
import re
import tempfile
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from headstock.geometry.assemblies.equal_solids import SolidPoints, group_equal
from headstock.geometry.assemblies.parts import Assembly, Part, PlacedSolid, TreeNode
from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.cad_faces import Vector
from headstock.meshing.errors import MeshError
from headstock.meshing.length_units import STEP_UNIT, read_length_unit
from headstock.meshing.process.isolation import WorkerLimits
from headstock.meshing.process.strangers import FileKind, require_size
from headstock.meshing.process.worker import Arrays, call_apart, read_arrays

ASSEMBLY = FileKind("an assembly", 500_000_000, "export a part of it, or simpler parts")
MEASURE = "headstock.meshing.assemblies.solids:measure_solids"
MEMORY_BYTES = 8 << 30
TIME_LIMIT = 120.0
WALL_FACTOR = 4.0


def survey_assembly(path: Path, *, unit: str | None = None) -> Assembly:
    """List the solids and parts of a STEP file.

    Raises:
        MeshError: The file is missing, is no STEP file, holds no solid, or is too large.
    """
    require_size(path, ASSEMBLY, MeshError)
    data = _measure_apart(path)
    solids = _place_solids(data)
    points = _read_points(data)
    parts = []
    for group in group_equal(points):
        placements = tuple(motion.placement(index + 1) for index, motion in group)
        parts.append(Part(f"part_{len(parts) + 1}", placements))
    root = TreeNode(path.stem, "", tuple(solid.number for solid in solids))
    return Assembly(path, unit or read_length_unit(path), solids, tuple(parts), root)


def _measure_apart(path: Path) -> Arrays:
    limits = WorkerLimits(MEMORY_BYTES, math.ceil(TIME_LIMIT), WALL_FACTOR * TIME_LIMIT)
    with tempfile.TemporaryFile() as result:
        end = call_apart(
            [MEASURE],
            str(path.absolute()),
            limits=limits,
            readable=[path.absolute()],
            result=result,
        )
        if end.code:
            raise MeshError(end.last_line)
        return read_arrays(result)


def _place_solids(data: Arrays) -> tuple[PlacedSolid, ...]:
    solids = []
    for i, label in enumerate(data["labels"].tolist()):
        words = label.split("/")
        colour = _vector(data["colours"][i])
        solids.append(
            PlacedSolid(
                number=i + 1,
                names=tuple(words[1:]),
                product=words[-1],
                volume=float(data["volumes"][i]) * STEP_UNIT**3,
                area=float(data["areas"][i]) * STEP_UNIT**2,
                center=_vector(data["centers"][i] * STEP_UNIT),
                low=_vector(data["boxes"][i, :3] * STEP_UNIT),
                high=_vector(data["boxes"][i, 3:] * STEP_UNIT),
                colour=None if math.isnan(colour[0]) else colour,
            )
        )
    return tuple(solids)


def _read_points(data: Arrays) -> list[SolidPoints]:
    ends = np.cumsum(data["counts"])[:-1]
    names = ("points", "dimensions", "sizes")
    pieces = zip(*(np.split(data[name], ends) for name in names), strict=True)
    return [
        SolidPoints(
            volume * STEP_UNIT**3,
            center * STEP_UNIT,
            points * STEP_UNIT,
            dimensions,
            sizes * STEP_UNIT ** np.maximum(dimensions, 1),
        )
        for volume, center, (points, dimensions, sizes) in zip(
            data["volumes"].tolist(), data["centers"], pieces, strict=True
        )
    ]


def _vector(values: FloatArray) -> Vector:
    x, y, z = (float(value) for value in values)
    return x, y, z
