"""Moves of a path as solved, before any filter."""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from headstock.geometry.frames import FloatArray
from headstock.pipeline.answers.motion_forces import PathForces
from headstock.pipeline.answers.path import FollowedPoses
from headstock.pipeline.answers.probe_motions import ProbeMotion
from headstock.pipeline.stages.probe_motions import read_probes, smoothing_channels
from headstock.reduction.coupling.joint_forces import JointForces
from headstock.reduction.coupling.probes import PlacedProbe
from headstock.solvers.paths.response import PathDeviation


@dataclass(frozen=True, eq=False)
class SolvedMoves:
    """Deviations before any filter, one per feed.

    Attributes:
        found: What holds.
        kept: In the pose of the middle.
        forces: One per feed; of joints those in the pose of the middle.
        poses: How the poses of the path were followed; None where they were not.
        disturbed: Errors of guides or torque ripple are among what deviates.
    """

    found: tuple[PathDeviation, ...]
    kept: tuple[PathDeviation, ...]
    forces: tuple[PathForces, ...]
    poses: FollowedPoses | None = None
    disturbed: bool = False


def add_watched(found: PathDeviation, beside: FloatArray | None) -> PathDeviation:
    """A move with what something else adds to the first of what it watches.

    Args:
        found: The move.
        beside: ``(n, w)``; None for nothing.
    """
    if beside is None or found.watched is None:
        return found
    watched = found.watched.copy()
    watched[:, : beside.shape[1]] += beside
    return dataclasses.replace(found, watched=watched)


def read_path_probes(
    probes: Mapping[str, PlacedProbe],
    joints: Sequence[JointForces],
    found: PathDeviation,
    added: FloatArray,
) -> dict[str, ProbeMotion]:
    """What probes saw on a move, which watched them after the joints.

    Args:
        probes: ``p`` of them.
        joints: Before them.
        found: The move.
        added: ``(n, 9 p)`` what is to be added.
    """
    if found.watched is None or not probes:
        return {}
    first = sum(len(joint.directions) for joint in joints)
    seen, last = found.watched[:, first:], added.shape[1]
    count = len(smoothing_channels(probes))
    return read_probes(probes, found.times, seen[:, :last] + added, seen[:, last : last + count])
