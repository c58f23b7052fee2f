"""± of limits: what finer models would change of them, and the search itself."""

import dataclasses

import numpy as np

from headstock.geometry.frames import DIRECTIONS, BoolArray, FloatArray
from headstock.pipeline.answers.lobes import HZ, DirectionLobes
from headstock.pipeline.lobes.cutting_point import CuttingPoint, find_tip, travel_frame
from headstock.pipeline.lobes.limits import Limits, cuts_at_speeds
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
from headstock.solvers.linear.modal_analysis import solve_modal
from headstock.solvers.milling.coefficients import CuttingCoefficients
from headstock.solvers.milling.collocation import FINER
from headstock.solvers.milling.stability import TipPoles, turn_tip
from headstock.solvers.second_order import input_columns, output_rows

STEPS = 2  # towards the border of another machine, with the slope of this one
FARTHEST = 0.5  # relative, of such a step
BY_ONE_FREQUENCY = "a measured receptance, whose limits no multipliers confirm"
Errors = dict[str, FloatArray]


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
        return tuple(dataclasses.replace(own, left_out=left_out) for own in found)
    changes = _find_changes(machine, point, found, limits)
    return tuple(
        dataclasses.replace(
            own,
            depth_errors={
                BORDER: border.search,
                **depths,
                **_spread_coefficients(point, own, border),
            },
            chatter_errors=chatter,
            left_out=left_out,
        )
        for own, border, (depths, chatter) in zip(found, limits, changes, strict=True)
    )


def _spread_coefficients(point: CuttingPoint, own: DirectionLobes, limits: Limits) -> Errors:
    """What ranges of the cutting coefficients make of limits [m]."""
    request, poles = point.request, point.poles
    if poles is None or not request.coefficients.ranges:
        return {}
    tip = turn_tip(poles, travel_frame(own.direction, request.up, request.part))
    half = np.zeros(len(limits.depths))
    for known in request.coefficients.ranges.values():
        moved = [_move_border(point, tip, limits, limits.limited, end).depth for end in known.ends]
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
    for own, border in zip(found, limits, strict=True):
        frame = travel_frame(own.direction, request.up, request.part)

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
    own = point.request.coefficients
    # limits go with the inverse of the coefficients, all else is a small change
    scale = 1.0 if coefficients is None else own.chip[0] / coefficients.chip[0]
    depth, chatter = np.full((2, len(some)), np.nan)
    cuts = cuts_at_speeds(point.request, tip, some, coefficients)
    for place in np.flatnonzero(some):
        if (cut := cuts[place]) is not None:
            share = scale
            for _ in range(STEPS):
                largest = cut.largest(share * float(limits.depths[place]), FINER)
                step = float(np.log(np.abs(largest.value)) / limits.slopes[place])
                if not abs(step) < FARTHEST:
                    break  # too far for a slope: nothing bounds it
                share *= 1.0 - step
            else:
                depth[place], chatter[place] = share, cut.frequency(largest)
    return Border(depth, chatter)
