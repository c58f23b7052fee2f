"""Limit depths over speeds, and their ±: what finer models would change of them, and the search itself."""

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import DIRECTIONS, BoolArray, FloatArray
from headstock.pipeline.answers.lobes import HZ, DirectionLobes
from headstock.pipeline.lobes.cutting_point import (
    CuttingPoint,
    find_tip,
    travel_frame,
    turn_response,
)
from headstock.pipeline.numbers.estimates import (
    BORDER,
    CURVED_FACES,
    CUTTING,
    DISCRETISATION,
    REDUCTION,
)
from headstock.pipeline.stages.estimates import name_what_is_left_out
from headstock.pipeline.stages.frf import find_error_sources
from headstock.pipeline.stages.machine import damp_system
from headstock.pipeline.stages.run_state import PoseModel
from headstock.reduction.estimates.figure_errors import Border, find_border_changes
from headstock.reduction.estimates.response_errors import SystemChange, project_response
from headstock.scene.analyses.lobes import LobesRequest
from headstock.solvers.linear.modal_analysis import solve_modal
from headstock.solvers.milling.border import find_border
from headstock.solvers.milling.coefficients import CuttingCoefficients
from headstock.solvers.milling.collocation import FINER, PeriodicCut, safe_depth
from headstock.solvers.milling.lobes import LobeDiagram, chatter_eigenvalues
from headstock.solvers.milling.tip_poles import TipPoles, turn_tip
from headstock.solvers.second_order import ComplexArray, input_columns, output_rows

BEST_SPEEDS = 3
WORTHWHILE = 1.2  # times the lowest limit: a speed is worth choosing
STEPS = 2  # towards the border of another machine, with the slope of this one
FARTHEST = 0.5  # relative, of such a step
BY_ONE_FREQUENCY = "a measured receptance, whose limits no multipliers confirm"
Errors = dict[str, FloatArray]


@dataclass(frozen=True, eq=False)
class Limits:
    """The border of stability along a travel.

    Attributes:
        depths: ``(n,)`` limit depth [m]; the deepest that was looked for where there is none, NaN
            where it was not looked for.
        limited: ``(n,)`` whether there is a limit.
        search: ``(n,)`` by how much the search may be off [m]; NaN where nothing says.
        slopes: ``(n,)`` growth of what chatters over the relative depth, at the limit.
        chatter: ``(n,)`` angular frequency of chatter [rad/s]; NaN where there is none.
        waves: ``(n,)`` whole waves between two teeth; -1 where there are none.
        eigenvalues: ``(n,)`` of receptance times mean cutting stiffness at that frequency, nearest to
            the limit [1/m].
    """

    depths: FloatArray
    limited: BoolArray
    search: FloatArray
    slopes: FloatArray
    chatter: FloatArray
    waves: NDArray[np.intp]
    eigenvalues: ComplexArray


def choose_speeds(request: LobesRequest) -> BoolArray:
    """``(n,)`` at which speeds limits are looked for: all, or an even share of them."""
    count = len(request.speeds)
    kept = min(count, max(2, round(request.checked * count)))
    chosen = np.zeros(count, dtype=bool)
    chosen[np.round(np.linspace(0, count - 1, kept)).astype(np.intp)] = True
    return chosen


def _cuts_at_speeds(
    request: LobesRequest,
    tip: TipPoles,
    some: BoolArray,
    coefficients: CuttingCoefficients | None = None,
) -> list[PeriodicCut | None]:
    """Cuts at some of the speeds.

    Args:
        some: ``(n,)`` at which speeds.
        coefficients: Others than those of the request.
    """
    return [
        PeriodicCut(tip, request.cut_at(float(speed), coefficients)) if one else None
        for speed, one in zip(request.speeds, some, strict=True)
    ]


def find_limits(
    point: CuttingPoint, frame: FloatArray, tip: TipPoles, diagram: LobeDiagram
) -> Limits:
    """The border along a travel.

    Args:
        point: Where the machine cuts.
        frame: ``(3, 3)`` rows from :func:`travel_frame`.
        diagram: Limits by a single frequency, near which the border is expected.
    """
    request = point.request
    safe = safe_depth(tip, request.cut_at(float(request.speeds[0])))
    cuts = _cuts_at_speeds(request, tip, choose_speeds(request))
    borders = find_border(cuts, diagram.depths, safe=safe, deepest=request.deepest)
    depths, chatter = (
        np.array([getattr(border, name) for border in borders]) for name in ("depth", "omega")
    )
    limited = np.array([border.limited for border in borders])
    eigenvalues = np.zeros(len(borders), dtype=complex)
    if limited.any():
        eigenvalues[limited] = chatter_eigenvalues(
            turn_response(point.tip(chatter[limited]), frame),
            point.stiffness,
            chatter[limited],
            depths[limited],
            2.0 * np.pi / (request.mill.teeth * request.speeds[limited]),
        )
    return Limits(
        depths,
        limited,
        np.array([border.error if border.limited else np.nan for border in borders]),
        np.array([border.slope for border in borders]),
        chatter,
        np.array([border.waves for border in borders], dtype=np.intp),
        eigenvalues,
    )


def limits_by_one_frequency(diagram: LobeDiagram) -> Limits:
    """Limits that nothing confirms, of a tool whose receptance is measured."""
    unknown = np.full(len(diagram.speeds), np.nan)
    return Limits(
        diagram.depths,
        diagram.waves >= 0,
        unknown,
        unknown,
        diagram.chatter,
        diagram.waves,
        diagram.eigenvalues,
    )


def best_speeds(depths: FloatArray) -> tuple[int, ...]:
    """The deepest of the limits that no neighbour exceeds, the deepest first; of equal ones in a row
    the middle. A speed at which no limit was looked for is none, and no neighbour.

    Args:
        depths: ``(n,)`` [m]; NaN where none was looked for.
    """
    limited = np.flatnonzero(np.isfinite(depths))
    if not len(limited):
        return ()
    chosen = depths[limited]
    starts = np.flatnonzero(np.concatenate([[True], chosen[1:] != chosen[:-1]]))
    ends = np.concatenate([starts[1:], [len(chosen)]]) - 1
    level = chosen[starts]
    before, after = np.concatenate([[-np.inf], level[:-1]]), np.concatenate([level[1:], [-np.inf]])
    tops = np.flatnonzero((level > before) & (level > after) & (level > WORTHWHILE * chosen.min()))
    order = sorted(tops, key=lambda top: -level[top])[:BEST_SPEEDS]
    return tuple(int(limited[(starts[top] + ends[top]) // 2]) for top in order)


def estimate_limits(
    machine: PoseModel,
    point: CuttingPoint,
    found: tuple[DirectionLobes, ...],
    limits: tuple[Limits, ...],
) -> tuple[DirectionLobes, ...]:
    """Directions of travel with the errors of their limits and frequencies of chatter."""
    left_out = name_what_is_left_out(machine.parts).left_out if machine.coupled else ()
    if point.poles is None:
        left_out = (*left_out, BY_ONE_FREQUENCY)
        return tuple(dataclasses.replace(lobes, left_out=left_out) for lobes in found)
    changes = _find_changes(machine, point, found, limits)
    return tuple(
        dataclasses.replace(
            lobes,
            depth_errors={
                BORDER: border.search,
                **depths,
                **_spread_coefficients(point, lobes, border),
            },
            chatter_errors=chatter,
            left_out=left_out,
        )
        for lobes, border, (depths, chatter) in zip(found, limits, changes, strict=True)
    )


def _spread_coefficients(point: CuttingPoint, own: DirectionLobes, limits: Limits) -> Errors:
    """What ranges of the cutting coefficients make of limits [m]."""
    request, poles = point.request, point.poles
    if poles is None or not request.coefficients.ranges:
        return {}
    tip = turn_tip(poles, travel_frame(own.direction, request.up, request.part))
    half = np.zeros(len(limits.depths))
    for coefficient in request.coefficients.ranges.values():
        moved = [
            _move_border(point, tip, limits, limits.limited, end).depth for end in coefficient.ends
        ]
        half += limits.depths * np.abs(np.array(moved) - 1.0).max(axis=0)
    return {CUTTING: half}


def _find_changes(
    machine: PoseModel,
    point: CuttingPoint,
    found: tuple[DirectionLobes, ...],
    limits: tuple[Limits, ...],
) -> list[tuple[Errors, Errors]]:
    """Errors of limit depths [m] and of frequencies of chatter [Hz] by source, of each direction."""
    request, coupled = point.request, machine.coupled
    nothing: list[tuple[Errors, Errors]] = [({}, {}) for _ in found]
    if coupled is None:
        return nothing
    sources = find_error_sources(machine.parts, coupled)
    if not (sources.truncated or sources.meshed):
        return nothing
    ports = [(request.at, direction) for direction in DIRECTIONS]
    channels = input_columns(machine.system, ports), output_rows(machine.system, ports)
    space = project_response(machine.system, sources, machine.all_modes, channels, request.reach_hz)
    tips: dict[int, TipPoles] = {}

    def tip_of(change: SystemChange | None) -> TipPoles:
        if id(change) not in tips:
            # ratios of modes are those of the changed ones
            system = damp_system(machine.parts.scene, space.changed_system(ports, ports, change))
            tips[id(change)] = find_tip(request, system, solve_modal(system))
        return tips[id(change)]

    errors = []
    for lobes, border in zip(found, limits, strict=True):
        frame = travel_frame(lobes.direction, request.up, request.part)

        def find(
            change: SystemChange | None,
            some: BoolArray,
            frame: FloatArray = frame,
            border: Limits = border,
        ) -> Border:
            return _move_border(point, turn_tip(tip_of(change), frame), border, some)

        changes = find_border_changes(space, find, border.chatter)
        by_source = {
            source: size
            for source, size in (
                (DISCRETISATION, changes.mesh),
                (CURVED_FACES, changes.faces),
                (REDUCTION, changes.modes),
            )
            if size is not None
        }
        errors.append(
            (
                {source: border.depths * size.depth for source, size in by_source.items()},
                {source: HZ * size.chatter for source, size in by_source.items()},
            )
        )
    return errors


def _move_border(
    point: CuttingPoint,
    tip: TipPoles,
    limits: Limits,
    some: BoolArray,
    coefficients: CuttingCoefficients | None = None,
) -> Border:
    """Where another machine or material chatters, by the growth it has at the limits of this one.

    Args:
        tip: Of the other machine, in the axes of the travel.
        some: ``(n,)`` at which speeds, all of which have a limit; NaN at others.
    """
    usual = point.request.coefficients
    # limits go with the inverse of the coefficients, all else is a small change
    scale = 1.0 if coefficients is None else usual.chip[0] / coefficients.chip[0]
    depth, chatter = np.full((2, len(some)), np.nan)
    cuts = _cuts_at_speeds(point.request, tip, some, coefficients)
    for index in np.flatnonzero(some):
        if (cut := cuts[index]) is not None:
            share = scale
            for _ in range(STEPS):
                largest = cut.largest(share * float(limits.depths[index]), FINER)
                step = float(np.log(np.abs(largest.value)) / limits.slopes[index])
                if not abs(step) < FARTHEST:
                    break  # too far for a slope: nothing bounds it
                share *= 1.0 - step
            else:
                depth[index], chatter[index] = share, cut.frequency(largest)
    return Border(depth, chatter)
