"""Moves of a path as solved, before any filter."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass

from headstock.geometry.frames import FloatArray
from headstock.pipeline.answers.motion_forces import PathForces
from headstock.pipeline.answers.path import FollowedPoses
from headstock.pipeline.answers.probe_motions import ProbeMotion
from headstock.pipeline.stages.probe_motions import read_probes, smoothing_channels, watch_probes
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


def add_watched(found: PathDeviation, disturbed: PathDeviation | None) -> PathDeviation:
    """Return a move with what disturbances add to what it watches; None for no disturbances."""
    if disturbed is None:
        return found
    return dataclasses.replace(found, watched=found.watched + disturbed.watched)


def read_path_probes(
    probes: Mapping[str, PlacedProbe], found: PathDeviation, added: FloatArray
) -> dict[str, ProbeMotion]:
    """Return what probes saw on a move, which watched them.

    Args:
        probes: ``p`` of them.
        found: The move.
        added: ``(n, 9 p)`` what is to be added.
    """
    seen, smoothed = (
        found.watched.of(channels)
        for channels in (watch_probes(probes).channels, smoothing_channels(probes))
    )
    return read_probes(probes, found.times, seen + added, smoothed)
