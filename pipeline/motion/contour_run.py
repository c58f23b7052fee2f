"""A contour laid out in time, along its path as planned or as measured positions of axes or legs
move the tool; and the contour as run by any machine, with what is measured on it.
"""

import dataclasses
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray
from headstock.pipeline.answers.motion_forces import ProbeMotion
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
from headstock.solvers.motion.alpha import CompliantHistory, LinearMotion
from headstock.solvers.motion.set_points import PathMotion

CORIOLIS = "coriolis"
SETTLING = 0.3  # left out at both ends of each face [s]


@dataclass(frozen=True, eq=False)
class CachedFunction[Given: FloatArray | PathMotion, Found]:
    """Cache the values of a function of times or of a motion."""

    find: Callable[[Given], Found]
    _known: dict[bytes, Found] = field(default_factory=dict)

    def __call__(self, given: Given) -> Found:
        """Return the value, computed once."""
        arrays = dataclasses.astuple(given) if isinstance(given, PathMotion) else (given,)
        key = b"".join(values.tobytes() for values in arrays)
        if key not in self._known:
            self._known[key] = self.find(given)
        return self._known[key]


class CachedPath:
    """Cache the points of a path, since a contour is run again for its ±."""

    def __init__(self, path: ToolPath) -> None:
        """Wrap a path."""
        self.span = path.span
        self.at = CachedFunction(path.at)
        self.velocity = CachedFunction(path.velocity)


def plan_request(
    request: ContouringRequest,
    names: tuple[str, ...],
    find_tool: Callable[[FloatArray, PathPoints], FloatArray],
) -> tuple[ContourPlan, TraceFit | None]:
    """Lay the contour of a request out in time; its path as measured where there are traces.

    Args:
        find_tool: Returns the points ``(n, 3)`` of the tool at positions ``(n, k)`` of the named
            axes or legs, near those of the planned path.

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
    # with the samples beyond both ends, so that the spline covers the whole path
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


def request_times(request: ContouringRequest, plan: ContourPlan, until: float) -> FloatArray:
    """Return the steps ``(n,)`` of a contour up to a time: so many per tool revolution [s]."""
    step = 2.0 * math.pi / request.cut.spindle / request.steps_per_turn
    return np.asarray(np.arange(0.0, min(plan.path.span[1], until), step), dtype=float)


@dataclass(frozen=True, eq=False)
class ContourDrives:
    """Store forces and torques of the drives on a contour.

    Attributes:
        forces: Forces ``(k, d)`` at ``(k,)`` steps [N].
        torques: Torques of the motors ``(k, d)`` at ``(k,)`` steps with these forces [N m]; None
            where their screws are not known.
    """

    names: tuple[str, ...]
    forces: Callable[[NDArray[np.intp]], FloatArray]
    torques: Callable[[NDArray[np.intp], FloatArray], FloatArray] | None = None


@dataclass(frozen=True, eq=False)
class ContourRun:
    """Store the motion of a machine on a contour.

    Attributes:
        times: ``(n,)`` steps [s].
        gap: ``(n, 3)`` tool point of the compliant machine less that of the rigid one and less the
            deflection under gravity, machine frame [m].
        gravity_deflection: ``(n, 3)`` static deflection under gravity [m].
        force: ``(n, 3)`` on the tool, machine frame [N].
        plan: The contour, laid out in time.
        fit: Quality of the spline through measured positions; None for the computed path.
        highest_hz: Highest natural frequency along the trajectory.
        coriolis: Velocity terms are in the equations of motion.
        probes: Outputs of each probe, less those under gravity; none of a lumped mechanism.
    """

    times: FloatArray
    gap: FloatArray
    gravity_deflection: FloatArray
    force: FloatArray
    plan: ContourPlan
    fit: TraceFit | None
    motion: LinearMotion
    history: CompliantHistory
    drives: ContourDrives
    highest_hz: float
    coriolis: bool
    assumed: tuple[str, ...]
    probes: Mapping[str, ProbeMotion] = field(default_factory=dict, kw_only=True)


def face_instants(run: ContourRun, face: int) -> FloatArray:
    """Return the mask of the steps on a face, counted from zero, without its ends."""
    cut = run.plan.cuts[face]
    return np.asarray((run.times > cut.begins + SETTLING) & (run.times < cut.ends - SETTLING))


def high_share(run: ContourRun) -> float:
    """Return the share of the gap's root mean square above twice the highest natural frequency, in
    the direction where it is largest.
    """
    flat = run.gap - run.gap.mean(axis=0)
    power = np.abs(np.fft.rfft(flat, axis=0)) ** 2
    high = np.fft.rfftfreq(len(flat), run.times[1] - run.times[0]) > 2.0 * run.highest_hz
    total = np.maximum(power.sum(axis=0), np.finfo(float).tiny)
    return float(np.sqrt(power[high].sum(axis=0) / total).max())
