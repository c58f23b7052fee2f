"""What following the poses of a path took, and what it is worth."""

from typing import Any

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.pipeline.answers.path import FollowedPoses
from headstock.scene.analyses.path import PathRequest
from headstock.solvers.paths.response import PathDeviation, filter_deviation
from headstock.solvers.paths.varying_response import StepTable
from headstock.solvers.paths.varying_system import VaryingSystem


def evaluate_poses(
    request: PathRequest,
    system: VaryingSystem[Any],
    table: StepTable,
    *,
    found: tuple[PathDeviation, ...],
    kept: tuple[PathDeviation, ...],
    short: PathDeviation,
    whole: PathDeviation,
) -> FollowedPoses:
    """What following the poses took, and what it is worth: that modes are kept only up to a
    frequency is judged in the middle, with some and with all.
    """

    def show(deviation: PathDeviation) -> FloatArray:
        return filter_deviation(deviation, request.low_pass).total

    full = show(whole)
    return FollowedPoses(
        sampled_poses=len(system.positions),
        error=system.error,
        rotation_error=system.rotation_error,
        modes=len(system.scales),
        next_hz=None if np.isinf(system.next_hz) else system.next_hz,
        steps=len(table.spline.x),
        truncation=float(
            np.abs(show(short) - full).max() / max(np.abs(full).max(), np.finfo(float).tiny)
        ),
        effect=tuple(
            float(np.abs(show(ours) - show(theirs)).max())
            for ours, theirs in zip(found, kept, strict=True)
        ),
    )
