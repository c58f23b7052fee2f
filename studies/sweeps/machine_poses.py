"""What a sweep computes in each pose of a machine of superelements."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from headstock.geometry.errors import HeadstockError, PoseError
from headstock.geometry.frames import DIRECTIONS, FloatArray
from headstock.geometry.machine.machine import Pose
from headstock.geometry.machine.tool_travel import NO_FEED
from headstock.geometry.mechanisms.exechon import solve_pose
from headstock.pipeline.answers.lobes import HZ
from headstock.pipeline.answers.map import describe_state
from headstock.pipeline.lobes.cutting_point import lobes_request
from headstock.pipeline.lobes.lobes import solve_lobes
from headstock.pipeline.stages.frf import respond
from headstock.pipeline.stages.machine import CoupledPose
from headstock.pipeline.stages.run_state import MachineParts, PoseModel
from headstock.reduction.coupling.coupling import couple
from headstock.reduction.coupling.dof_layout import turn_dofs
from headstock.reduction.coupling.elimination import CouplingMemo
from headstock.reduction.motions.body_motions import join_names, split_number
from headstock.reduction.motions.compliance_budget import point_budget
from headstock.reduction.superelement import Superelement
from headstock.scene.analyses.frf import FrfRequest
from headstock.scene.analyses.lobes import LobesRequest
from headstock.scene.analyses.modal import ModalRequest
from headstock.scene.analyses.static import StaticRequest
from headstock.scene.scene import LOAD
from headstock.solvers.linear.modal_analysis import keep_lowest, solve_lowest_modes
from headstock.studies.sweeps.journals import FIGURES, PoseResult

# modes beyond those asked for, so that one that leaves the range in a neighbouring pose can be
# followed
EXTRA_SHARE, EXTRA_LEAST, EXTRA_REACH = 0.25, 3, 1.15
RESOLVED = 1e-5  # relative error of the highest eigenvalue, far beyond what is asked for
# an error in one pose is that pose's result
POSE_ERRORS = (HeadstockError, ValueError, np.linalg.LinAlgError)


@dataclass(frozen=True, eq=False)
class MachinePoses:
    """What all poses of a machine share.

    Attributes:
        memo: What their couplings share.
    """

    parts: MachineParts
    superelements: Mapping[str, Superelement]
    memo: CouplingMemo


def share_machine(parts: MachineParts, superelements: Mapping[str, Superelement]) -> MachinePoses:
    """What all poses of the machine of a scene share."""
    static, frf = parts.scene.analyses.get(StaticRequest), parts.scene.analyses.get(FrfRequest)
    lobes = parts.scene.analyses.get(LobesRequest)
    channels = {
        *(() if lobes is None else (lobes.at,)),
        *(() if static is None else static.at),
        *(name for name, dof in (() if frf is None else frf.inputs + frf.outputs) if dof != LOAD),
    }
    return MachinePoses(parts, superelements, CouplingMemo(channels))


def solve_machine_pose(
    shared: MachinePoses, pose: Pose, positions: FloatArray, feed: FloatArray = NO_FEED
) -> PoseResult:
    """Couple in a pose and compute what the scene asks for; what cannot be computed is said in the
    result.

    Args:
        shared: What all poses share.
        positions: The same as ``(k,)``, for the result.
        feed: ``(3,)`` direction of the feed; NaN where there is none.
    """
    found = PoseResult(positions, feed=feed)
    try:
        coupled = couple(shared.superelements, shared.parts.scene.machine, pose, memo=shared.memo)
    except PoseError as error:
        return replace(found, state="unreachable", error=str(error))
    except POSE_ERRORS as error:
        return replace(found, state="failed", error=f"coupling: {error}")
    found = replace(found, condition=_find_condition(shared, pose))
    errors: list[str] = []
    model = CoupledPose(shared.parts, pose, coupled, RESOLVED)
    for name, add in (
        ("static", _add_points),
        ("modal", _add_modes),
        ("frf", _add_response),
        ("lobes", _add_lobes),
    ):
        try:
            found = add(model, found)
        except POSE_ERRORS as error:
            errors.append(f"{name} analysis: {error}")
    return replace(found, state="failed" if errors else "done", error="; ".join(errors))


def _modes_to_solve(request: ModalRequest) -> tuple[int | None, float | None]:
    """Count and highest frequency to solve for so that the modes asked for can be followed."""
    count = (
        None
        if request.count is None
        else request.count + max(EXTRA_LEAST, round(EXTRA_SHARE * request.count))
    )
    return count, None if request.up_to_hz is None else EXTRA_REACH * request.up_to_hz


def count_wanted(request: ModalRequest, frequencies_hz: FloatArray, rigid_count: int) -> int:
    """How many of the modes solved for the scene asks for.

    Args:
        request: Number of modes, highest frequency [Hz], or both.
        frequencies_hz: ``(m,)`` rising [Hz].
        rigid_count: How many of them are rigid-body modes, which a highest frequency keeps.
    """
    wanted = (
        len(frequencies_hz) if request.count is None else min(request.count, len(frequencies_hz))
    )
    if request.up_to_hz is not None:
        wanted = min(
            wanted,
            max(rigid_count, int(np.searchsorted(frequencies_hz, request.up_to_hz, side="right"))),
        )
    return wanted


def _find_condition(shared: MachinePoses, pose: Pose) -> FloatArray:
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
    request = model.parts.scene.analyses.get(StaticRequest)
    if request is None:
        return found
    budgets = [point_budget(model.coupled, name) for name in request.at]
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
    request, coupled = model.parts.scene.analyses.get(ModalRequest), model.coupled
    if request is None:
        return found
    count, limit = _modes_to_solve(request)
    analyses = model.parts.scene.analyses
    modal = (
        solve_lowest_modes(coupled.system, count=count, up_to_hz=limit)
        if FrfRequest not in analyses and LobesRequest not in analyses
        else keep_lowest(model.all_modes, count=count, up_to_hz=limit)
    )
    stacked = coupled.basis @ modal.shapes
    for name, place in coupled.offsets.items():
        part = coupled.layout.superelements[name]
        stacked[place] = turn_dofs(part, coupled.placements[name]) @ stacked[place]
    return replace(
        found,
        frequencies_hz=modal.frequencies_hz,
        wanted=count_wanted(request, modal.frequencies_hz, modal.rigid_count),
        rigid_count=min(modal.rigid_count, len(modal.frequencies_hz)),
        shapes=stacked.astype(np.float32),
    )


def _add_response(model: CoupledPose, found: PoseResult) -> PoseResult:
    return (
        found
        if FrfRequest not in model.parts.scene.analyses
        else replace(found, figures=list_figures(model))
    )


def _add_lobes(model: CoupledPose, found: PoseResult) -> PoseResult:
    return found if LobesRequest not in model.parts.scene.analyses else add_limits(model, found)


def add_limits(model: PoseModel, found: PoseResult) -> PoseResult:
    """A result with the limit depths of cut in its pose.

    Args:
        found: The result so far, with the direction of the feed.
    """
    request, solved = lobes_request(model), solve_lobes(model, found.feed, whole=False).answer
    by_name = {own.name: own for own in solved.directions}
    unknown = np.full(len(request.speeds), np.nan)
    limits, chatter, modes = [], [], []
    for travel in request.directions:
        own = by_name.get(travel.name)
        lowest = None if own is None else own.lowest
        limits.append(unknown if own is None else own.depths)
        chatter.append(np.nan if own is None or lowest is None else HZ * own.chatter[lowest.place])
        modes.append("" if lowest is None else lowest.mode)
    return replace(
        found,
        limits=np.array(limits),
        chatter_hz=np.array(chatter),
        chatter_modes=tuple(modes),
        limits_confirmed=solved.confirmed,
    )


def list_figures(model: PoseModel) -> FloatArray:
    """What the frequency response in a pose says about cutting, ``(ports, f)`` as ``FIGURES`` names
    it, NaN where it says nothing.
    """
    channels = respond(model, judged=False).answer.figures
    return np.array(
        [[getattr(channel, name) for name in FIGURES] for channel in channels], dtype=float
    )
