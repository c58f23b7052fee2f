"""A contour that has been run, by any machine, and what is measured on it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray
from headstock.pipeline.answers.motion_forces import ProbeMotion
from headstock.solvers.milling.tool_path import ContourPlan, TraceFit
from headstock.solvers.motion.alpha import CompliantHistory, LinearMotion

CORIOLIS = "coriolis"
SETTLING = 0.3  # left out at both ends of each face [s]


@dataclass(frozen=True, eq=False)
class ContourDrives:
    """What the drives do on a contour.

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
    """A contour that has been run.

    Attributes:
        times: ``(n,)`` steps [s].
        gap: ``(n, 3)`` tool point of the compliant machine less that of the rigid one and less the
            deflection under gravity, machine frame [m].
        gravity_deflection: ``(n, 3)`` static deflection under gravity [m].
        force: ``(n, 3)`` on the tool, machine frame [N].
        plan: The contour, laid out in time.
        fit: How a spline went through measured positions; None for the computed path.
        highest_hz: Highest natural frequency along the trajectory.
        coriolis: Velocity terms are in the equations of motion.
        probes: What each saw beside what it sees of the weight; none of a lumped mechanism.
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
    """Which steps lie on a face, counted from zero, its ends left out."""
    cut = run.plan.cuts[face]
    return np.asarray((run.times > cut.begins + SETTLING) & (run.times < cut.ends - SETTLING))


def high_share(run: ContourRun) -> float:
    """Share of the gap's root mean square above twice the highest natural frequency, in the
    direction where it is largest.
    """
    flat = run.gap - run.gap.mean(axis=0)
    power = np.abs(np.fft.rfft(flat, axis=0)) ** 2
    high = np.fft.rfftfreq(len(flat), run.times[1] - run.times[0]) > 2.0 * run.highest_hz
    total = np.maximum(power.sum(axis=0), np.finfo(float).tiny)
    return float(np.sqrt(power[high].sum(axis=0) / total).max())
