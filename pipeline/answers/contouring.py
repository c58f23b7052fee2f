"""A contour as a result: gap, drive forces and motor torques on each face, stability of the cut, a
thinned series.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar

from headstock.geometry.frames import DIRECTIONS, FloatArray
from headstock.pipeline.answers.answer import Answer, Entry
from headstock.pipeline.answers.milled_faces import MILLED_KEYS, MilledFace
from headstock.pipeline.answers.motion_forces import (
    PROBE_KEYS,
    ProbeMotion,
    ProbeTrace,
    list_forces,
)
from headstock.pipeline.answers.probes import MEGA
from headstock.pipeline.numbers.estimates import Estimate, scale_total
from headstock.pipeline.numbers.numbers import Key, Number, Series, make_key
from headstock.pipeline.storage.json_texts import check_finite
from headstock.solvers.milling.tool_path import TraceFit
from headstock.solvers.stresses import STRESS_NAMES

UM = 1e6
LOCKED_MOTORS = "limits of stability on faces are those of the machine with locked motors"


FACE_KEYS = """
    outward_um outward_peak_to_peak_um mean_um[] peak_to_peak_um[] drive_force_mean_n[]
    drive_force_peak_to_peak_n[] motor_torque_mean_nm[] motor_torque_peak_to_peak_nm[]"""


@dataclass(frozen=True, eq=False)
class ContourFace:
    """What was found along a face of the block.

    Attributes:
        number: From 1 in the order of the path.
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

    def list_numbers(self, drives: Sequence[str]) -> Iterator[Number]:
        """Yield its numbers, without ±.

        Args:
            drives: Names of the ``d`` drives.
        """
        face = self.number
        yield Number(make_key("outward_gap", face=face, figure="mean"), self.outward, "m")
        yield Number(make_key("outward_gap", face=face, figure="span"), self.outward_span, "m")
        for figure, gap, forces, torques in (
            ("mean", self.gap_mean, self.drive_mean, self.torque_mean),
            ("span", self.gap_span, self.drive_span, self.torque_span),
        ):
            for direction, value in zip(DIRECTIONS, gap, strict=True):
                key = make_key("contour_gap", face=face, direction=direction, figure=figure)
                yield Number(key, float(value), "m")
            for kind, unit, values in (
                ("drive_force", "N", forces),
                ("drive_torque", "N m", torques),
            ):
                for drive, value in zip(
                    drives if values is not None else (),
                    () if values is None else values,
                    strict=True,
                ):
                    key = make_key(kind, face=face, drive=drive, figure=figure)
                    yield Number(key, float(value), unit)

    def summarise(self, drives: Sequence[str], errors: Mapping[Key, Estimate]) -> Entry:
        """Return it as it stands in ``summary.json``, with torques where they are known.

        Raises:
            AccuracyError: A result is not a finite number.
        """

        def find(kind: str, figure: str, role: str, names: Sequence[str]) -> list[float | None]:
            at: dict[str, str | int] = {"face": self.number, "figure": figure}
            keys = [make_key(kind, **at, **({role: name} if role else {})) for name in names]
            scale = UM if kind.endswith("gap") else 1.0
            return [scale_total(errors.get(key), scale) for key in keys]

        what = f"contour on face {self.number}"
        found: Entry = {
            "outward_um": find("outward_gap", "mean", "", [""])[0],
            "outward_peak_to_peak_um": find("outward_gap", "span", "", [""])[0],
            "mean_um": find("contour_gap", "mean", "direction", DIRECTIONS),
            "peak_to_peak_um": find("contour_gap", "span", "direction", DIRECTIONS),
            "drive_force_mean_n": find("drive_force", "mean", "drive", drives),
            "drive_force_peak_to_peak_n": find("drive_force", "span", "drive", drives),
        }
        if self.torque_mean is not None:
            found["motor_torque_mean_nm"] = find("drive_torque", "mean", "drive", drives)
            found["motor_torque_peak_to_peak_nm"] = find("drive_torque", "span", "drive", drives)
        summary: Entry = {
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


def _show_trace(trace: ProbeTrace) -> Entry:
    what = f"contour at probe {trace.name}"
    return {
        "displacement_um": [check_finite(what, row) for row in UM * trace.displacement],
        "von_mises_mpa": check_finite(what, MEGA * trace.von_mises),
        "stress_mpa": {
            pair: check_finite(what, MEGA * own)
            for pair, own in zip(STRESS_NAMES, trace.stress.T, strict=True)
        },
    }


@dataclass(frozen=True)
class FaceStability:
    """Stability of the cut in the middle of a face.

    Attributes:
        number: From 1 in the order of the path.
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

    def summarise(self, error: Estimate) -> Entry:
        """As it stands in ``summary.json``, with how far the limit may be off [m]."""
        return {
            "face": self.number,
            "at": self.at,
            "multiplier": self.multiplier,
            "stable": self.stable,
            "limit_depth_mm": 1e3 * self.limit_depth,
            "error_mm": scale_total(error, 1e3),
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
        least_gravity_deflection: ``(3,)`` under gravity, least on the way [m].
        most_gravity_deflection: ``(3,)`` under gravity, most on the way [m].
        force_mean: ``(3,)`` on the tool, machine frame [N].
        force_peak: ``(3,)`` largest magnitude on the tool [N].
        high_share: Share of the gap's root mean square above twice the highest natural frequency.
        face_times: ``(f + 1,)`` when the straight cuts start, and when the last one ends [s].
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
    sources: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()
    entry: ClassVar[str] = "contouring"
    keys: ClassVar[str] = f"""contouring(model material cutting_force regeneration coriolis drives[]
        faces[](face at times_s[] {FACE_KEYS} errors({FACE_KEYS})) face_3_over_face_1.*
        gravity_deflection_um.*[] force_mean_n[] force_peak_n[] share_above_twice_the_highest_mode
        face_times_s[] assumptions[] series(time_s[] gap_um[][] drive_force_n[][] motor_torque_nm[][]
        probes.*(displacement_um[][] von_mises_mpa[] stress_mpa.*[])) probes.*({PROBE_KEYS})
        stability[](face at multiplier stable limit_depth_mm error_mm) milled_faces[]({MILLED_KEYS})
        force_share_faster_than_steps traces.* error_sources[] error_left_out[])"""

    def list_numbers(self) -> Iterator[Number]:
        """Yield the numbers of faces, cuts, profiles and probes."""
        for figure, values in (
            ("least", self.least_gravity_deflection),
            ("most", self.most_gravity_deflection),
        ):
            for direction, value in zip(DIRECTIONS, values, strict=True):
                key = make_key("gravity_deflection", direction=direction, figure=figure)
                yield Number(key, float(value), "m")
        numbers = [number for face in self.faces for number in face.list_numbers(self.drives)]
        numbers += [
            number
            for face in self.stability
            for number in (
                Number(make_key("limit_depth", face=face.number), face.limit_depth, "m"),
                Number(make_key("multiplier", face=face.number), face.multiplier, "1"),
            )
        ]
        numbers += [
            Number(make_key("profile", face=face.number, figure=name), size, "m")
            for face in self.milled
            for name, size in face.sizes.items()
        ]
        for number in numbers:
            yield replace(number, error=self.errors.get(number.key))
        yield from list_forces({}, {}, self.probes)

    def list_series(self) -> Iterator[Series]:
        """Yield gap and drive forces over time, thinned."""
        axes = {"time [s]": self.times}
        for number, direction in enumerate(DIRECTIONS):
            yield Series(f"contour_gap(direction={direction})", axes, self.gap[:, number], "m")
        for number, drive in enumerate(self.drives):
            yield Series(f"drive_force(drive={drive})", axes, self.drive_forces[:, number], "N")

    def summarise(self) -> Entry:
        """As it stands in ``summary.json``.

        Raises:
            AccuracyError: A result is not a finite number.
        """
        what = "contour"
        series: Entry = {
            "time_s": check_finite(what, self.times),
            "gap_um": [check_finite(what, row) for row in UM * self.gap],
            "drive_force_n": [check_finite(what, row) for row in self.drive_forces],
            "probes": {name: _show_trace(probe.trace) for name, probe in self.probes.items()},
        }
        if self.torques is not None:
            series["motor_torque_nm"] = [check_finite(what, row) for row in self.torques]
        summary: Entry = {
            "model": self.model,
            "material": self.material,
            "cutting_force": self.cutting,
            "regeneration": self.regeneration,
            "coriolis": self.coriolis,
            "drives": list(self.drives),
            "faces": [face.summarise(self.drives, self.errors) for face in self.faces],
            "face_3_over_face_1": self.face_ratio,
            "gravity_deflection_um": {
                "minimum": check_finite(what, UM * self.least_gravity_deflection),
                "maximum": check_finite(what, UM * self.most_gravity_deflection),
            },
            "force_mean_n": check_finite(what, self.force_mean),
            "force_peak_n": check_finite(what, self.force_peak),
            "share_above_twice_the_highest_mode": self.high_share,
            "face_times_s": check_finite(what, self.face_times),
            "assumptions": self.assumptions,
            "series": series,
            "probes": {name: probe.summarise() for name, probe in self.probes.items()},
            "error_sources": list(self.sources),
            "error_left_out": list(self.left_out),
        }
        if self.stability:
            summary["stability"] = [
                face.summarise(self.error_of(make_key("limit_depth", face=face.number)))
                for face in self.stability
            ]
        if self.milled:
            summary["milled_faces"] = [face.summarise(self.errors) for face in self.milled]
        if self.fit is not None:
            summary["traces"] = {
                "residual_rms_um": UM * self.fit.residual,
                "off_path_um": UM * self.fit.off_path,
            }
        if self.force_loss is not None:
            summary["force_share_faster_than_steps"] = self.force_loss
        return summary

    @property
    def assumptions(self) -> list[str]:
        """Return what was assumed, in plain words."""
        return [*self.assumed, *([LOCKED_MOTORS] if self.stability else [])]

    @property
    def face_ratio(self) -> dict[str, float | None]:
        """Return the mean gap in x of face 3 over that of face 1, where these are opposite."""
        if not self.compares_faces:
            return {}
        means = {face.number: float(face.gap_mean[0]) for face in self.faces}
        near, far = means.get(1), means.get(3)
        ratio = abs(far / near) if near and far else None
        return {"x as assumed": ratio, "x reversed": None if not ratio else 1.0 / ratio}
