"""A contour on a lumped mechanism as a result: gap, leg forces and motor torques on each face,
stability of the cut, a thinned series.
"""

import math
from dataclasses import dataclass
from typing import NotRequired, TypedDict

from headstock.geometry.frames import FloatArray
from headstock.pipeline.answers.answer import Answer
from headstock.pipeline.storage.json_texts import check_finite

FACES = ("lowest x", "highest y", "highest x", "lowest y")
UM = 1e6


class FaceSummary(TypedDict):
    """The entry of a face; torques where the lead of the screws is known."""

    face: int
    at: str
    mean_um: list[float]
    peak_to_peak_um: list[float]
    leg_force_mean_n: list[float]
    leg_force_peak_to_peak_n: list[float]
    motor_torque_mean_nm: NotRequired[list[float]]
    motor_torque_peak_to_peak_nm: NotRequired[list[float]]


class StabilitySummary(TypedDict):
    """Stability of the cut on a face."""

    face: int
    at: str
    multiplier: float
    stable: bool
    limit_depth_mm: float


class RangeSummary(TypedDict):
    """Least and most on the way, along x, y, z."""

    minimum: list[float]
    maximum: list[float]


class SeriesSummary(TypedDict):
    """The contour over time, thinned out."""

    time_s: list[float]
    gap_um: list[list[float]]
    leg_force_n: list[list[float]]
    motor_torque_nm: NotRequired[list[list[float]]]


class ContourSummary(TypedDict):
    """The entry ``contouring``."""

    model: str
    material: str | None
    cutting_force: bool
    regeneration: bool
    coriolis: bool
    faces: list[FaceSummary]
    face_3_over_face_1: dict[str, float | None]
    gravity_deflection_um: RangeSummary
    force_mean_n: list[float]
    force_peak_n: list[float]
    share_above_twice_the_highest_mode: float
    face_times_s: list[float]
    assumptions: list[str]
    series: SeriesSummary
    stability: NotRequired[list[StabilitySummary]]
    force_share_faster_than_steps: NotRequired[float]


@dataclass(frozen=True, eq=False)
class ContourFace:
    """What was found along a face of the block.

    Attributes:
        number: 1 to 4.
        gap_mean: ``(3,)`` of the gap [m].
        gap_span: ``(3,)`` from peak to peak [m].
        leg_mean: ``(3,)`` forces of the legs [N].
        leg_span: ``(3,)`` from peak to peak [N].
    """

    number: int
    gap_mean: FloatArray
    gap_span: FloatArray
    leg_mean: FloatArray
    leg_span: FloatArray

    def summarise(self, screw_lead: float | None) -> FaceSummary:
        """As it stands in ``summary.json``, with torques where the lead of the screws is known [m].

        Raises:
            AccuracyError: A result is not a finite number.
        """
        what = f"contour on face {self.number}"
        summary: FaceSummary = {
            "face": self.number,
            "at": FACES[self.number - 1],
            "mean_um": check_finite(what, UM * self.gap_mean),
            "peak_to_peak_um": check_finite(what, UM * self.gap_span),
            "leg_force_mean_n": check_finite(what, self.leg_mean),
            "leg_force_peak_to_peak_n": check_finite(what, self.leg_span),
        }
        if screw_lead is not None:
            summary["motor_torque_mean_nm"] = check_finite(
                what, motor_torques(self.leg_mean, screw_lead)
            )
            summary["motor_torque_peak_to_peak_nm"] = check_finite(
                what, motor_torques(self.leg_span, screw_lead)
            )
        return summary


@dataclass(frozen=True)
class FaceStability:
    """Stability of the cut in the middle of a face.

    Attributes:
        number: 1 to 4.
        multiplier: Largest over a tooth period, at the depth of cut.
        limit_depth: Depth of cut at which chatter starts [m].
    """

    number: int
    multiplier: float
    limit_depth: float

    @property
    def stable(self) -> bool:
        """The cut does not chatter."""
        return self.multiplier < 1.0

    def summarise(self) -> StabilitySummary:
        """As it stands in ``summary.json``."""
        return {
            "face": self.number,
            "at": FACES[self.number - 1],
            "multiplier": self.multiplier,
            "stable": self.stable,
            "limit_depth_mm": 1e3 * self.limit_depth,
        }


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
        face_times: ``(5,)`` when the straight cuts start, and when the last one ends [s].
        assumed: In plain words.
        times: ``(k,)`` thinned [s].
        gap: ``(k, 3)`` then [m].
        legs: ``(k, 3)`` forces of the legs then [N].
        screw_lead: Of the legs [m]; None where it is not known.
        stability: Of each face, where it was requested.
        force_loss: Share of measured forces that is faster than the steps; None without them.
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
    legs: FloatArray
    screw_lead: float | None
    stability: tuple[FaceStability, ...] = ()
    force_loss: float | None = None

    def summarise(self) -> ContourSummary:
        """As it stands in ``summary.json``.

        Raises:
            AccuracyError: A result is not a finite number.
        """
        what = "contour"
        series: SeriesSummary = {
            "time_s": check_finite(what, self.times),
            "gap_um": [check_finite(what, row) for row in UM * self.gap],
            "leg_force_n": [check_finite(what, row) for row in self.legs],
        }
        if self.screw_lead is not None:
            series["motor_torque_nm"] = [
                check_finite(what, row) for row in motor_torques(self.legs, self.screw_lead)
            ]
        summary: ContourSummary = {
            "model": self.model,
            "material": self.material,
            "cutting_force": self.cutting,
            "regeneration": self.regeneration,
            "coriolis": self.coriolis,
            "faces": [face.summarise(self.screw_lead) for face in self.faces],
            "face_3_over_face_1": self._face_ratio(),
            "gravity_deflection_um": {
                "minimum": check_finite(what, UM * self.least_gravity_deflection),
                "maximum": check_finite(what, UM * self.most_gravity_deflection),
            },
            "force_mean_n": check_finite(what, self.force_mean),
            "force_peak_n": check_finite(what, self.force_peak),
            "share_above_twice_the_highest_mode": self.high_share,
            "face_times_s": check_finite(what, self.face_times),
            "assumptions": list(self.assumed),
            "series": series,
        }
        if self.stability:
            summary["stability"] = [face.summarise() for face in self.stability]
        if self.force_loss is not None:
            summary["force_share_faster_than_steps"] = self.force_loss
        return summary

    def _face_ratio(self) -> dict[str, float | None]:
        means = {face.number: float(face.gap_mean[0]) for face in self.faces}
        near, far = means.get(1), means.get(3)
        ratio = abs(far / near) if near and far else None
        return {"x as assumed": ratio, "x reversed": None if not ratio else 1.0 / ratio}


def motor_torques(forces: FloatArray, screw_lead: float) -> FloatArray:
    """Torques of the motors [N m] at the forces of their legs [N], with the lead of the screws
    [m].
    """
    return forces * (screw_lead / (2.0 * math.pi))
