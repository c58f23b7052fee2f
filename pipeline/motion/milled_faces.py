"""The faces that a contour leaves: the profile of each, from the motion of the tool."""

from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.pipeline.answers.milled_faces import MilledFace
from headstock.pipeline.motion.contour_run import SETTLING, ContourRun
from headstock.scene.analyses.contouring import ContouringRequest
from headstock.solvers.errors import ModelError
from headstock.solvers.milling.forces import MillingCut
from headstock.solvers.milling.milled_faces import (
    SAMPLES_PER_CUSP,
    ToolMotion,
    measure_profile,
    mill_profile,
    waviness_profile,
)
from headstock.solvers.milling.tool_path import StraightCut

MOST_SAMPLES = 400_000
MOST_LEFT_OUT = 0.2  # of a face, at either end; twice that where the tool enters or leaves
ENTRIES = 1.5  # radii of the tool over which it enters and settles
CELLS = 1000
LEAST_SAMPLES = 4  # of a profile within its cut-off
DETAIL = 2e-3  # length of the piece that is kept sample by sample [m]
BEYOND = 0.5  # share of the tool's radius that is evaluated beyond the ends of a face
DEPTH_SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)  # heights at which location errors are reported
SPARSE = 8  # sampling step of its mean
MARKS_APART = 1.5  # shortest wavelength of the profile, over the distance of tooth marks


def mill_faces(
    request: ContouringRequest, run: ContourRun
) -> tuple[tuple[MilledFace, ...], tuple[str, ...]]:
    """Return the profile of each face that was milled from end to end, and why others have none.

    Args:
        request: Tool, cut and cut-off.
    """
    faces, reasons = list[MilledFace](), list[str]()
    for number, cut in enumerate(run.plan.cuts, 1):
        if run.times[-1] < cut.begins + cut.length / cut.feed:
            reasons.append(f"face {number} has no profile: the tool did not reach its end")
            continue
        try:
            faces.append(_mill_face(request, run, number, cut))
        except ModelError as error:
            reasons.append(f"face {number} has no profile: {error}")
    return tuple(faces), tuple(reasons)


@dataclass(frozen=True, eq=False)
class _SampledFace:
    """Store the positions along a face at which its profile is found.

    Attributes:
        spacing: Between two of them [m].
        positions: ``(n,)`` [m].
    """

    spacing: float
    positions: FloatArray
    inside: slice


def _sample_face(
    request: ContouringRequest, run: ContourRun, cut: StraightCut, motion: ToolMotion
) -> _SampledFace:
    """Choose the positions along a face.

    Raises:
        ModelError: The cut-off is too short for them, or corners leave no part of the face.
    """
    beyond = 0.5 * BEYOND * min(request.cut.mill.diameter, cut.length)
    first = max(0.0, float(motion.along[0]) + beyond)
    last = min(cut.length, float(motion.along[-1]) - beyond)
    spacing = max(cut.feed * request.cut.tooth_period / SAMPLES_PER_CUSP, cut.length / MOST_SAMPLES)
    if request.cut_off < LEAST_SAMPLES * spacing:
        raise ModelError(
            f"the cut_off of {1e3 * request.cut_off:.3g} mm is shorter than {LEAST_SAMPLES} samples of it; write at least"
            f" {1e3 * LEAST_SAMPLES * spacing:.2g} mm in [analyses.contouring]"
        )
    positions: FloatArray = np.asarray(np.arange(first, last, spacing))
    before, after = _left_out(request, run, cut)
    start, stop = np.searchsorted(positions, [max(first, before), min(last, cut.length - after)])
    if stop <= start:
        raise ModelError(
            "nothing of it is left beside its corners, which averages round; write a shorter averaging in [analyses.contouring]"
        )
    return _SampledFace(spacing, positions, slice(int(start), int(stop)))


def _mill_face(
    request: ContouringRequest, run: ContourRun, number: int, cut: StraightCut
) -> MilledFace:
    milling, per_tooth = request.cut, cut.feed * request.cut.tooth_period
    motion = _tool_motion(request, run, cut)
    sampled = _sample_face(request, run, cut, motion)
    spacing, positions, inside = sampled.spacing, sampled.positions, sampled.inside
    height = 0.5 * milling.axial_depth

    def profile(where: FloatArray, height: float) -> FloatArray:
        return mill_profile(
            milling.mill, milling.spindle, motion, where, height, sense=milling.sense
        )

    middle = profile(positions, height)
    mean_line = waviness_profile(middle, spacing, request.cut_off)
    cells = np.linspace(0, len(positions), min(CELLS, len(positions)) + 1).astype(np.intp)[:-1]
    center = len(positions) // 2
    near = slice(center, center + round(min(DETAIL, 0.2 * cut.length) / spacing))
    parameters = measure_profile(
        middle, spacing, request.cut_off, inside, MARKS_APART * _mark_distance(milling, cut.feed)
    )
    off_mean = np.abs(mean_line - parameters.location)
    return MilledFace(
        number=number,
        at=cut.at,
        length=cut.length,
        evaluated=(float(positions[inside][0]), float(positions[inside][-1])),
        cut_off=request.cut_off,
        height=height,
        per_tooth=per_tooth,
        cusp=per_tooth**2 / (4.0 * milling.mill.diameter),
        parameters=parameters,
        # where the tool remains engaged up to a corner, nothing next to it is left out
        marks=(
            float(off_mean[: inside.start].max(initial=0.0)),
            float(off_mean[inside.stop :].max(initial=0.0)),
        ),
        by_height=tuple(
            (
                share * milling.axial_depth,
                float(profile(positions[inside][::SPARSE], share * milling.axial_depth).mean()),
            )
            for share in DEPTH_SHARES
        ),
        places=positions[cells],
        lowest=np.minimum.reduceat(middle, cells),
        highest=np.maximum.reduceat(middle, cells),
        waviness=mean_line[cells],
        detail_places=positions[near],
        detail=middle[near],
    )


def _left_out(request: ContouringRequest, run: ContourRun, cut: StraightCut) -> tuple[float, float]:
    """Return the lengths at the start and at the end of a face that are not evaluated: longer where
    the tool enters or leaves the part [m].
    """
    usual = min(SETTLING * cut.feed, MOST_LEFT_OUT * cut.length)
    entry = min(
        max(usual, ENTRIES * 0.5 * request.cut.mill.diameter), 2.0 * MOST_LEFT_OUT * cut.length
    )
    enters = cut.begins <= run.plan.enters < cut.begins + cut.length / cut.feed
    leaves = cut.begins < run.plan.leaves <= cut.begins + cut.length / cut.feed + run.plan.exit
    return entry if enters else usual, entry if leaves else usual


def _tool_motion(request: ContouringRequest, run: ContourRun, cut: StraightCut) -> ToolMotion:
    """Return the tool axis along a face and a little beyond: positions of the rigid machine, and
    the gap.

    Args:
        cut: The straight cut that generates the face.
    """
    beyond = BEYOND * 0.5 * request.cut.mill.diameter / cut.feed
    begins, ends = cut.begins - beyond, cut.begins + cut.length / cut.feed + beyond
    steps = np.searchsorted(run.times, [begins, ends])
    on = slice(int(steps[0]), int(steps[1]))
    moved = run.plan.path.at(run.times[on]).position + run.gap[on] - cut.start
    return ToolMotion(run.times[on], moved @ cut.travel, moved @ cut.outward)


def _mark_distance(cut: MillingCut, feed: float) -> float:
    """Return the distance after which tooth marks repeat: with runout a full revolution."""
    return feed * cut.tooth_period * (cut.mill.teeth if cut.mill.runout else 1)
