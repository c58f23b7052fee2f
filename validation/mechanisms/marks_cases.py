"""What marks one face of the paper's block and not the other: waviness, roughness and marks face by
face, with one cause after the other on the lumped Tripteor.
"""

import dataclasses
from collections.abc import Iterator

import numpy as np

from headstock.pipeline.motion.contouring import face_stability
from headstock.pipeline.motion.lumped_contour import lumped_face_dynamics, run_lumped_contour
from headstock.pipeline.motion.milled_faces import mill_faces
from headstock.scene.analyses.contouring import ContouringRequest
from headstock.solvers.mechanisms.modes import PoseDamping
from headstock.solvers.milling.tool_dynamics import ToolMode
from headstock.solvers.milling.tool_path import PolylineContour, SquareContour
from headstock.solvers.mpi import MPI
from headstock.validation.mechanisms.contouring_cases import contour_request
from headstock.validation.mechanisms.tripteor_machine import load_tripteor
from headstock.validation.references.rows import ValidationRow, show

# assumed, equal in both directions across the tool
SPINDLE = ToolMode("spindle", 700.0, 0.03, 30e6, np.eye(3)[:, :2])
TOOL = ToolMode("tool", 1800.0, 0.02, 15e6, np.eye(3)[:, :2])
AT_CORNERS = "both from a corner"


def vary_contour() -> Iterator[tuple[str, ContouringRequest]]:
    """Return the paper's block, and what is changed of it: a name and a contour each."""
    straight = contour_request("al7075-t6")
    yield "straight into face 1", straight
    corners = dataclasses.replace(straight, contour=_enter_from_corners(straight))
    yield AT_CORNERS, corners
    dry = contour_request("al7075-t6-dry")
    yield "with axial force", dataclasses.replace(dry, contour=corners.contour)
    yield "1 % damping", dataclasses.replace(corners, damping=PoseDamping((0.01,)))
    mill = dataclasses.replace(corners.cut.mill, runout=5e-6)
    yield (
        "runout of 5 um",
        dataclasses.replace(corners, cut=dataclasses.replace(corners.cut, mill=mill)),
    )
    waves = dataclasses.replace(corners, regeneration=True)
    yield "regeneration", waves
    modes = (SPINDLE, TOOL)
    yield "spindle and tool", dataclasses.replace(corners, tool_modes=modes)
    yield "spindle, tool and regeneration", dataclasses.replace(waves, tool_modes=modes)


def _enter_from_corners(request: ContouringRequest) -> PolylineContour:
    """Return a line around the block that begins on its last face, so that each of the others is
    entered from a corner.

    Raises:
        ValueError: The contour is no block.
    """
    block = request.contour
    if not isinstance(block, SquareContour):
        raise ValueError("corners are those of a block")
    reach, (x, y) = 0.5 * block.side + block.offset, block.center
    corners = [
        (x + reach * side, y + reach * end) for side, end in ((1, -1), (-1, -1), (-1, 1), (1, 1))
    ]
    # the tool leaves the last face beyond its end
    corners.append((x + reach, y - reach - block.offset))
    return PolylineContour(
        points=tuple(corners),
        feeds=(block.feed,) * 4,
        radius=block.offset,
        height=block.height,
        offset=block.offset,
        lead=block.lead,
        window=block.window,
    )


def check_marks(comm: MPI.Comm) -> Iterator[ValidationRow]:
    """Waviness of each face, beside it roughness, marks where the tool comes out of a corner, and
    location error; and limits of stability of the faces at the lowest and the highest x.
    """
    tripteor = load_tripteor()
    for name, request in vary_contour():
        run = run_lumped_contour(tripteor.scene, tripteor.model, request)
        faces, _ = mill_faces(request, run)
        for face in faces:
            outward = run.plan.cuts[face.number - 1].outward
            side = f"{'lowest' if outward.sum() < 0.0 else 'highest'} {'xy'[int(np.abs(outward).argmax())]}"
            found = face.parameters
            note = f"Ra {1e6 * found.ra:.3f}, at its start {1e6 * face.marks[0]:.2f}, location {1e6 * found.location:.1f} um"
            yield show(f"{name}: Wt at the {side}", 1e6 * found.wt, "um", note)
            if request.regeneration and side.endswith("x"):
                tip = lumped_face_dynamics(tripteor.scene, tripteor.model, request, face.number - 1)
                limit = face_stability(tip, request, face.number - 1).limit_depth
                text = f"{name}: limit depth at the {side}"
                yield show(text, 1e3 * limit, "mm", "the cut is 10 mm deep")
