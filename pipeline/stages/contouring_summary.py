"""What is told of a contour: gap, leg forces and motor torques on each face, stability of the cut, sag, and a thinned series."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray
from headstock.geometry.mechanisms.exechon_2 import LENGTHS
from headstock.pipeline.stages.contouring import ContourRun, face_instants, high_share
from headstock.pipeline.stages.contouring_stability import face_stability
from headstock.scene.requests import ContouringRequest
from headstock.scene.scene import SceneMechanism
from headstock.solvers.mechanisms.compliant_mechanism import CompliantMechanism
from headstock.solvers.milling.contouring import GiveHistory, drive_forces

SERIES_POINTS = 2000
FACE_POINTS = 8192  # of each face, in a row, for the forces of its legs
FACES = ("lowest x", "highest y", "highest x", "lowest y")
ASSUMED = (
    "faces 1 and 3 are those at the lowest and the highest x; which way x points is assumed, so the ratio is told for both",
    "the tool turns clockwise seen from above and leaves the block on its right: climb milling",
    "the static sag under gravity is subtracted from the gap",
)
TORQUE = "motor torques are the drives' forces times lead over 2 pi: no friction, no inertia of motor and screw"


def summarise_contour(
    mechanism: SceneMechanism, model: CompliantMechanism, request: ContouringRequest, run: ContourRun
) -> dict[str, Any]:
    """As it stands in ``summary.json``."""
    faces = [_face(mechanism, model, run, face) for face in range(len(FACES)) if face_instants(run, face).any()]
    on_tool = run.force @ mechanism.mounted.mounting.rotation.T
    found = {
        "model": request.model,
        "material": request.material,
        "cutting_force": request.cutting,
        "regeneration": request.regeneration,
        "coriolis": model.velocity_terms,
        "faces": faces,
        "face_3_over_face_1": _face_ratio(faces),
        "sag_um": {"least": (1e6 * np.abs(run.sag).min(axis=0)).tolist(), "most": (1e6 * np.abs(run.sag).max(axis=0)).tolist()},
        "force_mean_n": on_tool.mean(axis=0).tolist(),
        "force_peak_n": np.abs(on_tool).max(axis=0).tolist(),
        "share_above_twice_the_highest_mode": high_share(run),
        "marks_s": run.marks.tolist(),
        "assumed": [*ASSUMED, *([TORQUE] if mechanism.screw_lead else [])],
        "series": _series(mechanism, model, run),
    }
    if request.regeneration:
        found["stability"] = [
            {"face": face + 1, "at": FACES[face], **face_stability(mechanism, model, request, face)} for face in range(len(FACES))
        ]
    return found


def leg_forces(model: CompliantMechanism, run: ContourRun, some: NDArray[np.intp]) -> FloatArray:
    """``(k, 3)`` forces of the legs' drives at some steps [N] (eq. 14 with the work of springs that soften as a leg grows)."""
    history = run.history
    thin = GiveHistory(history.give[some], history.rate[some], history.acceleration[some])
    return drive_forces(model, run.drive, run.times[some], thin, run.force[some])[:, : len(LENGTHS)]


def motor_torques(mechanism: SceneMechanism, forces: FloatArray) -> FloatArray | None:
    """Torques of the motors at the forces of their legs [N m]; None where no lead of the screws is known."""
    return None if mechanism.screw_lead is None else np.asarray(forces * (mechanism.screw_lead / (2.0 * math.pi)))


def _face(mechanism: SceneMechanism, model: CompliantMechanism, run: ContourRun, face: int) -> dict[str, Any]:
    on = face_instants(run, face)
    gap = 1e6 * run.gap[on]
    places = np.flatnonzero(on)
    start = max(0, (len(places) - FACE_POINTS) // 2)
    legs = leg_forces(model, run, places[start : start + FACE_POINTS])
    found: dict[str, Any] = {
        "face": face + 1,
        "at": FACES[face],
        "mean_um": gap.mean(axis=0).tolist(),
        "peak_to_peak_um": np.ptp(gap, axis=0).tolist(),
        "leg_force_mean_n": legs.mean(axis=0).tolist(),
        "leg_force_peak_to_peak_n": np.ptp(legs, axis=0).tolist(),
    }
    torques = motor_torques(mechanism, legs)
    if torques is not None:
        found["motor_torque_mean_nm"] = torques.mean(axis=0).tolist()
        found["motor_torque_peak_to_peak_nm"] = np.ptp(torques, axis=0).tolist()
    return found


def _face_ratio(faces: list[dict[str, Any]]) -> dict[str, float | None]:
    near, far = (next((item["mean_um"][0] for item in faces if item["face"] == number), None) for number in (1, 3))
    ratio = abs(far / near) if near and far else None
    return {"x as assumed": ratio, "x reversed": None if not ratio else 1.0 / ratio}


def _series(mechanism: SceneMechanism, model: CompliantMechanism, run: ContourRun) -> dict[str, Any]:
    some = np.unique(np.linspace(0, len(run.times) - 1, min(SERIES_POINTS, len(run.times))).astype(np.intp))
    legs = leg_forces(model, run, some)
    found = {
        "time_s": run.times[some].tolist(),
        "gap_um": (1e6 * run.gap[some]).tolist(),
        "leg_force_n": legs.tolist(),
    }
    torques = motor_torques(mechanism, legs)
    return found if torques is None else {**found, "motor_torque_nm": torques.tolist()}
