"""A contour as a result: gap, drive forces and motor torques on each face, stability of the cut, a
thinned series.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NotRequired, TypedDict

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.pipeline.answers.answer import Answer
from headstock.pipeline.answers.estimates import (
    CUTTING,
    DISCRETISATION,
    Estimate,
    combine_estimates,
)
from headstock.pipeline.answers.milled_faces import MilledFace, MilledFaceSummary
from headstock.pipeline.answers.probe_motions import (
    ProbeMotion,
    ProbeMotionSummary,
    ProbeTrace,
)
from headstock.pipeline.answers.probes import MEGA
from headstock.pipeline.storage.json_texts import check_finite
from headstock.solvers.milling.tool_path import TraceFit
from headstock.solvers.stresses import STRESS_NAMES

UM = 1e6
# what teeth and corners set swinging goes up and down as modes shift: changes of faces by a source of
# error times this cover the true errors of 95 numbers in 100 (`validate contour-estimates`)
COVERING = 2.0
LOCKED_MOTORS = "limits of stability on faces are those of the machine with locked motors"


class FaceErrors(TypedDict):
    """How far the numbers of a face may be off; null where nobody knows."""

    outward_um: float | None
    outward_peak_to_peak_um: float | None
    mean_um: list[float | None]
    peak_to_peak_um: list[float | None]
    drive_force_mean_n: list[float | None]
    drive_force_peak_to_peak_n: list[float | None]
    motor_torque_mean_nm: NotRequired[list[float | None]]
    motor_torque_peak_to_peak_nm: NotRequired[list[float | None]]


class FaceSummary(TypedDict):
    """The entry of a face; torques where they are known."""

    face: int
    at: str
    times_s: list[float]
    outward_um: float
    outward_peak_to_peak_um: float
    mean_um: list[float]
    peak_to_peak_um: list[float]
    drive_force_mean_n: list[float]
    drive_force_peak_to_peak_n: list[float]
    motor_torque_mean_nm: NotRequired[list[float]]
    motor_torque_peak_to_peak_nm: NotRequired[list[float]]
    errors: FaceErrors


class StabilitySummary(TypedDict):
    """Stability of the cut on a face."""

    face: int
    at: str
    multiplier: float
    stable: bool
    limit_depth_mm: float
    error_mm: float | None


class RangeSummary(TypedDict):
    """Least and most on the way, along x, y, z."""

    minimum: list[float]
    maximum: list[float]


class ProbeSeriesSummary(TypedDict):
    """What a probe saw, thinned out: stress by ``xx``, ``xy`` and so on."""

    displacement_um: list[list[float]]
    von_mises_mpa: list[float]
    stress_mpa: dict[str, list[float]]


class SeriesSummary(TypedDict):
    """The contour over time, thinned out."""

    time_s: list[float]
    gap_um: list[list[float]]
    drive_force_n: list[list[float]]
    motor_torque_nm: NotRequired[list[list[float]]]
    probes: dict[str, ProbeSeriesSummary]


class TraceSummary(TypedDict):
    """How measured positions were followed."""

    residual_rms_um: float
    off_path_um: float


class ContourSummary(TypedDict):
    """The entry ``contouring``."""

    model: str
    material: str | None
    cutting_force: bool
    regeneration: bool
    coriolis: bool
    drives: list[str]
    faces: list[FaceSummary]
    face_3_over_face_1: dict[str, float | None]
    gravity_deflection_um: RangeSummary
    force_mean_n: list[float]
    force_peak_n: list[float]
    share_above_twice_the_highest_mode: float
    face_times_s: list[float]
    assumptions: list[str]
    series: SeriesSummary
    probes: dict[str, ProbeMotionSummary]
    stability: NotRequired[list[StabilitySummary]]
    milled_faces: NotRequired[list[MilledFaceSummary]]
    force_share_faster_than_steps: NotRequired[float]
    traces: NotRequired[TraceSummary]
    error_sources: list[str]
    error_left_out: list[str]


@dataclass(frozen=True, eq=False)
class ContourFace:
    """What was found along a face of the block.

    Attributes:
        number: From 1 in the order of the path.
        at: Which face, in words.
        times: When the cut starts, and when the next one does or this one ends [s].
        outward: Mean of the gap away from the part [m].
        outward_span: From peak to peak [m].
        gap_mean: ``(3,)`` of the gap [m].
        gap_span: ``(3,)`` from peak to peak [m].
        drive_mean: ``(d,)`` forces of the drives [N].
        drive_span: ``(d,)`` from peak to peak [N].
        torque_mean: ``(d,)`` torques of the motors [N m]; None where they are not known.
        torque_span: ``(d,)`` from peak to peak [N m].
    """

    number: int
    at: str
    times: tuple[float, float]
    outward: float
    outward_span: float
    gap_mean: FloatArray
    gap_span: FloatArray
    drive_mean: FloatArray
    drive_span: FloatArray
    torque_mean: FloatArray | None = None
    torque_span: FloatArray | None = None

    @property
    def sizes(self) -> dict[str, FloatArray]:
        """Numbers that are judged, by their names."""
        known = {
            "outward": np.array([self.outward]),
            "outward_span": np.array([self.outward_span]),
            "gap_mean": self.gap_mean,
            "gap_span": self.gap_span,
            "drive_mean": self.drive_mean,
            "drive_span": self.drive_span,
        }
        if self.torque_mean is not None and self.torque_span is not None:
            known |= {"torque_mean": self.torque_mean, "torque_span": self.torque_span}
        return known

    def summarise(self, errors: Mapping[str, list[Estimate]]) -> FaceSummary:
        """As it stands in ``summary.json``, with torques where they are known.

        Args:
            errors: How far its sizes may be off.

        Raises:
            AccuracyError: A result is not a finite number.
        """
        what = f"contour on face {self.number}"
        off = {name: [error.total for error in own] for name, own in errors.items()}
        found: FaceErrors = {
            "outward_um": _scale(off["outward"])[0],
            "outward_peak_to_peak_um": _scale(off["outward_span"])[0],
            "mean_um": _scale(off["gap_mean"]),
            "peak_to_peak_um": _scale(off["gap_span"]),
            "drive_force_mean_n": off["drive_mean"],
            "drive_force_peak_to_peak_n": off["drive_span"],
        }
        if "torque_mean" in off:
            found["motor_torque_mean_nm"] = off["torque_mean"]
            found["motor_torque_peak_to_peak_nm"] = off["torque_span"]
        summary: FaceSummary = {
            "errors": found,
            "face": self.number,
            "at": self.at,
            "times_s": list(self.times),
            "outward_um": UM * self.outward,
            "outward_peak_to_peak_um": UM * self.outward_span,
            "mean_um": check_finite(what, UM * self.gap_mean),
            "peak_to_peak_um": check_finite(what, UM * self.gap_span),
            "drive_force_mean_n": check_finite(what, self.drive_mean),
            "drive_force_peak_to_peak_n": check_finite(what, self.drive_span),
        }
        if self.torque_mean is not None and self.torque_span is not None:
            summary["motor_torque_mean_nm"] = check_finite(what, self.torque_mean)
            summary["motor_torque_peak_to_peak_nm"] = check_finite(what, self.torque_span)
        return summary


def _show_trace(trace: ProbeTrace) -> ProbeSeriesSummary:
    what = f"contour at probe {trace.name}"
    return {
        "displacement_um": [check_finite(what, row) for row in UM * trace.displacement],
        "von_mises_mpa": check_finite(what, MEGA * trace.von_mises),
        "stress_mpa": {
            pair: check_finite(what, MEGA * own)
            for pair, own in zip(STRESS_NAMES, trace.stress.T, strict=True)
        },
    }


def _scale(errors: list[float | None]) -> list[float | None]:
    return [None if error is None else UM * error for error in errors]


@dataclass(frozen=True)
class FaceStability:
    """Stability of the cut in the middle of a face.

    Attributes:
        number: From 1 in the order of the path.
        at: Which face, in words.
        multiplier: Largest over a tooth period, at the depth of cut.
        limit_depth: Depth of cut at which chatter starts [m].
    """

    number: int
    at: str
    multiplier: float
    limit_depth: float

    @property
    def stable(self) -> bool:
        """The cut does not chatter."""
        return self.multiplier < 1.0

    def summarise(self, error: Estimate) -> StabilitySummary:
        """As it stands in ``summary.json``, with how far the limit may be off [m]."""
        return {
            "face": self.number,
            "at": self.at,
            "multiplier": self.multiplier,
            "stable": self.stable,
            "limit_depth_mm": 1e3 * self.limit_depth,
            "error_mm": None if error.total is None else 1e3 * error.total,
        }


@dataclass(frozen=True, eq=False)
class ContourWorth:
    """What a contour is worth: the same contour of machines without a source of error.

    Attributes:
        better: Source of error to the contour without it; cutting coefficients and the key of one, to
            the contour at an end of its range.
        unknown: Components with a mesh whose errors nothing shows.
        left_out: What is not looked at.
    """

    better: Mapping[tuple[str, str], "ContourAnswer"] = field(default_factory=dict)
    unknown: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()

    def judge(
        self,
        own: FloatArray,
        others: Mapping[tuple[str, str], FloatArray | None],
        covering: float = COVERING,
    ) -> list[Estimate]:
        """How far numbers ``(n,)`` may be off.

        Args:
            own: The numbers.
            others: Source of error to the same without it; None where it has none.
            covering: How often a change counts; one by a range once.
        """
        estimates = []
        for place, value in enumerate(own):
            parts = [
                Estimate(
                    {source: None if other is None else times * abs(float(other[place] - value))}
                )
                for (source, _), other in others.items()
                for times in [1.0 if source == CUTTING else covering]
            ]
            if self.unknown:
                parts.append(Estimate({DISCRETISATION: None}))
            estimates.append(combine_estimates([*parts, Estimate({}, self.left_out)]))
        return estimates

    def judge_face(self, face: ContourFace) -> dict[str, list[Estimate]]:
        """How far the sizes of a face may be off."""
        others = {
            owner: next((own for own in each.faces if own.number == face.number), None)
            for owner, each in self.better.items()
        }
        return {
            name: self.judge(
                size,
                {
                    owner: None if other is None else other.sizes.get(name)
                    for owner, other in others.items()
                },
            )
            for name, size in face.sizes.items()
        }

    def judge_profile(self, face: MilledFace) -> dict[str, Estimate]:
        """How far the parameters of a profile may be off."""
        others = {
            owner: next((own for own in each.milled if own.number == face.number), None)
            for owner, each in self.better.items()
        }
        return {
            name: self.judge(
                np.array([size]),
                {
                    owner: None if other is None else np.array([other.sizes[name]])
                    for owner, other in others.items()
                },
            )[0]
            for name, size in face.sizes.items()
        }

    def judge_limit(self, face: FaceStability) -> Estimate:
        """How far a limit of stability may be off."""
        others = {
            owner: next((own for own in each.stability if own.number == face.number), None)
            for owner, each in self.better.items()
        }
        return self.judge(
            np.array([face.limit_depth]),
            {
                owner: None if other is None else np.array([other.limit_depth])
                for owner, other in others.items()
            },
            covering=1.0,
        )[0]


@dataclass(frozen=True, eq=False)
class ContourAnswer(Answer):
    """A contour that was run.

    Attributes:
        model: ``linear`` or ``nonlinear``.
        material: That is cut; None with measured forces.
        cutting: Forces of the cut act.
        regeneration: Teeth meet the waves of those before them.
        coriolis: Velocity terms are in the equations of motion.
        faces: That were reached.
        least_gravity_deflection: ``(3,)`` under gravity, least on the way [m].
        most_gravity_deflection: ``(3,)`` under gravity, most on the way [m].
        force_mean: ``(3,)`` on the tool, machine frame [N].
        force_peak: ``(3,)`` largest magnitude on the tool [N].
        high_share: Share of the gap's root mean square above twice the highest natural frequency.
        face_times: ``(f + 1,)`` when the straight cuts start, and when the last one ends [s].
        assumed: In plain words.
        times: ``(k,)`` thinned [s].
        gap: ``(k, 3)`` then [m].
        drives: Names of the ``d`` drives.
        drive_forces: ``(k, d)`` then [N].
        torques: ``(k, d)`` of the motors then [N m]; None where they are not known.
        probes: What each saw beside what it sees of the weight; at these times, and at most.
        stability: Of each face, where it was requested.
        compares_faces: Faces 1 and 3 are opposite ones of a block.
        fit: How measured positions were followed; None for the computed path.
        milled: Profiles of the faces that were milled from end to end.
        force_loss: Share of measured forces that is faster than the steps; None without them.
        worth: How far the numbers may be off.
    """

    model: str
    material: str | None
    cutting: bool
    regeneration: bool
    coriolis: bool
    faces: tuple[ContourFace, ...]
    least_gravity_deflection: FloatArray
    most_gravity_deflection: FloatArray
    force_mean: FloatArray
    force_peak: FloatArray
    high_share: float
    face_times: FloatArray
    assumed: tuple[str, ...]
    times: FloatArray
    gap: FloatArray
    drives: tuple[str, ...]
    drive_forces: FloatArray
    torques: FloatArray | None
    probes: Mapping[str, ProbeMotion] = field(default_factory=dict)
    stability: tuple[FaceStability, ...] = ()
    milled: tuple[MilledFace, ...] = ()
    force_loss: float | None = None
    compares_faces: bool = True
    fit: TraceFit | None = None
    worth: ContourWorth = field(default_factory=ContourWorth)

    def summarise(self) -> ContourSummary:
        """As it stands in ``summary.json``.

        Raises:
            AccuracyError: A result is not a finite number.
        """
        what = "contour"
        series: SeriesSummary = {
            "time_s": check_finite(what, self.times),
            "gap_um": [check_finite(what, row) for row in UM * self.gap],
            "drive_force_n": [check_finite(what, row) for row in self.drive_forces],
            "probes": {name: _show_trace(probe.trace) for name, probe in self.probes.items()},
        }
        if self.torques is not None:
            series["motor_torque_nm"] = [check_finite(what, row) for row in self.torques]
        summary: ContourSummary = {
            "model": self.model,
            "material": self.material,
            "cutting_force": self.cutting,
            "regeneration": self.regeneration,
            "coriolis": self.coriolis,
            "drives": list(self.drives),
            "faces": [face.summarise(self.worth.judge_face(face)) for face in self.faces],
            "face_3_over_face_1": self._face_ratio(),
            "gravity_deflection_um": {
                "minimum": check_finite(what, UM * self.least_gravity_deflection),
                "maximum": check_finite(what, UM * self.most_gravity_deflection),
            },
            "force_mean_n": check_finite(what, self.force_mean),
            "force_peak_n": check_finite(what, self.force_peak),
            "share_above_twice_the_highest_mode": self.high_share,
            "face_times_s": check_finite(what, self.face_times),
            "assumptions": [*self.assumed, *([LOCKED_MOTORS] if self.stability else [])],
            "series": series,
            "probes": {name: probe.summarise() for name, probe in self.probes.items()},
            "error_sources": list(dict.fromkeys(source for source, _ in self.worth.better)),
            "error_left_out": list(self.worth.left_out),
        }
        if self.stability:
            summary["stability"] = [
                face.summarise(self.worth.judge_limit(face)) for face in self.stability
            ]
        if self.milled:
            summary["milled_faces"] = [
                face.summarise(self.worth.judge_profile(face)) for face in self.milled
            ]
        if self.fit is not None:
            summary["traces"] = {
                "residual_rms_um": UM * self.fit.residual,
                "off_path_um": UM * self.fit.off_path,
            }
        if self.force_loss is not None:
            summary["force_share_faster_than_steps"] = self.force_loss
        return summary

    def _face_ratio(self) -> dict[str, float | None]:
        if not self.compares_faces:
            return {}
        means = {face.number: float(face.gap_mean[0]) for face in self.faces}
        near, far = means.get(1), means.get(3)
        ratio = abs(far / near) if near and far else None
        return {"x as assumed": ratio, "x reversed": None if not ratio else 1.0 / ratio}
