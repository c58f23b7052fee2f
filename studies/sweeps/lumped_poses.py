"""What a sweep computes in the poses of a lumped mechanism: many poses at once."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from headstock.geometry.errors import PoseError
from headstock.geometry.frames import FloatArray, Frame
from headstock.geometry.machine.machine import Point, Pose
from headstock.geometry.mechanisms.exechon import LEGS, solve_pose, survey_tool_poses, tool_pose
from headstock.pipeline.stages.lumped_machine import SPRING_PARTS, series_parts
from headstock.pipeline.stages.mechanism import build_lumped_model, place_pose, scene_mechanism
from headstock.pipeline.stages.run_state import MachineParts
from headstock.reduction.superelement import Superelement
from headstock.scene.analyses.frf import FrfRequest
from headstock.scene.analyses.lobes import LobesRequest
from headstock.scene.analyses.modal import ModalRequest
from headstock.scene.analyses.static import StaticRequest
from headstock.scene.scene import SceneMechanism
from headstock.solvers.mechanisms.dynamics import CompliantMechanism
from headstock.solvers.mechanisms.modes import (
    SmallMotions,
    linearise_poses,
    marker_motion,
    solve_lumped_modes,
)
from headstock.studies.sweeps.journals import PoseResult
from headstock.studies.sweeps.machine_poses import (
    POSE_ERRORS,
    add_limits,
    count_wanted,
    list_figures,
)

POSES_AT_ONCE = 64


@dataclass(frozen=True, eq=False)
class LumpedPoses:
    """What all poses of a lumped mechanism share.

    Attributes:
        own: Frame of each component on its mark.
    """

    parts: MachineParts
    mechanism: SceneMechanism
    model: CompliantMechanism
    superelements: Mapping[str, Superelement]
    own: Mapping[str, Frame]


def share_mechanism(parts: MachineParts, superelements: Mapping[str, Superelement]) -> LumpedPoses:
    """What all poses of the mechanism of a scene share."""
    own = {name: component.placement for name, component in parts.plan.components.items()}
    return LumpedPoses(
        parts, scene_mechanism(parts), build_lumped_model(parts, superelements), superelements, own
    )


def solve_lumped_poses(
    shared: LumpedPoses, poses: list[Pose], positions: FloatArray, feeds: FloatArray
) -> list[PoseResult]:
    """What the scene asks for in many poses.

    Args:
        shared: What all poses share.
        positions: The same as ``(n, k)``, for the results.
        feeds: ``(n, 3)`` direction of the feed; NaN where there is none.
    """
    tools = [tool_pose(shared.mechanism, pose.positions) for pose in poses]
    survey = survey_tool_poses(
        shared.mechanism.mounted, np.array([t[0] for t in tools]), np.array([t[1] for t in tools])
    )
    taken = survey.within & np.isfinite(survey.condition)
    solved = iter(
        _solve_taken(shared, survey.states[taken], positions[taken]) if taken.any() else []
    )
    results = []
    for number, pose in enumerate(poses):
        if not taken[number]:
            results.append(
                PoseResult(
                    positions[number],
                    "unreachable",
                    _why_not(shared.mechanism, pose),
                    feed=feeds[number],
                )
            )
            continue
        condition = np.array([survey.condition[number]])
        found = replace(next(solved), condition=condition, feed=feeds[number])
        analyses = shared.parts.scene.analyses
        if FrfRequest in analyses or LobesRequest in analyses:
            model = place_pose(shared.parts, pose, shared.model, shared.superelements)
            try:
                if FrfRequest in analyses:
                    found = replace(found, figures=list_figures(model))
                if LobesRequest in analyses:
                    found = add_limits(model, found)
            except POSE_ERRORS as error:
                found = replace(found, state="failed", error=f"frf or lobes analysis: {error}")
        results.append(found)
    return results


def _solve_taken(
    shared: LumpedPoses, states: FloatArray, positions: FloatArray
) -> list[PoseResult]:
    """Modes and compliances in poses that the mechanism can take, ``(n, s)`` states and ``(n, k)``
    positions.
    """
    analyses = shared.parts.scene.analyses
    motions = linearise_poses(shared.model, states)
    found = [PoseResult(place) for place in positions]
    if (modal := analyses.get(ModalRequest)) is not None:
        modes = solve_lumped_modes(motions)
        # amplitudes whose squares are the shares of the strain energy: orthonormal in every pose
        shapes = np.sqrt(modes.energy) * np.sign(modes.shapes)
        found = [
            replace(
                result,
                frequencies_hz=modes.frequencies_hz[number],
                wanted=count_wanted(modal, modes.frequencies_hz[number], 0),
                shapes=shapes[number].astype(np.float32),
            )
            for number, result in enumerate(found)
        ]
    if StaticRequest in analyses:
        turn = shared.mechanism.mounted.mounting.rotation
        rows = [
            turn @ _point_motion(shared, motions, shared.parts.scene.machine.points[name])
            for name in analyses[StaticRequest].at
        ]
        # (n, p, 3, c): motion of each point in machine axes per compliant coordinate
        moved = np.stack(rows, axis=1)
        stretches = np.swapaxes(
            np.linalg.solve(motions.total_stiffness[:, None], np.swapaxes(moved, -1, -2)), -1, -2
        )
        compliance = stretches @ np.swapaxes(moved, -1, -2)
        names, shares = _weakest_parts(
            shared, states, stretches**2 * motions.stiffness[:, None, None, :]
        )
        found = [
            replace(
                result,
                compliance=compliance[number],
                links=tuple(names[number]),
                link_shares=shares[number],
            )
            for number, result in enumerate(found)
        ]
    return found


def _point_motion(shared: LumpedPoses, motions: SmallMotions, point: Point) -> FloatArray:
    """``(n, 3, c)`` translation of the tool of a point per compliant coordinate, ground frame of
    the chains.
    """
    name, interface = point.tool.component or "", point.tool.interface or ""
    marker, own = shared.mechanism.carries[name], shared.own[name]
    tip = shared.superelements[name].interface_position(interface) + np.asarray(point.offset)
    local = own.origin + own.rotation @ tip
    place = shared.model.mechanism.markers.index(marker)
    arm = motions.kinematics.placement.rotations[:, place] @ local
    motion = marker_motion(shared.model, motions, marker)
    return np.asarray(
        motion[:, :3] + np.cross(motion[:, 3:], arm[:, :, None], axisa=1, axisb=1, axisc=1)
    )


def _weakest_parts(
    shared: LumpedPoses, states: FloatArray, energies: FloatArray
) -> tuple[list[list[str]], FloatArray]:
    """Part with most of the strain energy ``(n, p, 3, c)`` of each unit force: names and shares,
    ``3 p`` per pose.
    """
    springs, lengths = shared.mechanism.springs, shared.model.springs.length
    if springs is None:
        raise ValueError("a lumped mechanism needs springs")
    labels = [f"{leg}.{part}" for leg in LEGS for part in SPRING_PARTS]
    parts = np.zeros((*energies.shape[:3], len(labels)))
    for number in range(len(LEGS)):
        series = np.array(
            [series_parts(springs, float(state[lengths[2 * number]])) for state in states]
        )
        share = (series / series.sum(axis=1, keepdims=True))[:, None, None, :]
        first = len(SPRING_PARTS) * number
        parts[..., first : first + len(SPRING_PARTS)] = energies[..., 2 * number + 1, None] * share
        parts[..., first] += energies[..., 2 * number]
    parts = (parts / parts.sum(axis=-1, keepdims=True)).reshape(len(states), -1, len(labels))
    best = np.argmax(np.round(parts, 9), axis=-1)
    return [[labels[index] for index in row] for row in best], np.take_along_axis(
        parts, best[..., None], axis=-1
    )[..., 0]


def _why_not(mechanism: SceneMechanism, pose: Pose) -> str:
    try:
        solve_pose(mechanism, pose.positions)
    except PoseError as error:
        return str(error)
    return "a singular pose"
