"""Errors of guides and torque ripple along a path under control."""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.drives import Drive, ripple_force
from headstock.pipeline.paths.closed_path import LINEAR_REACH
from headstock.pipeline.paths.path_model import axis_shares, choose_model, couple_at, sample_path
from headstock.pipeline.paths.solved_moves import observe_path
from headstock.pipeline.stages.control import drive_machine
from headstock.pipeline.stages.motion_forces import watch_drives
from headstock.pipeline.stages.probe_motions import probe_values
from headstock.pipeline.stages.run_state import RunState
from headstock.reduction.coupling.drives import housing_rows, scale_rows
from headstock.reduction.coupling.error_travel import find_offset_motions
from headstock.reduction.coupling.path_loads import housing_loads
from headstock.reduction.motions.path_errors import (
    STEPS_PER_WAVE,
    PathErrors,
    add_error_inputs,
    pass_offsets,
    respond_to_errors,
)
from headstock.scene.analyses.path import PathRequest
from headstock.solvers.control.drive_loops import close_loops
from headstock.solvers.control.drive_trains import FORCE, SCALE
from headstock.solvers.control.friction_loop import friction_channels
from headstock.solvers.linear.state_space import Feedthrough
from headstock.solvers.paths.response import Disturbance, PathDeviation, solve_loop_loads
from headstock.solvers.paths.set_points import SetPoint, sample_move
from headstock.solvers.paths.varying_system import PosedModes
from headstock.solvers.second_order import Channel


def disturb_loop(
    state: RunState, request: PathRequest, errors: PathErrors | None, move: SetPoint
) -> PathDeviation:
    """Deviation by errors of guides and torque ripple over a move under control, in the pose of the
    middle, from that at its beginning.
    """
    driven = drive_machine(couple_at(state, request, 0.5 * request.path.length), state.warn)
    if friction_channels(driven.trains):
        state.warn(
            "path analysis: errors of guides and torque ripple move the machine as if there were no friction; what friction does is added"
        )
    observers, machine = observe_path(state, driven.released), state.scene.machine
    system = observers.join(driven.system)
    channels: tuple[Channel, ...] = ()
    shortest = math.inf
    passed: Feedthrough | None = None
    if errors is not None:
        shortest = errors.shortest
        drives = tuple(state.scene.drives.values())
        read = [drive for drive in drives if drive.control.encoder == SCALE]
        motions = find_offset_motions(
            driven.coupled,
            errors.travel,
            system,
            unmoved=scale_rows(driven.coupled, machine, read),
        )
        turned = housing_rows(driven.coupled, machine, drives) @ motions.moved
        spun = housing_loads(driven.trains, turned, len(system.mass))
        motions = dataclasses.replace(motions, accelerations=motions.accelerations + spun)
        system, channels = add_error_inputs(system, errors.travel, motions)
        passed = pass_offsets(
            driven.coupled,
            errors.travel,
            motions,
            request.outputs,
            observers.joints,
            probe_values(observers.probes),
        )
    rippling = [drive for drive in state.scene.drives.values() if drive.ripple]
    channels = (*channels, *((drive.name, FORCE) for drive in rippling))

    def loads(times: FloatArray) -> FloatArray:
        positions = sample_move(move, times).positions
        parts = [] if errors is None else [errors.amounts(move, times)]
        return np.hstack([*parts, *(_path_ripple(drive, request, positions) for drive in rippling)])

    loop = close_loops(
        system,
        driven.trains,
        inputs=channels,
        outputs=(*request.outputs, *observers.outputs),
        up_to_hz=LINEAR_REACH * request.band_hz,
    )
    step = min(shortest, _shortest_ripple(rippling, request)) / move.feed / STEPS_PER_WAVE
    return solve_loop_loads(
        loop.space,
        request.outputs,
        Disturbance(channels, loads, step, passed),
        samples=sample_path(request, move),
        watch=observers.watch.join(watch_drives(state.scene.drives.values())),
    )


def disturb_freely(
    state: RunState,
    request: PathRequest,
    errors: PathErrors,
    move: SetPoint,
    middle: PosedModes,
) -> PathDeviation:
    """The same with motors that follow their set point."""
    posed = couple_at(state, request, 0.5 * request.path.length)
    observers = observe_path(state, posed)
    return respond_to_errors(
        errors,
        observers.join(middle.system),
        move,
        samples=sample_path(request, move),
        low_frequency_limit_hz=choose_model(request).low_frequency_limit_hz,
        joints=observers.joints,
        probes=probe_values(observers.probes),
        watch=observers.watch,
    )


def _path_ripple(drive: Drive, request: PathRequest, positions: FloatArray) -> FloatArray:
    """Force ``(n, 1)`` of a drive along ``(n,)`` places of a path by the ripple of its torque, from
    that at the beginning [N].
    """
    start = request.path.start.positions.get(drive.axis, 0.0)
    share = axis_shares(request).get(drive.axis, 0.0)
    found = ripple_force(drive, start + share * positions)
    return (found - ripple_force(drive, np.array([start])))[:, None]


def _shortest_ripple(drives: Sequence[Drive], request: PathRequest) -> float:
    """Shortest wave of motor torques along the path [m]; infinite without any."""
    shares = axis_shares(request)
    return min(
        (
            drive.lead / wave.per_turn / abs(shares[drive.axis])
            for drive in drives
            if shares.get(drive.axis)
            for wave in drive.ripple
        ),
        default=math.inf,
    )
