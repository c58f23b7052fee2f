"""± of the lowest limits: what finer models would change of them."""

import dataclasses
import functools

import numpy as np

from headstock.geometry.frames import DIRECTIONS, FloatArray
from headstock.pipeline.answers.estimates import CURVED_FACES, DISCRETISATION, REDUCTION, Estimate
from headstock.pipeline.answers.lobes import HZ, DirectionLobes, LimitErrors
from headstock.pipeline.lobes.cutting_point import (
    CuttingPoint,
    highest_hz,
    spread_lines,
    travel_frame,
)
from headstock.pipeline.stages.estimates import name_what_is_left_out
from headstock.pipeline.stages.frf import find_error_sources
from headstock.pipeline.stages.machine import damp_system
from headstock.pipeline.stages.run_state import PoseModel
from headstock.reduction.estimates.limit_errors import (
    FinerModels,
    LimitChanges,
    LowestLimit,
    change_models,
    find_limit_changes,
)
from headstock.reduction.estimates.response_errors import (
    ErrorSources,
    SystemChange,
    project_response,
)
from headstock.scene.requests import LobesRequest
from headstock.solvers.linear.frequency_response import FrfModel, find_peaks, prepare_frf
from headstock.solvers.milling.tool_dynamics import couple_assembly
from headstock.solvers.second_order import ComplexArray, input_columns, output_rows


def judge_limits(
    machine: PoseModel, point: CuttingPoint, found: tuple[DirectionLobes, ...]
) -> tuple[DirectionLobes, ...]:
    """Directions of travel with the errors of their lowest limits; a limit found by bisection has
    the relative error of its zeroth order.
    """
    request, coupled, parts = point.request, machine.coupled, machine.parts
    if coupled is None:
        return found
    left_out = name_what_is_left_out(parts).left_out
    models = _find_finer_models(machine, request, find_error_sources(parts, coupled))
    if models is None:
        nothing = LimitErrors(Estimate({}, left_out), Estimate({}, left_out))
        return tuple(dataclasses.replace(own, errors=nothing) for own in found)

    def find_lowest(frame: FloatArray, model: FrfModel) -> LowestLimit:
        def tip(omega: FloatArray) -> ComplexArray:
            return couple_assembly(model.form.evaluate(omega), omega, point.assembly)

        poles = find_peaks(model, highest_hz(request, point.assembly))
        diagram = point.find_diagram(frame, tip, spread_lines(request, point.assembly, poles))
        place = int(np.argmin(diagram.depths))
        return LowestLimit(float(diagram.depths[place]), float(diagram.chatter[place]))

    judged = []
    for own in found:
        if own.lowest is not None:
            find = functools.partial(find_lowest, travel_frame(own.direction, request.up))
            changes = find_limit_changes(models, find)
            scale = float(own.depths[own.lowest.place]) / changes.plain.depth
            own = dataclasses.replace(own, errors=_list_errors(changes, scale, left_out))
        judged.append(own)
    return tuple(judged)


def _find_finer_models(
    machine: PoseModel, request: LobesRequest, sources: ErrorSources
) -> FinerModels | None:
    """The machine where it cuts as finer models may have it; None without any source of error."""
    if not (sources.truncated or sources.meshed):
        return None
    ports = [(request.at, direction) for direction in DIRECTIONS]
    channels = input_columns(machine.system, ports), output_rows(machine.system, ports)
    space = project_response(machine.system, sources, machine.all_modes, channels, request.reach_hz)

    def respond(change: SystemChange | None) -> FrfModel:
        # ratios of modes are those of the changed ones
        system = damp_system(machine.parts.scene, space.changed_system(ports, ports, change))
        return prepare_frf(system, inputs=ports, outputs=ports)

    return change_models(space, respond)


def _list_errors(changes: LimitChanges, scale: float, left_out: tuple[str, ...]) -> LimitErrors:
    """Changes by source as estimates, those of depths times a scale."""
    depths: dict[str, float | None] = {}
    chatter: dict[str, float | None] = {}
    for source, size in (
        (DISCRETISATION, changes.mesh),
        (CURVED_FACES, changes.faces),
        (REDUCTION, changes.modes),
    ):
        if size is not None:
            depths[source] = scale * size.depth if np.isfinite(size.depth) else None
            chatter[source] = HZ * size.chatter if np.isfinite(size.chatter) else None
    return LimitErrors(Estimate(depths, left_out), Estimate(chatter, left_out))
