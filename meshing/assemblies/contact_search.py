"""Finds where the solids of an assembly touch, in a worker process."""

import json
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from headstock.geometry.assemblies.contacts import Contact
from headstock.geometry.assemblies.parts import Assembly
from headstock.meshing.errors import MeshError
from headstock.meshing.process.isolation import WorkerLimits
from headstock.meshing.process.strangers import run_apart

SEARCH = "headstock.meshing.assemblies.touching_faces:search_touching"
MEMORY_BYTES = 8 << 30
TIME_LIMIT = 600.0
WALL_FACTOR = 4.0
TOLERANCE, WIDE = 2e-4, 4e-3  # gap of solids that touch, and of a guide with air [m]


def find_contacts(
    assembly: Assembly,
    *,
    tolerance: float = TOLERANCE,
    wide: float = WIDE,
    progress: Callable[[str], None] | None = None,
) -> tuple[Contact, ...]:
    """Find the contacts of an assembly, in the order of its solids.

    Args:
        tolerance: Largest gap or overlap of solids that touch [m]; a screw may overlap its hole by
            more.
        wide: Largest gap of a guide, whose one side embraces the other [m].
        progress: Called with how many pairs of solids are done: ``12/60``.

    Raises:
        MeshError: The file is none, or the search took too long or too much memory.
    """
    parts: dict[int, dict[str, Any]] = {
        placement.solid: {
            "solid": part.placements[0].solid,
            "rotation": placement.rotation,
            "shift": placement.shift,
        }
        for part in assembly.parts
        for placement in part.placements
    }
    job = {
        "tolerance": tolerance,
        "wide": wide,
        "parts": [parts[solid.number] for solid in assembly.solids],
    }
    arrays = run_apart(
        [SEARCH],
        assembly.path,
        limits=WorkerLimits(MEMORY_BYTES, math.ceil(TIME_LIMIT), WALL_FACTOR * TIME_LIMIT),
        error=MeshError,
        content=json.dumps(job).encode(),
        progress=progress,
    )
    return tuple(map(_read_contact, json.loads(str(arrays["contacts"]))))


def _read_contact(fields: dict[str, Any]) -> Contact:
    outlines = tuple(np.array(outline) for outline in fields.pop("outlines"))
    return Contact(**{name: _freeze(value) for name, value in fields.items()}, outlines=outlines)


def _freeze(value: Any) -> Any:
    return tuple(map(_freeze, value)) if isinstance(value, list) else value
