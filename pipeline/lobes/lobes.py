"""The stage of stability lobes: limit depths of cut over the speed of the spindle.

Only rank 0 has anything to do.
"""

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.feed import NO_FEED
from headstock.geometry.machine.machine import Pose, free_axes
from headstock.pipeline.answers.lobes import DirectionLobes, PoseLobes
from headstock.pipeline.lobes.chatter_sources import group_lobes
from headstock.pipeline.lobes.cutting_point import (
    CuttingPoint,
    lobes_request,
    prepare_point,
    reduced_tip,
    travel_frame,
)
from headstock.pipeline.lobes.limit_checks import ISLANDS, Trials, best_speeds, choose_speeds
from headstock.pipeline.lobes.limit_errors import judge_limits
from headstock.pipeline.planning.plan import Stage
from headstock.pipeline.stages.run_state import Outcome, PoseModel, RunState, Solved, pose_model
from headstock.reduction.motions.feed import trace_feed
from headstock.scene.requests import LobesRequest, Travel
from headstock.solvers.errors import ModelError
from headstock.solvers.milling.stability import TipDynamics, TipPoles, turn_tip
from headstock.solvers.milling.tool_dynamics import MeasuredAssembly

BESIDE = 1e-4  # of a path on which axes turn: how far beside a pose its direction is looked at
RIGID_TOOL = "rigid: lobes above the machine's modes mean little without modes of spindle and tool"


def run_lobes_stage(state: RunState, stage: Stage) -> Outcome:
    """Stability lobes in a pose."""
    if not state.is_root:
        return Outcome()
    model = pose_model(state)
    try:
        solved = solve_lobes(model, _feed_of_path(model, lobes_request(model)))
    except ModelError as error:
        return Outcome(failures=(f"lobes in pose {model.pose.name}: {error}",))
    lowest = min(
        (float(own.depths.min()) for own in solved.answer.directions), default=float("nan")
    )
    checks = [check for own in solved.answer.directions for check in own.checks]
    confirmed = sum(check.confirmed for check in checks)
    detail = f"lowest limit depth {1e3 * lowest:.3g} mm, {confirmed} of {len(checks)} checked limits confirmed"
    return Outcome(detail=detail, answers=(solved.answer,), warnings=solved.warnings)


def _feed_of_path(model: PoseModel, request: LobesRequest) -> FloatArray:
    """``(3,)`` in a pose, machine frame, while the axes of the path analysis move as on its path;
    NaN where nobody asks.

    Raises:
        ModelError: The tool does not move across its axis.
    """
    path, pose = request.path, model.pose
    if path is None or not request.asks_for_feed:
        return NO_FEED
    ends = [
        {axis: end.positions.get(axis, 0.0) for axis in path.axes} for end in (path.start, path.end)
    ]
    if path.turning:
        # what turns goes another way in every pose: from one place beside it to another
        here = pose.positions
        ends = [
            {
                axis: here.get(axis, 0.0) + side * (ends[1][axis] - ends[0][axis])
                for axis in path.axes
            }
            for side in (-BESIDE, BESIDE)
        ]
    poses = [Pose(pose.name, {**pose.positions, **end}) for end in ends]
    parts = model.parts
    free = free_axes(parts.scene.machine)
    feed = trace_feed(free, parts.superelements, request.at, poses).directions[0]
    if len(request.travels(feed)) < len(request.directions):
        raise ModelError(
            f"along [analyses.path] the tool at {request.at} does not move across its axis in this pose, so there is no feed"
        )
    return np.asarray(feed)


def solve_lobes(
    machine: PoseModel, feed: FloatArray = NO_FEED, *, whole: bool = True
) -> Solved[PoseLobes]:
    """Lobes of a machine in a pose with the damping of its scene.

    Args:
        machine: In the pose.
        feed: ``(3,)`` direction of the feed, machine frame; NaN where there is none, and then no
            lobes along it.
        whole: Find the mode behind every lobe, check the best speeds, and look for unstable islands
            below every limit that is checked; else below and at the lowest one only.

    Raises:
        ModelError: A mode in the range has no damping.
    """
    point = prepare_point(machine)
    request = point.request
    tip = None if isinstance(point.assembly, MeasuredAssembly) else reduced_tip(machine, point)
    found = tuple(
        _solve_direction(machine, point, travel, tip, whole=whole)
        for travel in request.travels(feed)
    )
    if whole:
        found = judge_limits(machine, point, found)
    low = request.immersion < request.low_immersion
    warnings = [] if tip is None else _warn_of_checks(machine, found)
    if tip is None and low:
        warnings.append(
            f"lobes: the immersion of {100.0 * request.immersion:.3g} % is low, and a measured receptance allows no Floquet"
            " multipliers: flip lobes are not in the limits"
        )
    method = "zeroth order (Altintas and Budak 1995)"
    if tip is None:
        method += "; not checked: the tool's receptance is measured"
    elif low:
        method = "Floquet multipliers at every speed (full discretisation), by bisection"
    else:
        method += "; Floquet multipliers at minima and at a sample of speeds, bisection where they disagree"
    answer = PoseLobes(
        pose=machine.pose.name,
        material=request.material,
        radial_depth=request.radial_depth,
        diameter=request.mill.diameter,
        teeth=request.mill.teeth,
        tool=_describe_tool(request),
        up_to_hz=request.up_to_hz,
        deepest=request.deepest,
        method=method,
        speeds=request.speeds,
        directions=found,
    )
    return Solved(answer, tuple(warnings))


def _solve_direction(
    machine: PoseModel,
    point: CuttingPoint,
    travel: Travel,
    tip: TipDynamics | TipPoles | None,
    *,
    whole: bool,
) -> DirectionLobes:
    request = point.request
    if travel.along is None:
        raise ValueError("a direction of travel is not known")
    frame = travel_frame(travel.along, request.up)
    diagram = point.find_diagram(frame)
    depths, checks, bisected = diagram.depths.copy(), [], 0
    if tip is not None:
        trials = Trials(request, turn_tip(tip, frame), diagram)
        if request.immersion < request.low_immersion:
            depths = np.array([trials.limit(place) for place in range(len(depths))])
            bisected = len(depths)
        else:
            drawn = choose_speeds(request, machine.pose, diagram)
            chosen = {*drawn, *(best_speeds(depths) if whole else ())}
            lowest, thorough = int(np.argmin(depths)), whole or request.checked >= 1.0
            for place in sorted(chosen):
                islands = ISLANDS if thorough or place == lowest else ()
                check, depths[place] = trials.check(place, islands)
                checks.append(check)
                bisected += not check.confirmed
    lobes, owner = group_lobes(point, diagram, depths, frame, machine, whole=whole)
    return DirectionLobes(
        name=travel.name,
        direction=travel.along,
        depths=depths,
        zeroth=diagram.depths,
        chatter=diagram.chatter,
        owner=owner,
        lowest_any_speed=diagram.lowest,
        lobes=lobes,
        best=best_speeds(depths),
        checks=tuple(checks),
        bisected=bisected,
    )


def _describe_tool(request: LobesRequest) -> str:
    if request.tool_receptance is not None:
        return f"measured receptances of {request.tool_receptance.name}"
    if not request.tool_modes:
        return RIGID_TOOL
    return "on the machine: " + ", ".join(
        f"{mode.name} {mode.hz:g} Hz" for mode in request.tool_modes
    )


def _warn_of_checks(machine: PoseModel, found: tuple[DirectionLobes, ...]) -> list[str]:
    """What checks did not confirm, in all directions of travel."""
    failed = [
        (float(own.depths[check.place] / check.depth - 1.0), own.name)
        for own in found
        for check in own.checks
        if not check.confirmed
    ]
    if not failed:
        return []
    worst, travel = max(failed, key=lambda each: abs(each[0]))
    return [
        f"lobes in pose {machine.pose.name}: {len(failed)} of {sum(len(own.checks) for own in found)} checked limits are off, by up to"
        f" {100.0 * worst:+.0f} % (travel {travel}); bisection has replaced these, others may be off as much: write checked = 1 in"
        " [analyses.lobes] to check every speed"
    ]
