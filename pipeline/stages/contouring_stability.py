"""Stability of the cut on each face of a contour: the largest multiplier there, and the depth of cut at which chatter starts."""

import dataclasses
from typing import Any

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.mechanisms.exechon import solve_tool_pose
from headstock.pipeline.stages.contouring import travel_frames
from headstock.scene.requests import ContouringRequest
from headstock.scene.scene import SceneMechanism
from headstock.solvers.mechanisms.compliant_mechanism import CompliantMechanism
from headstock.solvers.mechanisms.modes import linearise_poses, mark_motion, modal_damping, solve_pose_modes
from headstock.solvers.milling.stability import (
    TipDynamics,
    count_steps,
    largest_multiplier,
    limit_depth,
    milling_gains,
    tip_dynamics,
)

DEEPEST = 0.2  # depth of cut up to which a limit is looked for [m]
# outward normal of each face and the way the tool goes along it
NORMALS = ((-1.0, 0.0), (0.0, 1.0), (1.0, 0.0), (0.0, -1.0))
TRAVELS = ((0.0, 1.0), (1.0, 0.0), (0.0, -1.0), (-1.0, 0.0))


def face_stability(mechanism: SceneMechanism, model: CompliantMechanism, request: ContouringRequest, face: int) -> dict[str, Any]:
    """In the middle of a face (0 to 3): multiplier over a tooth period at the depth of cut, and the limit depth."""
    tip = face_dynamics(mechanism, model, request, face)
    multiplier = cut_multiplier(tip, request, request.cut.axial_depth)
    limit = limit_depth(lambda depth: cut_multiplier(tip, request, depth), DEEPEST)
    return {"multiplier": multiplier, "stable": multiplier < 1.0, "limit_depth_mm": 1e3 * limit}


def cut_multiplier(tip: TipDynamics, request: ContouringRequest, depth: float, spindle: float | None = None) -> float:
    """Largest multiplier over a tooth period at a depth of cut [m] and a speed of the spindle [rad/s]."""
    cut = dataclasses.replace(request.cut, axial_depth=depth, spindle=spindle or request.cut.spindle)
    return largest_multiplier(tip, milling_gains(cut, count_steps(tip, cut.tooth_period)), cut.tooth_period)


def face_dynamics(mechanism: SceneMechanism, model: CompliantMechanism, request: ContouringRequest, face: int) -> TipDynamics:
    """The mechanism with its tool in the middle of a face, forces along, away and up, chips by motions along and away."""
    contour = request.contour
    reach = 0.5 * contour.side + contour.offset
    x, y = (center + reach * normal for center, normal in zip(contour.center, NORMALS[face], strict=True))
    state = solve_tool_pose(mechanism.mounted, np.array([x, y, contour.height]), mechanism.tool)
    motions = linearise_poses(model, state)
    damping = modal_damping(motions, solve_pose_modes(motions), np.array(request.damping_ratios or (0.0,)))
    frame: FloatArray = travel_frames(np.array([[*TRAVELS[face], 0.0]]))[0] @ mechanism.mounted.mounting.rotation
    tip = frame @ mark_motion(model, motions, model.tool)[:3]
    return tip_dynamics((motions.mass, damping, np.diag(motions.stiffness)), tip, tip[:2])
