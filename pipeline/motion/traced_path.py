"""The path of a contour: as planned, or as measured positions of axes or legs lead the tool; what was
asked of it once is not computed again.
"""

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.scene.analyses.contouring import ContouringRequest
from headstock.scene.reading.csv_files import CsvError, read_history
from headstock.solvers.milling.path_drives import smooth_samples
from headstock.solvers.milling.tool_path import (
    ContourPlan,
    PathPoints,
    ToolPath,
    TracedPath,
    TraceFit,
    plan_contour,
)


@dataclass(frozen=True, eq=False)
class Remembered[Found]:
    """A function of times that computes nothing twice."""

    find: Callable[[FloatArray], Found]
    _known: dict[bytes, Found] = field(default_factory=dict)

    def __call__(self, times: FloatArray) -> Found:
        """Its value at times ``(n,)``."""
        key = times.tobytes()
        if key not in self._known:
            self._known[key] = self.find(times)
        return self._known[key]


class RememberedPath:
    """A path of which nothing is computed twice: a contour is run again for its ±."""

    def __init__(self, path: ToolPath) -> None:
        """Of a path."""
        self.span = path.span
        self.at = Remembered(path.at)
        self.velocity = Remembered(path.velocity)


def plan_request(
    request: ContouringRequest,
    names: tuple[str, ...],
    find_tool: Callable[[FloatArray, PathPoints], FloatArray],
) -> tuple[ContourPlan, TraceFit | None]:
    """The contour of a request, laid out in time; its path as measured where there are traces.

    Args:
        find_tool: Points ``(n, 3)`` of the tool at positions ``(n, k)`` of these, near those of the
            planned path.

    Raises:
        CsvError: The traces cannot be read or do not cover the path.
        ModelError: There are too few samples between knots.
        PoseError: A mechanism cannot follow the path.
    """
    plan = plan_contour(request.contour)
    if request.traces is None:
        return plan, None
    measured, positions = read_history(request.traces, names)
    end = plan.path.span[1]
    if measured[0] > 0.0 or measured[-1] < end:
        raise CsvError(
            f"{request.traces}: positions were measured from {measured[0]:g} to {measured[-1]:g} s, and 0 to {end:.6g} s are needed"
        )
    within = (measured >= 0.0) & (measured <= end)
    # the samples next to both ends as well: the spline reaches over the path
    within[:-1] |= within[1:]
    within[1:] |= within[:-1]
    times = measured[within]
    planned = plan.path.at(times)
    places = find_tool(positions[within], planned)
    law = smooth_samples(times, places, request.traces_knots)
    residual = np.linalg.norm(places - law(times), axis=1)
    cutting = (times > plan.enters) & (times < plan.leaves)
    off = np.linalg.norm(law(times[cutting]) - planned.position[cutting], axis=1)
    return (
        dataclasses.replace(plan, path=TracedPath(law, (0.0, end))),
        TraceFit(float(np.sqrt((residual**2).mean())), float(off.max(initial=0.0))),
    )
