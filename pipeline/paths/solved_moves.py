"""Moves of a path as solved, before any filter: what joints and probes took on them, and what following
the poses changed.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.pipeline.answers.motion_forces import PathForces
from headstock.pipeline.answers.path import FollowedPoses
from headstock.pipeline.answers.probe_motions import ProbeMotion
from headstock.pipeline.stages.motion_forces import largest_joint_forces, watch_joints
from headstock.pipeline.stages.probe_motions import (
    place_probes,
    probe_outputs,
    read_probes,
    smoothing_channels,
    watch_path_probes,
    watch_probes,
)
from headstock.pipeline.stages.run_state import PoseModel, RunState
from headstock.reduction.coupling.joint_forces import SPRING, JointForces, joint_outputs
from headstock.reduction.coupling.probes import PlacedProbe
from headstock.scene.analyses.path import PathRequest
from headstock.solvers.paths.response import PathDeviation, filter_deviation
from headstock.solvers.paths.varying_response import StepTable
from headstock.solvers.paths.varying_system import VaryingSystem
from headstock.solvers.second_order import Channel, SecondOrderSystem
from headstock.solvers.watched_outputs import Extreme, Watch


@dataclass(frozen=True, eq=False)
class SolvedMoves:
    """Deviations before any filter, one per feed.

    Attributes:
        forces: One per feed; of joints those in the pose of the middle.
        poses: How the poses of the path were followed; None where they were not.
        disturbed: Errors of guides or torque ripple are among what deviates.
    """

    found: tuple[PathDeviation, ...]
    kept: tuple[PathDeviation, ...]
    forces: tuple[PathForces, ...]
    poses: FollowedPoses | None = None
    disturbed: bool = False


def add_watched(found: PathDeviation, disturbed: PathDeviation | None) -> PathDeviation:
    """Return a move with what disturbances add to what it watches; None for no disturbances."""
    if disturbed is None:
        return found
    return dataclasses.replace(found, watched=found.watched + disturbed.watched)


@dataclass(frozen=True, eq=False)
class PathObservers:
    """Joints and probes of a machine in the middle of a path.

    Attributes:
        joints: Whose forces are watched.
        probes: Where displacement and stress are watched.
        outputs: Rows ``(n,)`` of what they take of a motion.
    """

    joints: tuple[JointForces, ...]
    probes: dict[str, PlacedProbe]
    outputs: dict[Channel, FloatArray]

    @property
    def watch(self) -> Watch:
        """What is watched of a motion."""
        return watch_joints(self.joints).join(watch_path_probes(self.probes))

    def join(self, system: SecondOrderSystem) -> SecondOrderSystem:
        """Return the system with their outputs."""
        return dataclasses.replace(system, outputs=system.outputs | self.outputs)

    def read(
        self, found: PathDeviation, travel: FloatArray, amounts: FloatArray
    ) -> tuple[dict[str, dict[str, Extreme]], dict[str, ProbeMotion]]:
        """Return what joints took at most on a move, and what probes saw.

        Args:
            found: The move, which watched them.
            travel: ``(9 p,)`` what probes see of a unit of the travel that is none of the deviation.
            amounts: ``(n,)`` of that.
        """
        watched = found.watched
        forces = largest_joint_forces(
            self.joints, found.times, lambda joint: watched.of(joint.channels(SPRING))
        )
        seen = watched.of(watch_probes(self.probes).channels) - np.outer(amounts, travel)
        smoothed = watched.of(smoothing_channels(self.probes))
        return forces, read_probes(self.probes, found.times, seen, smoothed)


def observe_path(state: RunState, model: PoseModel) -> PathObservers:
    """Find joints and probes of a machine in the middle of a path."""
    probes = place_probes(state.parts, model.coupled, tuple(state.scene.machine.probes))
    outputs = joint_outputs(model.joints) | probe_outputs(state.parts, probes)
    return PathObservers(model.joints, probes, outputs)


def evaluate_poses(
    request: PathRequest,
    system: VaryingSystem[Any],
    table: StepTable,
    *,
    found: tuple[PathDeviation, ...],
    kept: tuple[PathDeviation, ...],
    short: PathDeviation,
    whole: PathDeviation,
) -> FollowedPoses:
    """Return what following the poses took, and what it changes.

    Args:
        found: Moves as the pose changes.
        short: The last of these with the modes that are kept along the path.
    """
    truncation, effect = compare_moves(request, found, kept, short=short, whole=whole)
    return FollowedPoses(
        sampled_poses=len(system.positions),
        error=system.error,
        rotation_error=system.rotation_error,
        modes=len(system.scales),
        next_hz=None if np.isinf(system.next_hz) else system.next_hz,
        steps=len(table.spline.x),
        truncation=truncation,
        effect=effect,
    )


def compare_moves(
    request: PathRequest,
    found: Sequence[PathDeviation],
    kept: Sequence[PathDeviation],
    *,
    short: PathDeviation,
    whole: PathDeviation,
) -> tuple[float, tuple[float, ...]]:
    """Return what modes beyond a frequency change of a move, as a share of it, and what the change of
    pose does in every move.

    Args:
        found: Moves as the pose changes.
        short: A move without these modes.
    """

    def show(deviation: PathDeviation) -> FloatArray:
        return filter_deviation(deviation, request.low_pass).total

    full = show(whole)
    most = max(float(np.abs(full).max()), float(np.finfo(float).tiny))
    pairs = zip(found, kept, strict=True)
    effect = tuple(float(np.abs(show(ours) - show(theirs)).max()) for ours, theirs in pairs)
    return float(np.abs(show(short) - full).max()) / most, effect
