"""The input of the solvers of a path: instants, travels of axes and points, and the cut as loads;
and their output: moves before any filter.
"""

import dataclasses
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import DIRECTIONS, DOF_NAMES, FloatArray
from headstock.geometry.machine.machine import Machine
from headstock.pipeline.answers.motion_forces import PathForces, ProbeMotion
from headstock.pipeline.answers.path import FollowedPoses
from headstock.pipeline.motion.motion_forces import largest_joint_forces, watch_joints
from headstock.pipeline.motion.probe_motions import (
    place_probes,
    probe_outputs,
    read_probes,
    smoothing_channels,
    watch_probes,
)
from headstock.pipeline.planning.analyses import MODE_MARGIN
from headstock.pipeline.planning.budgets import PATH_STEPS_PER_TURN
from headstock.pipeline.stages.machine import CoupledPose
from headstock.pipeline.stages.run_state import PoseModel, RunState
from headstock.reduction.coupling.coupling import couple
from headstock.reduction.coupling.joint_forces import SPRING, JointForces, joint_outputs
from headstock.reduction.coupling.path_loads import PATH_INPUT
from headstock.reduction.coupling.probes import PlacedProbe
from headstock.scene.analyses.path import PathCut, PathRequest
from headstock.solvers.errors import ModelError
from headstock.solvers.milling.forces import cutting_forces, part_sign
from headstock.solvers.motion.deviation import PathDeviation
from headstock.solvers.motion.exact import PathModel
from headstock.solvers.motion.set_points import PathLoads, SetPoint, sample_times
from headstock.solvers.second_order import Channel, SecondOrderSystem
from headstock.solvers.watched_outputs import Extreme, Watch


def choose_model(request: PathRequest) -> PathModel:
    """Return the model of a path's deviation; modes with periods longer than a ramp count as
    low-frequency motion, which does not follow the ramp.
    """
    return PathModel(
        PATH_INPUT,
        request.outputs,
        1.0 / request.moves[0].ramp.time_constant,
        MODE_MARGIN * request.band_hz,
    )


def sample_path(request: PathRequest, move: SetPoint) -> FloatArray:
    """Return the instants at which a move is evaluated [s]."""
    return sample_times(move, request.sampling_hz, request.residual_time)


def couple_at(state: RunState, request: PathRequest, position: float) -> CoupledPose:
    """Couple the machine at a position of the path [m]."""
    pose = request.path.pose_at(position)
    coupled = couple(state.parts.superelements, state.scene.machine, pose)
    return CoupledPose(state.parts, pose, coupled)


def axis_shares(request: PathRequest) -> dict[str, float]:
    """Return the travel of each axis per travel along the path."""
    start, end = request.path.start.positions, request.path.end.positions
    return {
        axis: (end.get(axis, 0.0) - start.get(axis, 0.0)) / request.path.length
        for axis in request.path.axes
    }


def travel_of_channel(
    machine: Machine, directions: Mapping[str, FloatArray], *, name: str, dof: str
) -> float:
    """Return the rigid motion of a point or sensor per travel along a path, in one direction; zero in
    rotations, as linear axes do not rotate.
    """
    if dof not in DIRECTIONS:
        return 0.0
    rest = np.zeros(3)
    if name in machine.sensors:
        sensor = machine.sensors[name]
        # linear axes leave a component turned as it is with all of them at zero
        units = sensor.turn_directions(machine.components[sensor.component].placement.rotation)
        return float(
            units[list(sensor.directions).index(dof)] @ directions.get(sensor.component, rest)
        )
    if name not in machine.points:
        return float(directions.get(name.partition(".")[0], rest)[DOF_NAMES.index(dof)])
    point = machine.points[name]
    tool, work = (directions.get(end.component or "", rest) for end in (point.tool, point.work))
    return float((tool - work)[DOF_NAMES.index(dof)])


def path_loads(
    machine: Machine, directions: Mapping[str, FloatArray], cut: PathCut | None
) -> PathLoads | None:
    """Return the cut as loads on the tool, in machine axes; None without one.

    Raises:
        ModelError: The tool does not move normal to its axis.
    """
    if cut is None:
        return None
    travel = [travel_of_channel(machine, directions, name=cut.at, dof=dof) for dof in DIRECTIONS]
    (frame,), (size,) = orient_cut(cut, np.array([travel]), np.array([cut.up]))
    return PathLoads(
        tuple((cut.at, dof) for dof in DIRECTIONS),
        lambda times, speeds: cutting_forces(cut.cut, times, size * speeds) @ frame,
        2.0 * math.pi / cut.cut.spindle / PATH_STEPS_PER_TURN,
    )


def orient_cut(
    request: PathCut, travels: FloatArray, ups: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the axes ``(n, 3, 3)`` of cutting forces, along the travel, away from the part and
    along the tool, in machine axes; and the travel ``(n,)`` of the tool normal to its axis per
    travel along the path.

    Args:
        travels: ``(n, 3)`` travel of the tool relative to its workpiece per travel along the path.
        ups: ``(n, 3)`` directions of the tool axis.

    Raises:
        ModelError: The tool does not move normal to its axis.
    """
    along = travels - (travels * ups).sum(axis=1, keepdims=True) * ups
    sizes = np.linalg.norm(along, axis=1)
    if sizes.min() < 1e-9:
        raise ModelError(
            f"the path does not move {request.at} across the tool, so nothing is milled; write another path or `up`"
        )
    along = along / sizes[:, None]
    return np.stack([along, part_sign(request.part) * np.cross(ups, along), ups], axis=1), sizes


@dataclass(frozen=True, eq=False)
class SolvedMove:
    """Store a solved move.

    Attributes:
        deviation: Deviation by acceleration and cutting forces, without disturbances.
        total: Deviation with guide errors and torque ripple added.
    """

    deviation: PathDeviation
    total: PathDeviation
    forces: PathForces


SolveMove = Callable[[SetPoint], SolvedMove]


@dataclass(frozen=True, eq=False)
class PosedMoves:
    """Solve moves of a path along which the pose changes.

    Attributes:
        poses: How the poses were sampled.
        truncation: The last move in the pose of the middle: without the modes that are left out along
            the path, and with them.
    """

    solve: SolveMove
    poses: FollowedPoses
    truncation: tuple[PathDeviation, PathDeviation]


@dataclass(frozen=True, eq=False)
class SolvedMoves:
    """Store deviations before any filter, one per feed.

    Attributes:
        forces: One per feed; joint forces are those in the pose at mid-path.
        poses: How the poses of the path were sampled; None in a frozen pose.
        disturbed: The deviations include guide errors or torque ripple.
    """

    moves: tuple[PathDeviation, ...]
    kept: tuple[PathDeviation, ...]
    forces: tuple[PathForces, ...]
    poses: FollowedPoses | None = None
    disturbed: bool = False


@dataclass(frozen=True, eq=False)
class PathObservers:
    """Observe joints and probes of a machine at the middle of a path.

    Attributes:
        joints: Whose forces are watched.
        probes: Where displacement and stress are watched.
        outputs: Output to its row ``(n,)``.
    """

    joints: tuple[JointForces, ...]
    probes: dict[str, PlacedProbe]
    outputs: dict[Channel, FloatArray]

    @property
    def watch(self) -> Watch:
        """Outputs that are watched during a motion."""
        probes = watch_probes(self.probes).join(Watch(smoothing_channels(self.probes)))
        return watch_joints(self.joints).join(probes)

    def join(self, system: SecondOrderSystem) -> SecondOrderSystem:
        """Return the system with these outputs added."""
        return dataclasses.replace(system, outputs=system.outputs | self.outputs)

    def read(
        self, deviation: PathDeviation, travel: FloatArray, amounts: FloatArray
    ) -> tuple[dict[str, dict[str, Extreme]], dict[str, ProbeMotion]]:
        """Return the largest joint forces of a move, and the outputs of probes.

        Args:
            deviation: Deviation of the move, with these outputs watched.
            travel: ``(9 p,)`` outputs of probes per unit of the rigid motion that is subtracted.
            amounts: ``(n,)`` that rigid motion: a travel or an acceleration.
        """
        watched = deviation.watched
        forces = largest_joint_forces(
            self.joints, deviation.times, lambda joint: watched.of(joint.channels(SPRING))
        )
        observed = watched.of(watch_probes(self.probes).channels) - np.outer(amounts, travel)
        smoothed = watched.of(smoothing_channels(self.probes))
        return forces, read_probes(self.probes, deviation.times, observed, smoothed)


def observe_path(state: RunState, model: PoseModel) -> PathObservers:
    """Find joints and probes of a machine in the middle of a path."""
    probes = place_probes(state.parts, model.coupled, tuple(state.scene.machine.probes))
    outputs = joint_outputs(model.joints) | probe_outputs(state.parts, probes)
    return PathObservers(model.joints, probes, outputs)
