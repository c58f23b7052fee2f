"""The stage of stability lobes: limit depths of cut over the speed of the spindle.

Only rank 0 has anything to do.
"""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.machine import Pose, free_axes
from headstock.geometry.machine.tool_travel import NO_FEED
from headstock.pipeline.answers.lobes import HZ, RPM, DirectionLobes, Lobe, PoseLobes
from headstock.pipeline.lobes.cutting_point import (
    CuttingPoint,
    highest_hz,
    lobes_request,
    prepare_point,
    travel_frame,
    turn_response,
)
from headstock.pipeline.lobes.limits import (
    Limits,
    best_speeds,
    choose_speeds,
    estimate_limits,
    find_limits,
    limits_by_one_frequency,
)
from headstock.pipeline.planning.plan import Stage
from headstock.pipeline.stages.run_state import Outcome, PoseModel, RunState, Solved, pose_model
from headstock.reduction.estimates.frequency_errors import truncated_parts
from headstock.reduction.motions.tool_deviation import trace_feed
from headstock.scene.analyses.lobes import LobesRequest, Travel
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.modal_coordinates import modal_motion
from headstock.solvers.milling.forces import describe_sense
from headstock.solvers.milling.lobes import chatter_shapes
from headstock.solvers.milling.tip_poles import turn_tip
from headstock.solvers.milling.tool_dynamics import (
    MeasuredAssembly,
    couple_assembly,
    split_tip_motion,
)
from headstock.solvers.second_order import ComplexArray

BESIDE = 1e-4  # of a path on which axes turn: how far beside a pose its direction is looked at
LOW_IMMERSION = (
    0.1  # radial depth over diameter below which limits of one frequency lack flip lobes
)
MULTIPLIERS = "Floquet multipliers at every speed (collocation in the cut), enclosed by secants"
ONE_FREQUENCY = "a single frequency (zeroth order, Altintas and Budak 1995); nothing confirms it"
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
    return Outcome(
        detail=_describe_limits(solved.answer), answers=(solved.answer,), warnings=solved.warnings
    )


def _describe_limits(found: PoseLobes) -> str:
    """Lowest limit, and how many speeds have one."""
    depths = np.array([lobes.depths for lobes in found.directions])
    looked_at = np.isfinite(depths)
    limited = sum(int(lobes.limited.sum()) for lobes in found.directions)
    if not looked_at.any():
        return "no speed looked at"
    lowest = f"lowest limit depth {1e3 * np.nanmin(depths):.3g} mm, " if limited else ""
    return f"{lowest}limits at {limited} of {int(looked_at.sum())} speeds"


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
        feed: ``(3,)`` direction of the feed, machine frame; NaN where there is none, and then no
            lobes along it.
        whole: Find the mode behind every lobe, and ± of limits; else the mode of the lowest one only.

    Raises:
        ModelError: A mode in the range has no damping.
    """
    point = prepare_point(machine)
    request = point.request
    solved = [
        _solve_direction(machine, point, travel, whole=whole) for travel in request.travels(feed)
    ]
    directions = tuple(lobes for lobes, _ in solved)
    if whole:
        directions = estimate_limits(
            machine, point, directions, tuple(limits for _, limits in solved)
        )
    answer = PoseLobes(
        pose=machine.pose.name,
        material=request.material,
        radial_depth=request.radial_depth,
        diameter=request.mill.diameter,
        teeth=request.mill.teeth,
        tool=_describe_tool(request),
        sense=describe_sense(request.sense, request.part),
        up_to_hz=request.up_to_hz,
        modes_to_hz=highest_hz(request, point.assembly)
        if point.poles is None
        else HZ * float(np.abs(point.poles.values).max(initial=0.0)),
        deepest=request.deepest,
        method=MULTIPLIERS if point.poles is not None else ONE_FREQUENCY,
        confirmed=point.poles is not None,
        speeds=request.speeds,
        directions=directions,
    )
    return Solved(answer, tuple(_warn_of_limits(machine, point, directions)))


def _solve_direction(
    machine: PoseModel, point: CuttingPoint, travel: Travel, *, whole: bool
) -> tuple[DirectionLobes, Limits]:
    request = point.request
    if travel.along is None:
        raise ValueError("a direction of travel is not known")
    frame = travel_frame(travel.along, request.up, request.part)
    diagram = point.find_diagram(frame)
    poles = point.poles
    limits = (
        limits_by_one_frequency(diagram)
        if poles is None
        else find_limits(point, frame, turn_tip(poles, frame), diagram)
    )
    lobes, owner = _group_lobes(point, limits, frame, machine, whole=whole)
    of_travel = DirectionLobes(
        name=travel.name,
        direction=travel.along,
        depths=limits.depths,
        limited=limits.limited,
        zeroth=diagram.depths,
        chatter=limits.chatter,
        owner=owner,
        lobes=lobes,
        best=best_speeds(limits.depths) if point.poles is not None else (),
    )
    return of_travel, limits


def _describe_tool(request: LobesRequest) -> str:
    if request.tool_receptance is not None:
        return f"measured receptances of {request.tool_receptance.name}"
    if not request.tool_modes:
        return RIGID_TOOL
    return "on the machine: " + ", ".join(
        f"{mode.name} {mode.hz:g} Hz" for mode in request.tool_modes
    )


def _warn_of_limits(
    machine: PoseModel, point: CuttingPoint, found: tuple[DirectionLobes, ...]
) -> list[str]:
    """Limits that nothing confirms, speeds that were left out, and modes above those asked for."""
    pose, request = machine.pose.name, point.request
    if point.poles is None:
        low = request.immersion < LOW_IMMERSION
        return [
            f"lobes in pose {pose}: the tool's receptance is measured, so limits are those of a single frequency and nothing confirms"
            f" them{'; the immersion is low, and flip lobes are not in them' if low else ''}; give tool_modes in its place"
        ]
    warnings = []
    wanted = choose_speeds(request)
    skipped = np.any([wanted & np.isnan(lobes.depths) for lobes in found], axis=0)
    if skipped.any():
        fastest = RPM * float(request.speeds[skipped].max())
        warnings.append(
            f"lobes in pose {pose}: {int(skipped.sum())} of {int(wanted.sum())} speeds, up to {fastest:.0f} rpm, were not evaluated: too many"
            " waves of the machine's modes between two teeth; begin with a higher speed"
        )
    highest = max((HZ * np.nanmax(lobes.chatter, initial=0.0) for lobes in found), default=0.0)
    parts = {} if machine.coupled is None else truncated_parts(machine.coupled)
    if highest > request.reach_hz and parts:
        warnings.append(
            f"lobes in pose {pose}: some limits chatter at up to {highest:.0f} Hz, above up_to = {request.up_to_hz:g} Hz, where modes of"
            f' {", ".join(parts)} are left out; write up_to = "{1.2 * highest:.0f} Hz"'
        )
    return warnings


def _group_lobes(
    point: CuttingPoint,
    limits: Limits,
    frame: FloatArray,
    machine: PoseModel,
    *,
    whole: bool,
) -> tuple[tuple[Lobe, ...], NDArray[np.intp]]:
    """Neighbouring speeds with the same waves of the same mode, and the lobe of each speed."""
    depths = limits.depths
    owner = np.full(len(depths), -1, dtype=np.intp)
    limited = np.flatnonzero(limits.limited)
    if not len(limited):
        return (), owner
    if not whole:
        limited = limited[[int(np.argmin(depths[limited]))]]
    sources, shares = _find_sources(point, limits, limited, frame)
    waves = limits.waves[limited]
    ranks = np.cumsum(np.isfinite(depths))[limited]  # among the speeds that were looked at
    new = (np.diff(ranks) > 1) | (np.diff(waves) != 0) | (np.diff(sources) != 0)
    owner[limited] = np.concatenate([[0], np.cumsum(new)])
    names = _name_sources(machine, point, sorted({int(source) for source in sources}))
    lobes = []
    for number in range(int(owner.max()) + 1):
        speeds = np.flatnonzero(owner == number)
        lowest = int(speeds[np.argmin(depths[speeds])])
        at = int(np.flatnonzero(limited == lowest)[0])
        name, hz, part = names[int(sources[at])]
        lobes.append(
            Lobe(
                place=lowest,
                first=int(speeds[0]),
                last=int(speeds[-1]),
                waves=int(limits.waves[lowest]),
                mode=name,
                mode_hz=hz,
                mode_share=float(shares[at]),
                part=part,
            )
        )
    return tuple(lobes), owner


def _find_sources(
    point: CuttingPoint,
    limits: Limits,
    places: NDArray[np.intp],
    frame: FloatArray,
) -> tuple[NDArray[np.intp], FloatArray]:
    """What contributes most to the motion that chatters at some speeds, ``(k,)`` numbers of modes of
    the machine and, after them, of parts of the assembly; and its share ``(k,)``.
    """
    omega = limits.chatter[places]
    machine = point.model.form.evaluate(omega)
    tip = turn_response(couple_assembly(machine, omega, point.assembly), frame)
    shapes = chatter_shapes(tip, point.stiffness, limits.eigenvalues[places])
    split = split_tip_motion(machine, omega, point.assembly, shapes.forces @ frame)
    weights = shapes.weights @ frame[:2]
    of_assembly = np.einsum("pnd,nd->np", split.parts, weights)
    coordinates = point.model.coordinates
    of_machine: ComplexArray = np.zeros((len(omega), 0), dtype=complex)
    if coordinates is not None:
        modal = modal_motion(coordinates, omega, split.base_force @ coordinates.inputs.T)
        of_machine = modal * (weights @ coordinates.outputs)
    every = np.concatenate([of_machine, of_assembly], axis=1).real
    if not every.shape[1]:
        return np.full(len(omega), -1, dtype=np.intp), np.zeros(len(omega))
    best = np.argmax(every, axis=1)
    return best, np.take_along_axis(every, best[:, None], axis=1)[:, 0]


def _name_sources(
    machine: PoseModel, point: CuttingPoint, sources: list[int]
) -> dict[int, tuple[str, float | None, str]]:
    """Name, natural frequency and part of modes of the machine and of parts of the assembly."""
    coordinates = point.model.coordinates
    count = 0 if coordinates is None else len(coordinates.eigenvalues)
    sources_by_number: dict[int, tuple[str, float | None, str]] = {-1: ("", None, "")}
    machine_modes = np.array([source for source in sources if 0 <= source < count], dtype=np.intp)
    if len(machine_modes):
        modes = machine.all_modes
        some = dataclasses.replace(
            modes,
            frequencies_hz=modes.frequencies_hz[machine_modes],
            shapes=modes.shapes[:, machine_modes],
            rigid_count=int((machine_modes < modes.rigid_count).sum()),
            residuals=modes.residuals[machine_modes],
        )
        named = machine.name_modes(some)
        for index, shown in enumerate(machine_modes):
            strain = named.strain_shares[index] or named.kinetic_shares[index]
            part = max(strain, key=lambda name: strain[name], default="")
            sources_by_number[int(shown)] = (
                named.names[index],
                float(some.frequencies_hz[index]),
                part,
            )
    for source in sources:
        if source >= count:
            if isinstance(point.assembly, MeasuredAssembly):
                sources_by_number[source] = ("measured assembly of spindle and tool", None, "tool")
            else:
                mode = point.assembly[source - count]
                sources_by_number[source] = (f"{mode.name} on its base", mode.hz, mode.name)
    return sources_by_number
