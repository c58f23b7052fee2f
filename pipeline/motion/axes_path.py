"""Deviation of a machine from a straight path of its linear axes, with motors that follow their set
points exactly or under control, in one pose or with the pose changing along the path, and with
guide errors and torque ripple. Control loops are checked for stability before any time integration.
"""

import dataclasses
import functools
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.geometry.machine.drives import Drive, ripple_force
from headstock.geometry.machine.machine import travel_directions
from headstock.pipeline.answers.motion_forces import DriveHistory, PathForces, ProbeMotion
from headstock.pipeline.answers.path import FollowedPoses
from headstock.pipeline.motion.motion_forces import record_drives, watch_drives
from headstock.pipeline.motion.path_model import (
    PathObservers,
    PosedMoves,
    SolvedMove,
    SolveMove,
    axis_shares,
    choose_model,
    couple_at,
    observe_path,
    path_loads,
    sample_path,
    travel_of_channel,
)
from headstock.pipeline.motion.probe_motions import probe_values
from headstock.pipeline.motion.trajectory import coupled_machine
from headstock.pipeline.stages.control import (
    DrivenMachine,
    check_loops,
    drive_along,
    drive_machine,
    find_driven_offsets,
)
from headstock.pipeline.stages.machine import CoupledPose, damp_system, warn_of_no_damping
from headstock.pipeline.stages.run_state import PoseModel, RunState
from headstock.reduction.coupling.coupling import couple
from headstock.reduction.coupling.error_travel import (
    ErrorTravel,
    OffsetMotions,
    find_offset_motions,
)
from headstock.reduction.coupling.path_loads import (
    PATH_INPUT,
    add_driven_path_input,
    add_path_input,
    find_rigid_travels,
    stack_driven_modes,
    stack_modes,
)
from headstock.reduction.coupling.probes import travel_inertia
from headstock.reduction.estimates.static_errors import SEEN
from headstock.reduction.motions.path_errors import (
    STEPS_PER_WAVE,
    PathErrors,
    add_error_inputs,
    find_path_errors,
    pass_offsets,
)
from headstock.scene.analyses.path import PathRequest
from headstock.solvers.control.drive_loops import ENCODER, close_loops
from headstock.solvers.control.drive_trains import FORCE
from headstock.solvers.linear.modal_analysis import solve_modal
from headstock.solvers.motion.closed_loop import (
    ControlledPath,
    VaryingLoop,
    loop_channels,
    make_loop_table,
    solve_controlled_path,
    solve_path_with_friction,
    solve_varying_control,
    solve_varying_friction,
)
from headstock.solvers.motion.deviation import PathDeviation
from headstock.solvers.motion.driven_motion import DrivenMotion
from headstock.solvers.motion.exact import (
    Disturbance,
    PathModel,
    StepTable,
    make_step_table,
    solve_loads,
    solve_loop_loads,
    solve_path,
    solve_varying_path,
)
from headstock.solvers.motion.friction_loop import friction_channels
from headstock.solvers.motion.plant import PosedModes, VaryingSystem
from headstock.solvers.motion.sampling import sample_plant, sample_system
from headstock.solvers.motion.set_points import (
    PathLoads,
    SetPoint,
    cut_times,
    load_channels,
    sample_move,
)
from headstock.solvers.second_order import Channel, SecondOrderSystem
from headstock.solvers.state_spaces.state_space import Feedthrough
from headstock.solvers.watched_outputs import Extreme, Watch

ENERGY_LIMIT = 1e-6
# modes up to this multiple of the frequency band are states of the loop, the others act statically;
# fewer with friction, whose steps take all states together, or if interpolated along the path
LINEAR_REACH, FRICTION_REACH, VARYING_REACH = 12.0, 3.0, 3.0


SolveDeviation = Callable[[SetPoint], PathDeviation]
# largest forces by joint and direction, and motions of probes
Observed = tuple[dict[str, dict[str, Extreme]], dict[str, ProbeMotion]]


@dataclass(frozen=True, eq=False)
class AxesPath(ABC):
    """Solve the moves of a machine whose linear axes travel along a straight path.

    Attributes:
        error_nodes: Number of poses between which static deviations by guide errors are
            interpolated.
    """

    state: RunState
    request: PathRequest
    error_nodes: int

    @functools.cached_property
    def model(self) -> PathModel:
        """The model of the deviation, with the loads of the cut."""
        return dataclasses.replace(choose_model(self.request), loads=self.loads)

    @functools.cached_property
    def middle(self) -> CoupledPose:
        """The machine in the pose at the middle of the path."""
        return couple_at(self.state, self.request, 0.5 * self.request.path.length)

    @functools.cached_property
    def plant(self) -> PosedModes:
        """The machine with ideal motors at the middle of the path."""
        return self.build_plant(0.5 * self.request.path.length)

    def build_plant(self, position: float) -> PosedModes:
        """Return the machine with ideal motors at a position of the path [m], damped as the scene
        says, with the acceleration along the path as an input.
        """
        scene, pose = self.state.scene, self.request.path.pose_at(position)
        coupled = couple(self.state.parts.superelements, scene.machine, pose)
        modes = solve_modal(coupled.system)
        for message in warn_of_no_damping(scene, coupled.system):
            self.state.warn(message)
        damped = damp_system(scene, coupled.system, modes)
        return stack_modes(add_path_input(damped, coupled, self.directions), modes, coupled)

    @property
    def _step(self) -> float:
        """Time step that resolves the loads between two samples [s]."""
        fine, _ = cut_times(sample_path(self.request, self.request.moves[0]), self.loads)
        return float(fine[1] - fine[0])

    @property
    def frequencies_hz(self) -> FloatArray:
        """Natural frequencies at the middle of the path [Hz]."""
        return self.plant.modes.frequencies_hz

    @property
    def damped(self) -> bool:
        """True where anything damps the machine."""
        return self.plant.system.damping is not None or self.plant.system.hysteretic is not None

    @functools.cached_property
    def directions(self) -> dict[str, FloatArray]:
        """Velocity ``(3,)`` of every component that travels, per speed along the path."""
        return travel_directions(self.state.scene.machine, self.request.path)

    @functools.cached_property
    def loads(self) -> PathLoads | None:
        """Cutting forces; None without a cut."""
        return path_loads(self.state.scene.machine, self.directions, self.request.cut)

    @functools.cached_property
    def errors(self) -> PathErrors | None:
        """Guide errors along the path; None where there are none."""
        return find_path_errors(
            self.state.parts.superelements,
            self.state.scene.machine,
            self.request.path,
            self.request.outputs,
            nodes=self.error_nodes,
        )

    @functools.cached_property
    def rippling(self) -> list[Drive]:
        """Drives with torque ripple."""
        return [drive for drive in self.state.scene.drives.values() if drive.ripple]

    @property
    def disturbed(self) -> bool:
        """True where guide errors or torque ripple act."""
        return self.errors is not None or bool(self.rippling)

    @functools.cached_property
    def disturbances(self) -> dict[SetPoint, PathDeviation | None]:
        """Deviations by guide errors and torque ripple on every move, relative to the beginning of
        the move, in the pose at the middle of the path.
        """
        return {
            move: self._disturb(move) if self.disturbed else None for move in self.request.moves
        }

    @property
    @abstractmethod
    def machine(self) -> PoseModel:
        """The machine at the middle of the path, its motors locked or free."""

    @property
    @abstractmethod
    def system(self) -> SecondOrderSystem:
        """Equations of motion of that machine, with damping."""

    @functools.cached_property
    def observers(self) -> PathObservers:
        """Joints and probes of that machine."""
        return observe_path(self.state, self.machine)

    @abstractmethod
    def _solve_frozen(self) -> SolveDeviation:
        """Return a function that solves a move in the pose at mid-path, without disturbances."""

    @abstractmethod
    def _solve_posed(self) -> tuple[SolveDeviation, VaryingSystem, StepTable]:
        """Return a function that solves a move as the pose changes, without disturbances; with the
        machine along the path and its time steps.
        """

    @abstractmethod
    def _truncate(self, kept: PathDeviation) -> tuple[PathDeviation, PathDeviation]:
        """Return the last move in the pose at mid-path: without the modes that are left out along
        the path, and with them.
        """

    @abstractmethod
    def _disturb(self, move: SetPoint) -> PathDeviation:
        """Return the deviation by guide errors and torque ripple on a move, at mid-path."""

    def _find_offset_motions(self, travel: ErrorTravel, system: SecondOrderSystem) -> OffsetMotions:
        """Return the motions of the machine under unit offsets of its guides."""
        return find_offset_motions(self.middle.coupled, travel, system)

    @functools.cached_property
    def _error_inputs(self) -> tuple[SecondOrderSystem, tuple[Channel, ...], Feedthrough | None]:
        """Return the system with guide errors as inputs and observed outputs, the channels of these
        inputs, and their direct feedthrough.
        """
        observers, errors = self.observers, self.errors
        system = observers.join(self.system)
        if errors is None:
            return system, (), None
        motions = self._find_offset_motions(errors.travel, system)
        feedthrough = pass_offsets(
            coupled_machine(self.machine),
            errors.travel,
            motions,
            self.request.outputs,
            observers.joints,
            probe_values(observers.probes),
        )
        return *add_error_inputs(system, errors.travel, motions), feedthrough

    def _load_by_errors(self, move: SetPoint) -> Disturbance:
        """Return guide errors, then torque ripple, as loads during a move."""
        errors, (_, channels, feedthrough) = self.errors, self._error_inputs

        def loads(times: FloatArray) -> FloatArray:
            positions = sample_move(move, times).positions
            parts = [] if errors is None else [errors.amounts(move, times)]
            return np.hstack([*parts, *(self._ripple(each, positions) for each in self.rippling)])

        step = self._shortest_wave / move.feed / STEPS_PER_WAVE
        ripple = ((drive.name, FORCE) for drive in self.rippling)
        return Disturbance((*channels, *ripple), loads, step, feedthrough)

    def _ripple(self, drive: Drive, positions: FloatArray) -> FloatArray:
        """Return the force ``(n, 1)`` of a drive by its torque ripple at ``(n,)`` positions along
        the path, less that at the beginning [N].
        """
        start = self.request.path.start.positions.get(drive.axis, 0.0)
        share = axis_shares(self.request).get(drive.axis, 0.0)
        force = ripple_force(drive, start + share * positions)
        return (force - ripple_force(drive, np.array([start])))[:, None]

    @property
    def _shortest_wave(self) -> float:
        """Shortest wavelength of guide errors and torque ripple [m]; infinite without any."""
        shares = axis_shares(self.request)
        ripples = [
            drive.lead / wave.per_turn / abs(shares[drive.axis])
            for drive in self.rippling
            if shares.get(drive.axis)
            for wave in drive.ripple
        ]
        return min([math.inf if self.errors is None else self.errors.shortest, *ripples])

    @abstractmethod
    def _observe(self, move: SetPoint, total: PathDeviation) -> Observed:
        """Return the largest forces of joints during a move, and the outputs of probes."""

    def _record_drives(
        self, move: SetPoint, total: PathDeviation, *, along: bool = False
    ) -> DriveHistory:
        """Return forces, torques and position errors of drives during a move, solved with the pose
        changing (``along``) or frozen at mid-path.
        """
        none = np.zeros((len(total.times), 0))
        return record_drives((), total.times, none, none)

    def freeze(self) -> SolveMove:
        """Return a function that solves a move in the pose at the middle of the path."""
        disturbances, solve = self.disturbances, self._solve_frozen()

        def solve_move(move: SetPoint) -> SolvedMove:
            deviation = solve(move)
            total = _add(deviation, disturbances[move])
            forces = PathForces(self._record_drives(move, total), *self._observe(move, total))
            return SolvedMove(deviation, total, forces)

        return solve_move

    def add_errors(self, move: SetPoint, deviation: PathDeviation) -> PathDeviation:
        """Return a deviation with torque ripple, and with guide errors as they deform the machine
        in the poses along the path, whatever pose the deviation was solved in.
        """
        disturbance = self.disturbances[move]
        if disturbance is not None and self.errors is not None:
            disturbance = self.errors.follow_pose(disturbance, move)
        return _add(deviation, disturbance)

    def follow(self, kept: Sequence[SolvedMove]) -> PosedMoves:
        """Return a function that solves a move as the pose changes along the path."""
        solve, system, table = self._solve_posed()

        def solve_move(move: SetPoint) -> SolvedMove:
            deviation = solve(move)
            total = self.add_errors(move, deviation)
            return SolvedMove(
                deviation, total, PathForces(self._record_drives(move, total, along=True), {})
            )

        poses = FollowedPoses(
            sampled_poses=len(system.positions),
            error=system.error,
            rotation_error=system.rotation_error,
            modes=len(system.scales),
            next_hz=None if np.isinf(system.next_hz) else system.next_hz,
            steps=len(table.spline.x),
            truncation=0.0,
            effect=(),
        )
        return PosedMoves(solve_move, poses, self._truncate(kept[-1].deviation))


class IdealAxes(AxesPath):
    """Solve moves of axes whose motors follow their set points exactly, so that only structural
    deformation by acceleration and cutting forces deviates from the path.
    """

    @property
    def machine(self) -> PoseModel:
        """The machine with its motors locked."""
        return self.middle

    @property
    def system(self) -> SecondOrderSystem:
        """Equations of motion with the acceleration along the path as an input."""
        return self.plant.system

    def _solve_frozen(self) -> SolveDeviation:
        model = dataclasses.replace(self.model, up_to_hz=None, watched=self.observers.watch)
        system = self.observers.join(self.system)
        return lambda move: solve_path(system, model, move, sample_path(self.request, move))

    def _solve_posed(self) -> tuple[SolveDeviation, VaryingSystem, StepTable]:
        request, model = self.request, self.model
        along = sample_system(self.build_plant, request.path.length, model)
        table = make_step_table(along, self._step)
        return (
            lambda move: solve_varying_path(along, model, move, sample_path(request, move), table),
            along,
            table,
        )

    def _truncate(self, kept: PathDeviation) -> tuple[PathDeviation, PathDeviation]:
        move = self.request.moves[-1]
        samples = sample_path(self.request, move)
        return solve_path(self.system, self.model, move, samples), kept

    def _disturb(self, move: SetPoint) -> PathDeviation:
        return solve_loads(
            self._error_inputs[0],
            self.request.outputs,
            self._load_by_errors(move),
            samples=sample_path(self.request, move),
            low_frequency_limit_hz=self.model.low_frequency_limit_hz,
            watch=self.observers.watch,
        )

    def _observe(self, move: SetPoint, total: PathDeviation) -> Observed:
        probes, coupled = self.state.scene.machine.probes, self.middle.coupled
        carried = [
            travel_inertia(coupled, probes[name], self.directions[probe.component])
            if probe.component in self.directions
            else np.zeros(SEEN)
            for name, probe in self.observers.probes.items()
        ]
        accelerations = sample_move(move, total.times).accelerations
        return self.observers.read(total, np.concatenate([np.zeros(0), *carried]), accelerations)


class DrivenAxes(AxesPath):
    """Solve moves of axes whose motors are under control."""

    @functools.cached_property
    def driven(self) -> DrivenMachine:
        """The machine with its motors free at the middle of the path."""
        return drive_machine(self.middle, self.state.warn)

    @property
    def machine(self) -> PoseModel:
        """The machine with its motors free."""
        return self.driven.released

    @property
    def system(self) -> SecondOrderSystem:
        """Equations of motion with the forces of drives as inputs."""
        return self.driven.system

    @functools.cached_property
    def drives(self) -> tuple[Drive, ...]:
        """All drives of the scene."""
        return tuple(self.state.scene.drives.values())

    @property
    def has_friction(self) -> bool:
        """True where guides have friction."""
        return bool(friction_channels(self.driven.trains))

    def _close_loops(self, reach: float) -> ControlledPath:
        """Return the closed loops of the drives at the middle of the path.

        Args:
            reach: Modes up to this multiple of the frequency band are states.

        Raises:
            UnstableControlError: A loop has a growing pole.
        """
        request, driven, observers = self.request, self.driven, self.observers
        check_loops(driven, self.state.warn)
        machine, directions = self.state.scene.machine, self.directions
        travel = [
            travel_of_channel(machine, directions, name=name, dof=dof)
            for name, dof in request.outputs
        ]
        return ControlledPath(
            loop=close_loops(
                observers.join(self.system),
                driven.trains,
                inputs=(*load_channels(self.loads), *friction_channels(driven.trains)),
                outputs=(*request.outputs, *observers.outputs),
                up_to_hz=reach * request.band_hz,
            ),
            outputs=request.outputs,
            shares=axis_shares(request),
            travel=np.array(travel),
            low_frequency_limit_hz=self.model.low_frequency_limit_hz,
            loads=self.loads,
            watched=self._watch,
        )

    def _solve_frozen(self) -> SolveDeviation:
        path = self._close_loops(FRICTION_REACH if self.has_friction else LINEAR_REACH)

        def solve(move: SetPoint) -> PathDeviation:
            samples = sample_path(self.request, move)
            if not self.has_friction:
                return solve_controlled_path(path, move, samples)
            return self._balance(move, *solve_path_with_friction(path, move, samples))

        return solve

    def _balance(
        self, move: SetPoint, deviation: PathDeviation, motion: DrivenMotion
    ) -> PathDeviation:
        """Return the deviation over a move with friction, and warn where energy is not balanced."""
        if motion.energy.error > ENERGY_LIMIT:
            self.state.warn(
                f"path analysis at {move.name}: the energy balance misses {motion.energy.error:.2g} of the work, more than"
                f" {ENERGY_LIMIT:g}; give friction a larger smoothing"
            )
        self.state.energy_errors[move.name] = motion.energy.error
        return deviation

    @functools.cached_property
    def _along(self) -> VaryingLoop:
        """The closed loops as the pose changes, checked for stability in every sampled pose.

        Raises:
            UnstableControlError: A loop has a growing pole in one of these poses.
        """
        state, request, directions = self.state, self.request, self.directions
        trains = self.driven.trains
        travels = find_rigid_travels(self.middle.coupled, trains, directions, axis_shares(request))
        channels = loop_channels(
            trains,
            path=PATH_INPUT,
            loads=load_channels(self.loads),
            outputs=request.outputs,
            up_to_hz=VARYING_REACH * request.band_hz,
        )

        def build(position: float) -> PosedModes:
            driven = drive_along(couple_at(state, request, position), position, state.warn)
            system = add_driven_path_input(
                driven.system, driven.coupled, driven.trains, directions, travels
            )
            return stack_driven_modes(system, driven.modes, driven.coupled, driven.trains)

        return VaryingLoop(
            plant=sample_plant(build, request.path.length, channels),
            path=PATH_INPUT,
            outputs=request.outputs,
            trains=trains,
            travels=travels,
            low_frequency_limit_hz=self.model.low_frequency_limit_hz,
            loads=self.loads,
            watched=watch_drives(self.drives).channels,
        )

    def _solve_posed(self) -> tuple[SolveDeviation, VaryingSystem, StepTable]:
        loop = self._along
        table = make_loop_table(loop, self._step)

        def solve(move: SetPoint) -> PathDeviation:
            samples = sample_path(self.request, move)
            if not self.has_friction:
                return solve_varying_control(loop, move, samples, table)
            return self._balance(move, *solve_varying_friction(loop, move, samples, table))

        return solve, loop.plant, table.steps

    def _truncate(self, kept: PathDeviation) -> tuple[PathDeviation, PathDeviation]:
        move = self.request.moves[-1]
        samples = sample_path(self.request, move)
        whole, short = (
            solve_controlled_path(self._close_loops(reach), move, samples)
            for reach in (LINEAR_REACH, VARYING_REACH)
        )
        return short, whole

    @property
    def _watch(self) -> Watch:
        """Outputs of joints, probes and drives."""
        return self.observers.watch.join(watch_drives(self.drives))

    def _find_offset_motions(self, travel: ErrorTravel, system: SecondOrderSystem) -> OffsetMotions:
        return find_driven_offsets(self.driven, travel, system)

    def _disturb(self, move: SetPoint) -> PathDeviation:
        if self.has_friction:
            self.state.warn(
                "path analysis: errors of guides and torque ripple move the machine as if there were no friction; what friction does is added"
            )
        outputs, loads = self.request.outputs, self._load_by_errors(move)
        loop = close_loops(
            self._error_inputs[0],
            self.driven.trains,
            inputs=loads.channels,
            outputs=(*outputs, *self.observers.outputs),
            up_to_hz=LINEAR_REACH * self.request.band_hz,
        )
        samples = sample_path(self.request, move)
        return solve_loop_loads(loop.space, outputs, loads, samples=samples, watch=self._watch)

    def _observe(self, move: SetPoint, total: PathDeviation) -> Observed:
        travels = [
            np.pad(self.directions.get(probe.component, np.zeros(3)), (0, SEEN - 3))
            for probe in self.observers.probes.values()
        ]
        positions = sample_move(move, total.times).positions
        return self.observers.read(total, np.concatenate([np.zeros(0), *travels]), positions)

    def _record_drives(
        self, move: SetPoint, total: PathDeviation, *, along: bool = False
    ) -> DriveHistory:
        forces, read = (
            total.watched.of((drive.name, what) for drive in self.drives)
            for what in (FORCE, ENCODER)
        )
        # along the changing pose a controller reads the deviation from the rigid machine
        shares = (
            [travel.axis - travel.encoder for travel in self._along.travels]
            if along
            else [axis_shares(self.request).get(train.axis, 0.0) for train in self.driven.trains]
        )
        positions = sample_move(move, total.times).positions
        return record_drives(self.drives, total.times, forces, np.outer(positions, shares) - read)


def _add(deviation: PathDeviation, disturbance: PathDeviation | None) -> PathDeviation:
    """Return a deviation plus that by disturbances, where there are any."""
    return deviation if disturbance is None else deviation + disturbance
