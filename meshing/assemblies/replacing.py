"""A part's new file takes the place of its old one in an assembly."""

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from headstock.geometry.assemblies.equal_solids import Motion
from headstock.geometry.assemblies.replaced_parts import find_faces_again, find_old_position
from headstock.geometry.frames import axis_and_angle
from headstock.geometry.parts.solids import StepFile
from headstock.meshing.assemblies.survey import limit_reading
from headstock.meshing.components.survey import survey_step
from headstock.meshing.errors import PartFileError
from headstock.meshing.process.strangers import run_apart

MOVE = "headstock.meshing.assemblies.solids:move_solid"


def replace_part(old: StepFile, new: StepFile, target: Path) -> Mapping[int, tuple[int, ...]]:
    """Write the new file of a part as one whose solid is where the old one is.

    Args:
        new: In the coordinates of the old file or others.
        target: File that is written; one of this name is lost.

    Returns:
        For each face of the old solid by number those of the new file at its place; none where it is
        lost.

    Raises:
        MeshError: A file is none, or holds several solids of which none is chosen.
    """
    before = survey_step(old).faces
    motion = find_old_position(before, survey_step(new).faces)
    target.write_bytes(_move(new, motion))
    return find_faces_again(before, survey_step(StepFile(target)).faces)


def _move(solid: StepFile, motion: Motion) -> bytes:
    """Return the STEP file of a moved solid."""
    axis, angle = axis_and_angle(motion.rotation)
    job = {
        "solid": solid.solid,
        "axis": axis.tolist(),
        "angle": angle,
        "shift": motion.shift.tolist(),
    }
    limits = limit_reading(solid.path.stat().st_size)
    content = json.dumps(job).encode()
    arrays = run_apart([MOVE], solid.path, limits=limits, error=PartFileError, content=content)
    return np.asarray(arrays["step"], dtype=np.uint8).tobytes()
