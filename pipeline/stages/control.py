"""The control stage: loops closed around the machine in a pose, their poles, margins and tracking
error.
"""

import dataclasses
import functools
import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from headstock.geometry.errors import PoseError
from headstock.geometry.frames import FloatArray, rotate_dofs
from headstock.pipeline.answers.control import (
    ClosedLoopDrive,
    ClosedLoopPole,
    ControlAnswer,
    GuardAnswer,
    GuardFrequency,
)
from headstock.pipeline.numbers.estimates import Estimate
from headstock.pipeline.planning.plan import Stage
from headstock.pipeline.stages.machine import damp_system, warn_of_no_damping
from headstock.pipeline.stages.mechanism import pose_machine
from headstock.pipeline.stages.run_state import (
    Outcome,
    PoseModel,
    RunState,
    pose_model,
    pose_name,
)
from headstock.reduction.coupling.coupling import CoupledMachine
from headstock.reduction.coupling.dof_layout import turn_dofs
from headstock.reduction.coupling.drives import housing_rows, scale_rows
from headstock.reduction.coupling.error_travel import (
    ErrorTravel,
    OffsetMotions,
    find_offset_motions,
)
from headstock.reduction.coupling.path_loads import housing_loads
from headstock.scene.analyses.control import ControlRequest
from headstock.scene.studies import Sweep, sweep_neighbours, sweep_pose
from headstock.solvers.control.drive_loops import close_loops, find_velocity_lag
from headstock.solvers.control.drive_trains import MOTOR, SCALE, DriveTrain
from headstock.solvers.control.margins import find_margins
from headstock.solvers.control.sampled_loops import compare_sampled
from headstock.solvers.control.stability import LoopPoles, find_loop_poles, require_stable
from headstock.solvers.errors import UnstableControlError
from headstock.solvers.linear.modal_analysis import ModalResult, keep_lowest
from headstock.solvers.pairing.mode_tracking import SweptModes, track_modes
from headstock.solvers.second_order import SecondOrderSystem, output_rows

ROUNDOFF = 1e-12  # of a stiffness that weight and anchors are taken off, and of a lag
SAMPLING_SHARE = 0.01  # of a pole: difference from the sampled loop that causes a warning
SAMPLED_GROWS = "the loops are stable in continuous time, and a motion grows where controllers sample and hold; shorten their step"
TINY = 1e-12  # damping ratio or share of a motion that counts as none
LEAST_HEIGHT, MOST_GUARDS = 0.2, 6  # of a resonance over the rigid machine; listed of each drive
MARGIN_REACH = 4.0  # margins are looked for up to so many times the highest requested pole


@dataclass(frozen=True, eq=False)
class DrivenMachine:
    """A machine in a pose with its motors let go.

    Attributes:
        released: The machine, undamped modes and all; its system as coupled.
        modes: All its undamped modes: the travel of each driven axis is one without frequency.
    """

    released: PoseModel
    modes: ModalResult
    system: SecondOrderSystem
    trains: tuple[DriveTrain, ...]

    @property
    def coupled(self) -> CoupledMachine:
        """The released machine of superelements.

        Raises:
            ValueError: It is a lumped mechanism.
        """
        if self.released.coupled is None:
            raise ValueError("a lumped mechanism has no superelements")
        return self.released.coupled


def drive_machine(model: PoseModel, warn: Callable[[str], None]) -> DrivenMachine:
    """Place the drives of a scene in the pose of a machine and let their motors go.

    Args:
        model: The machine, motors locked.
        warn: Called with what is to be said of it.
    """
    scene = model.parts.scene
    released = model.release(scene.drives.values())
    bare, modes = released.model.system, released.model.all_modes
    for message in warn_of_no_damping(scene, bare):
        warn(message)
    if released.weight is None:
        damped = damp_system(scene, bare, modes)
        return DrivenMachine(released.model, modes, damped, released.trains)
    # modal damping is that of the modes without weight, and none of the motors' travels, which are
    # the lowest modes
    left = bare.stiffness - released.weight
    left[np.abs(left) <= ROUNDOFF * np.abs(bare.stiffness)] = 0.0
    plain = dataclasses.replace(bare, stiffness=left)
    damped = dataclasses.replace(damp_system(scene, plain), stiffness=bare.stiffness)
    modes = dataclasses.replace(modes, rigid_count=len(released.trains))
    return DrivenMachine(released.model, modes, damped, released.trains)


def check_loops(
    driven: DrivenMachine, warn: Callable[[str], None], *, continuous: bool = True
) -> LoopPoles:
    """Return the poles of loops that are run in time, and warn where controllers with a step differ.

    Args:
        warn: Called with how far the continuous loops are from the sampled ones.
        continuous: Whether these stand for them.

    Raises:
        UnstableControlError: A pole grows.
    """
    poles = require_stable(driven.system, driven.trains)
    sampled = compare_sampled(driven.system, driven.trains, poles)
    if sampled is not None and not sampled.stable:
        warn(f"control in pose {driven.released.pose.name}: {SAMPLED_GROWS}")
    elif sampled is not None and continuous and sampled.share > SAMPLING_SHARE:
        warn(
            f"controllers with a step act in continuous time here: the pole at {sampled.hz:.3g} Hz is {100.0 * sampled.share:.2g} % off"
            f" that of the sampled loop, others up to {sampled.up_to_hz:.4g} Hz less; a shorter step brings both together"
        )
    return poles


def drive_along(model: PoseModel, position: float, warn: Callable[[str], None]) -> DrivenMachine:
    """The machine at a place of a path, with its motors free and its loops stable.

    Args:
        position: From the start of the path [m].
        warn: Called with what is to be said of it.

    Raises:
        UnstableControlError: A pole grows.
    """
    driven = drive_machine(model, warn)
    try:
        check_loops(driven, warn)
    except UnstableControlError as error:
        raise UnstableControlError(
            f"{1e3 * position:.4g} mm along the path {error}",
            axis=error.axis,
            frequency_hz=error.frequency_hz,
        ) from error
    return driven


def find_driven_offsets(
    driven: DrivenMachine, travel: ErrorTravel, system: SecondOrderSystem
) -> OffsetMotions:
    """Return the motions under unit offsets of joints with the readings of linear scales constrained
    to zero, and the inertia of motors whose housings rotate.

    Args:
        system: Of the machine with free motors, with the damping that acts.

    Raises:
        ModelError: A scale cannot but be moved.
    """
    scene, coupled = driven.released.parts.scene, driven.coupled
    machine, drives = scene.machine, scene.drives.values()
    read = [drive for drive in drives if drive.control.encoder == SCALE]
    unmoved = scale_rows(coupled, machine, read)
    motions = find_offset_motions(coupled, travel, system, unmoved=unmoved)
    # of axes: what a joint moves of a leg turns the whole leg
    guided = np.array([drive.axis in machine.axes for drive in drives])
    rotations = np.zeros((len(guided), motions.moved.shape[1]))
    along = [drive for drive in drives if drive.axis in machine.axes]
    rotations[guided] = housing_rows(coupled, machine, along) @ motions.moved
    inertial = housing_loads(driven.trains, rotations, len(system.mass))
    return dataclasses.replace(motions, accelerations=motions.accelerations + inertial)


def run_control_stage(state: RunState, stage: Stage) -> Outcome:
    """Poles, margins and tracking error of the closed loops; an unstable one is a failure, and the
    run goes on.
    """
    if not state.is_root:
        return Outcome()
    request, pose = state.scene.analyses[ControlRequest], pose_name(stage)
    driven = drive_machine(pose_model(state), state.warn)
    trains = driven.trains
    loop = close_loops(driven.system, trains)
    poles = find_loop_poles(loop)
    if poles.limit_hz < request.up_to_hz:
        state.warn(
            f"control: poles are valid up to {poles.limit_hz:.4g} Hz only (dead time of the drives), and {request.up_to_hz:.4g} Hz"
            " are requested; lower up_to"
        )
    sampled = compare_sampled(driven.system, trains, poles)
    verdict = ""
    try:
        require_stable(driven.system, trains, loop, poles)
    except UnstableControlError as error:
        verdict = str(error)
        state.failures.append(f"control in pose {pose}: {error}")
    margins = find_margins(
        driven.system, trains, to_hz=MARGIN_REACH * request.up_to_hz, around_hz=poles.frequencies_hz
    )
    lags = {
        axis: find_velocity_lag(loop, axis)[0]
        for axis in dict.fromkeys(train.axis for train in trains)
    }
    drives = tuple(
        ClosedLoopDrive(train, item, _round_lag(train, lags[train.axis]) * request.speed)
        for train, item in zip(trains, margins, strict=True)
    )
    listed = list_poles(driven, poles, request.up_to_hz)
    answer = ControlAnswer(
        pose,
        request.up_to_hz,
        request.speed,
        listed,
        drives,
        verdict,
        sampled=sampled,
    )
    if sampled is not None and not (sampled.stable or verdict):
        state.failures.append(f"control in pose {pose}: {SAMPLED_GROWS}")
    last = (request.poses or tuple(state.plan.poses))[-1]
    followed = (
        _follow_guards(state, request, MARGIN_REACH * request.up_to_hz) if pose == last else ()
    )
    return Outcome(
        detail=f"{len(listed)} poles, {'unstable: see below' if verdict else 'stable'}",
        answers=(answer, *followed),
    )


def _round_lag(train: DriveTrain, lag: float) -> float:
    """Lag per speed [s]; zero where feed-forward leaves roundoff of what it takes off."""
    return lag if abs(lag) * (train.control.position_gain or 1.0) > ROUNDOFF else 0.0


@dataclass(frozen=True, eq=False)
class _Resonances:
    """Natural modes of a machine with free motors, as each motor meets them.

    Attributes:
        modes: Up to a frequency, those at rest first.
        losses: ``(m,)`` damping ratios of the elastic ones.
        heights: ``(n_drives, m)`` of their resonances over the response of the rigid machine to the
            force of a motor, infinite without damping.
    """

    model: PoseModel
    modes: ModalResult
    losses: FloatArray
    heights: FloatArray

    @functools.cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the elastic modes."""
        return self.model.name_modes(self.modes).names[self.modes.rigid_count :]

    @functools.cached_property
    def errors(self) -> tuple[Estimate, ...]:
        """Errors of their frequencies [Hz]."""
        return self.model.estimate_mode_errors(self.modes)[self.modes.rigid_count :]

    @property
    def frequencies_hz(self) -> FloatArray:
        """Of the elastic modes."""
        return self.modes.frequencies_hz[self.modes.rigid_count :]

    def select(self, drive: int) -> list[int]:
        """Return the elastic modes that a drive has to keep out of its loop, highest first."""
        heights = self.heights[drive]
        order = np.argsort(-heights, kind="stable")[:MOST_GUARDS]
        return [int(mode) for mode in order if heights[mode] > LEAST_HEIGHT]


def _find_resonances(driven: DrivenMachine, up_to_hz: float) -> _Resonances:
    """Find the natural frequencies that stand out of the response of each motor to its own force.

    A mode that moves the motor by phi peaks at ``phi^2 / (2 zeta omega^2)``, and the rigid machine moves
    by ``sum phi_rigid^2 / omega^2``: their ratio is the height of the resonance.
    """
    system, modes = driven.system, keep_lowest(driven.modes, up_to_hz=up_to_hz)
    rigid, elastic = slice(modes.rigid_count), slice(modes.rigid_count, None)
    omega, shapes = 2.0 * np.pi * modes.frequencies_hz[elastic], modes.shapes[:, elastic]
    losses = np.zeros(len(omega))
    for matrix, scale in ((system.damping, omega), (system.hysteretic, omega**2)):
        if matrix is not None:
            losses += np.einsum("ik,ij,jk->k", shapes, matrix, shapes) / (2.0 * scale)
    moved = output_rows(system, [(train.name, MOTOR) for train in driven.trains]) @ modes.shapes
    resting = np.maximum((moved[:, rigid] ** 2).sum(axis=1, keepdims=True), TINY)
    heights = moved[:, elastic] ** 2 / resting / (2.0 * np.maximum(losses, TINY))
    return _Resonances(driven.released, modes, losses, heights)


def _follow_guards(
    state: RunState, request: ControlRequest, up_to_hz: float
) -> tuple[GuardAnswer, ...]:
    """Follow the modes that any drive has to guard in any pose over all poses.

    Args:
        up_to_hz: How high guards are looked for [Hz].
    """
    sweep = None if request.sweep is None else state.scene.sweeps[request.sweep]
    poses = (
        [state.plan.poses[name] for name in request.poses or state.plan.poses]
        if sweep is None
        else [sweep_pose(sweep, number) for number in range(len(sweep.positions))]
    )
    found: list[_Resonances] = []
    taken, left_out = [], []
    for number, pose in enumerate(poses):
        try:
            driven = drive_machine(pose_machine(state.parts, pose), state.warn)
        except PoseError:
            left_out.append(pose.name)
            continue
        taken.append(number)
        found.append(_find_resonances(driven, up_to_hz))
    if not found:
        return ()
    neighbours = (
        itertools.combinations(range(len(found)), 2)
        if sweep is None
        else _number_neighbours(sweep, taken)
    )
    index = track_modes(_sweep_modes(found), [*neighbours]).index
    guards = [
        guard
        for number, drive in enumerate(state.scene.drives)
        for guard in _follow_modes(drive, number, index, found)
    ]
    answer = GuardAnswer(request.sweep or "", tuple(one for one, _ in guards), tuple(left_out))
    return (answer.with_errors({answer.guard_key(one): error for one, error in guards}, "replace"),)


def _number_neighbours(sweep: Sweep, taken: Sequence[int]) -> list[tuple[int, int]]:
    """Return the pairs of neighbours of a sweep, as places among the poses that are taken."""
    place = {number: row for row, number in enumerate(taken)}
    present = np.isin(np.arange(len(sweep.positions)), taken)
    return [(place[one], place[other]) for one, other in sweep_neighbours(sweep, present)]


def _sweep_modes(found: Sequence[_Resonances]) -> SweptModes:
    """Return the elastic modes of all poses with shapes whose products are kinetic energies."""
    most = max(len(pose.frequencies_hz) for pose in found)
    frequencies = np.full((len(found), most), np.nan)
    fields = []
    for row, pose in enumerate(found):
        count = len(pose.frequencies_hz)
        frequencies[row, :count] = pose.frequencies_hz
        shapes = _weigh_motions(pose.model, pose.modes.shapes[:, pose.modes.rigid_count :])
        lengths = np.maximum(np.linalg.norm(shapes, axis=0), TINY)
        fields.append(np.pad(shapes / lengths, ((0, 0), (0, most - count))))
    counts = np.array([len(pose.frequencies_hz) for pose in found])
    return SweptModes(
        frequencies, np.array(fields, dtype=np.float32), counts, np.zeros_like(counts)
    )


def _weigh_motions(model: PoseModel, motions: FloatArray) -> FloatArray:
    """Return motions ``(n, m)`` as ``(k, m)`` in the axes of components, times the root of their mass:
    the same rows in every pose.
    """
    stacked, rows = model.expand(motions), []
    for name, dofs in model.offsets.items():
        part, placement = model.parts.superelements[name], model.placements[name]
        # a lumped body moves about its centre of mass
        lumped = model.coupled is None
        turned = rotate_dofs(placement.rotation.T) if lumped else turn_dofs(part, placement)
        bare = scipy.linalg.block_diag(part.mass_kg * np.eye(3), part.inertia)
        levels, vectors = np.linalg.eigh(bare if lumped else 0.5 * (part.mass + part.mass.T))
        root = np.sqrt(np.maximum(levels, 0.0))[:, None] * vectors.T
        rows.append(root @ turned @ stacked[dofs])
    return np.vstack(rows)


def _follow_modes(
    drive: str, number: int, index: NDArray[np.int64], found: Sequence[_Resonances]
) -> Iterator[tuple[GuardFrequency, Estimate]]:
    """Yield the modes that a drive has to guard in any pose, with their ±, in every pose in which they
    are; the highest resonance first.

    Args:
        number: Of the drive.
        index: ``(n, t)`` which of a pose's modes each tracked mode is; -1 where it is none.
    """
    tracks = []
    for modes in index.T:
        met = [(found[row], int(modes[row])) for row in np.flatnonzero(modes >= 0)]
        if any(mode in pose.select(number) for pose, mode in met):
            heights = [float(pose.heights[number, mode]) for pose, mode in met]
            tracks.append((heights, met))
    tracks.sort(key=lambda track: -max(track[0]))
    for place, (heights, met) in enumerate(tracks, 1):
        highest, named = met[heights.index(max(heights))]
        for pose, mode in met:
            at, loss = pose.model.pose, float(pose.losses[mode])
            height = float(pose.heights[number, mode]) if loss > TINY else None
            hz, name = float(pose.frequencies_hz[mode]), highest.names[named]
            guard = GuardFrequency(drive, place, at.name, at.positions, hz, loss, height, name)
            yield guard, pose.errors[mode]


def list_poles(
    driven: DrivenMachine, poles: LoopPoles, up_to_hz: float
) -> tuple[ClosedLoopPole, ...]:
    """Poles up to a frequency, oscillating or not, and all that grow, with what moves in them."""
    shown = [int(i) for i in np.flatnonzero(np.abs(poles.poles) <= 2.0 * math.pi * up_to_hz)]
    shown += [index for index in poles.growing() if index not in shown]
    wanted = max((poles.modes[i] for i in shown), default=-1) + 1
    modes = driven.modes
    kept = dataclasses.replace(
        modes,
        frequencies_hz=modes.frequencies_hz[:wanted],
        shapes=modes.shapes[:, :wanted],
        residuals=modes.residuals[:wanted],
    )
    names = driven.released.name_modes(kept).names
    listed = []
    for index in shown:
        mode, pole = poles.modes[index], poles.poles[index]
        controlled = poles.frequencies_hz[index] == 0.0 or mode < modes.rigid_count
        listed.append(
            ClosedLoopPole(
                complex(pole),
                frequency_hz=float(poles.frequencies_hz[index]),
                damping_ratio=float(poles.damping_ratios[index]),
                drive=poles.drives[index],
                name=f"control of {poles.drives[index]}" if controlled else names[mode],
            )
        )
    return tuple(listed)
