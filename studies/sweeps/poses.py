"""Results of a sweep in its poses: of a machine of superelements one by one, of a lumped mechanism many
at once.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from headstock.geometry.errors import HeadstockError, PoseError
from headstock.geometry.frames import DIRECTIONS, FloatArray, Frame
from headstock.geometry.machine.machine import Point, Pose
from headstock.geometry.machine.tool_travel import NO_FEED
from headstock.geometry.mechanisms.exechon import LEGS, solve_pose, survey_tool_poses, tool_pose
from headstock.pipeline.answers.lobes import HZ
from headstock.pipeline.answers.map import describe_state
from headstock.pipeline.lobes.cutting_point import lobes_request
from headstock.pipeline.lobes.lobes import solve_lobes
from headstock.pipeline.stages.frf import respond
from headstock.pipeline.stages.lumped_machine import SPRING_PARTS, series_parts
from headstock.pipeline.stages.machine import CoupledPose
from headstock.pipeline.stages.mechanism import build_lumped_model, place_pose, scene_mechanism
from headstock.pipeline.stages.run_state import MachineParts, PoseModel
from headstock.reduction.coupling.coupling import couple
from headstock.reduction.coupling.dof_layout import turn_dofs
from headstock.reduction.coupling.elimination import CouplingMemo
from headstock.reduction.motions.compliance_budget import point_budget
from headstock.reduction.motions.part_names import join_names, split_number
from headstock.reduction.superelement import Superelement
from headstock.scene.analyses.frf import FrfRequest
from headstock.scene.analyses.lobes import LobesRequest
from headstock.scene.analyses.modal import ModalRequest
from headstock.scene.analyses.static import StaticRequest
from headstock.scene.scene import LOAD, SceneMechanism
from headstock.solvers.linear.modal_analysis import keep_lowest, solve_lowest_modes
from headstock.solvers.mechanisms.dynamics import CompliantMechanism
from headstock.solvers.mechanisms.modes import (
    SmallMotions,
    linearise_poses,
    marker_motion,
    solve_lumped_modes,
)
from headstock.studies.sweeps.journals import FIGURES, PoseResult

# modes beyond those asked for, so that one that leaves the range in a neighbouring pose can be
# followed
EXTRA_SHARE, EXTRA_LEAST, EXTRA_REACH = 0.25, 3, 1.15
RESOLVED = 1e-5  # relative error of the highest eigenvalue, far beyond what is asked for
POSES_AT_ONCE = 64  # of a lumped mechanism
# an error in one pose is that pose's result
POSE_ERRORS = (HeadstockError, ValueError, np.linalg.LinAlgError)


@dataclass(frozen=True, eq=False)
class _MachinePoses:
    """What all poses of a machine share.

    Attributes:
        memo: What their couplings share.
    """

    parts: MachineParts
    superelements: Mapping[str, Superelement]
    memo: CouplingMemo


def share_machine(parts: MachineParts, superelements: Mapping[str, Superelement]) -> _MachinePoses:
    """Prepare what all poses of the machine of a scene share."""
    static, frf = parts.scene.analyses.get(StaticRequest), parts.scene.analyses.get(FrfRequest)
    lobes = parts.scene.analyses.get(LobesRequest)
    channels = {
        *(() if lobes is None else (lobes.at,)),
        *(() if static is None else static.at),
        *(name for name, dof in (() if frf is None else frf.inputs + frf.outputs) if dof != LOAD),
    }
    return _MachinePoses(parts, superelements, CouplingMemo(channels))


def solve_machine_pose(
    shared: _MachinePoses, pose: Pose, positions: FloatArray, feed: FloatArray = NO_FEED
) -> PoseResult:
    """Couple in a pose and compute what the scene asks for; what cannot be computed is said in the
    result.

    Args:
        shared: What all poses share.
        positions: The same as ``(k,)``, for the result.
        feed: ``(3,)`` direction of the feed; NaN where there is none.
    """
    result = PoseResult(positions, feed=feed)
    try:
        coupled = couple(shared.superelements, shared.parts.scene.machine, pose, memo=shared.memo)
    except PoseError as error:
        return replace(result, state="unreachable", error=str(error))
    except POSE_ERRORS as error:
        return replace(result, state="failed", error=f"coupling: {error}")
    result = replace(result, condition=_find_condition(shared, pose))
    errors: list[str] = []
    model = CoupledPose(shared.parts, pose, coupled, RESOLVED)
    analyses = shared.parts.scene.analyses
    for name, add in (
        ("static", _add_points),
        ("modal", _add_modes),
        ("frf", _add_figures),
        ("lobes", _add_limits),
    ):
        try:
            result = add(model, result) if name in analyses.names else result
        except POSE_ERRORS as error:
            errors.append(f"{name} analysis: {error}")
    return replace(result, state="failed" if errors else "done", error="; ".join(errors))


def _find_condition(shared: _MachinePoses, pose: Pose) -> FloatArray:
    mechanism = shared.parts.scene.mechanism
    if mechanism is None:
        return np.zeros(0)
    return np.array(
        [
            describe_state(
                mechanism, pose.name, solve_pose(mechanism, pose.positions)
            ).condition_number
        ]
    )


def _add_points(model: CoupledPose, found: PoseResult) -> PoseResult:
    at = model.parts.scene.analyses[StaticRequest].at
    budgets = [point_budget(model.coupled, name) for name in at]
    links = [
        _largest_family(budget.shares[direction]) for budget in budgets for direction in DIRECTIONS
    ]
    return replace(
        found,
        compliance=np.array([budget.compliance[:3, :3] for budget in budgets]),
        links=tuple(name for name, _ in links),
        link_shares=np.array([share for _, share in links]),
    )


def _largest_family(shares: Mapping[str, float]) -> tuple[str, float]:
    """The part with most of a compliance, carriages of one guide and the like taken together; empty
    where nothing gives way.
    """
    families: dict[str, list[str]] = {}
    for name in sorted(shares):
        families.setdefault(split_number(name)[0], []).append(name)
    if not families:
        return "", 0.0
    totals = {stem: sum(shares[name] for name in members) for stem, members in families.items()}
    stem = min(totals, key=lambda stem: (-round(totals[stem], 9), stem))
    return join_names(families[stem]), totals[stem]


def _add_modes(model: CoupledPose, found: PoseResult) -> PoseResult:
    analyses, coupled = model.parts.scene.analyses, model.coupled
    request = analyses[ModalRequest]
    # enough beyond those asked for that they can be followed
    spare = max(EXTRA_LEAST, round(EXTRA_SHARE * (request.count or 0)))
    count = None if request.count is None else request.count + spare
    limit = None if request.up_to_hz is None else EXTRA_REACH * request.up_to_hz
    modal = (
        solve_lowest_modes(coupled.system, count=count, up_to_hz=limit)
        if FrfRequest not in analyses and LobesRequest not in analyses
        else keep_lowest(model.all_modes, count=count, up_to_hz=limit)
    )
    stacked = coupled.basis @ modal.shapes
    for name, rows in coupled.offsets.items():
        part = coupled.layout.superelements[name]
        stacked[rows] = turn_dofs(part, coupled.placements[name]) @ stacked[rows]
    return replace(
        found,
        frequencies_hz=modal.frequencies_hz,
        wanted=request.count_wanted(modal.frequencies_hz, modal.rigid_count),
        rigid_count=min(modal.rigid_count, len(modal.frequencies_hz)),
        shapes=stacked.astype(np.float32),
    )


def _add_figures(model: PoseModel, found: PoseResult) -> PoseResult:
    """Add what the frequency response in a pose says about cutting, ``(ports, f)`` as ``FIGURES``
    names it, NaN where it says nothing.
    """
    channels = respond(model, with_errors=False).answer.figures
    rows = [[getattr(channel, name) for name in FIGURES] for channel in channels]
    return replace(found, figures=np.array(rows, dtype=float))


def _add_limits(model: PoseModel, found: PoseResult) -> PoseResult:
    """Add the limit depths of cut in a pose.

    Args:
        found: The result so far, with the direction of the feed.
    """
    request, solved = lobes_request(model), solve_lobes(model, found.feed, whole=False).answer
    by_name = {lobes.name: lobes for lobes in solved.directions}
    unknown = np.full(len(request.speeds), np.nan)
    limits, chatter, modes = [], [], []
    for travel in request.directions:
        lobes = by_name.get(travel.name)
        lowest = None if lobes is None else lobes.lowest
        limits.append(unknown if lobes is None else lobes.depths)
        chatter.append(
            np.nan if lobes is None or lowest is None else HZ * lobes.chatter[lowest.place]
        )
        modes.append("" if lowest is None else lowest.mode)
    return replace(
        found,
        limits=np.array(limits),
        chatter_hz=np.array(chatter),
        chatter_modes=tuple(modes),
        limits_confirmed=solved.confirmed,
    )


@dataclass(frozen=True, eq=False)
class _LumpedPoses:
    """What all poses of a lumped mechanism share.

    Attributes:
        own: Frame of each component on its mark.
    """

    parts: MachineParts
    mechanism: SceneMechanism
    model: CompliantMechanism
    superelements: Mapping[str, Superelement]
    own: Mapping[str, Frame]


def share_mechanism(parts: MachineParts, superelements: Mapping[str, Superelement]) -> _LumpedPoses:
    """Prepare what all poses of the mechanism of a scene share."""
    frames = {name: component.placement for name, component in parts.plan.components.items()}
    return _LumpedPoses(
        parts,
        scene_mechanism(parts),
        build_lumped_model(parts, superelements),
        superelements,
        frames,
    )


def solve_lumped_poses(
    shared: _LumpedPoses, poses: list[Pose], positions: FloatArray, feeds: FloatArray
) -> list[PoseResult]:
    """Compute what the scene asks for in many poses.

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
        result = replace(next(solved), condition=condition, feed=feeds[number])
        analyses = shared.parts.scene.analyses
        if FrfRequest in analyses or LobesRequest in analyses:
            model = place_pose(shared.parts, pose, shared.model, shared.superelements)
            try:
                if FrfRequest in analyses:
                    result = _add_figures(model, result)
                if LobesRequest in analyses:
                    result = _add_limits(model, result)
            except POSE_ERRORS as error:
                result = replace(result, state="failed", error=f"frf or lobes analysis: {error}")
        results.append(result)
    return results


def _solve_taken(
    shared: _LumpedPoses, states: FloatArray, positions: FloatArray
) -> list[PoseResult]:
    """Modes and compliances in poses that the mechanism can take, ``(n, s)`` states and ``(n, k)``
    positions.
    """
    analyses = shared.parts.scene.analyses
    motions = linearise_poses(shared.model, states)
    solved = [PoseResult(position) for position in positions]
    if (modal := analyses.get(ModalRequest)) is not None:
        modes = solve_lumped_modes(motions)
        # amplitudes whose squares are the shares of the strain energy: orthonormal in every pose
        shapes = np.sqrt(modes.energy) * np.sign(modes.shapes)
        solved = [
            replace(
                result,
                frequencies_hz=modes.frequencies_hz[number],
                wanted=modal.count_wanted(modes.frequencies_hz[number], 0),
                shapes=shapes[number].astype(np.float32),
            )
            for number, result in enumerate(solved)
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
        solved = [
            replace(
                result,
                compliance=compliance[number],
                links=tuple(names[number]),
                link_shares=shares[number],
            )
            for number, result in enumerate(solved)
        ]
    return solved


def _point_motion(shared: _LumpedPoses, motions: SmallMotions, point: Point) -> FloatArray:
    """``(n, 3, c)`` translation of a point's tool per compliant coordinate, ground frame."""
    name, interface = point.tool.component or "", point.tool.interface or ""
    marker, frame = shared.mechanism.carries[name], shared.own[name]
    tip = shared.superelements[name].interface_position(interface) + np.asarray(point.offset)
    local = frame.origin + frame.rotation @ tip
    marker_index = shared.model.mechanism.markers.index(marker)
    arm = motions.kinematics.placement.rotations[:, marker_index] @ local
    motion = marker_motion(shared.model, motions, marker)
    return motion[:, :3] + np.cross(motion[:, 3:], arm[:, :, None], axisa=1, axisb=1, axisc=1)


def _weakest_parts(
    shared: _LumpedPoses, states: FloatArray, energies: FloatArray
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
