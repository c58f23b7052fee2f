"""How linear axes move a tool against its work, where they stand for it to be in a place, and the
direction in which it is fed in poses one after the other.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.errors import PoseError
from headstock.geometry.frames import BoolArray, FloatArray, Frame
from headstock.geometry.machine.machine import Machine, Point, Pose, place_components

OUT_OF_REACH = 1e-9  # of a place off what axes reach [m]
PARALLEL = 1e-6


@dataclass(frozen=True, eq=False)
class ToolTravel:
    """Axes that move a tool against its work.

    Attributes:
        directions: ``(3, a)`` travel of the tool against the work per travel of each axis.
    """

    axes: tuple[str, ...]
    directions: FloatArray

    def axis_positions(self, places: FloatArray) -> FloatArray:
        """Return the positions ``(n, a)`` of the axes [m] for places ``(n, 3)`` of the tool against
        the work, counted from where it is with all axes at zero; also of speeds and accelerations.

        Raises:
            ValueError: No axis moves the tool that way.
        """
        positions = places @ np.linalg.pinv(self.directions).T
        off = np.abs(positions @ self.directions.T - places).max(axis=0, initial=0.0)
        if (off > OUT_OF_REACH).any():
            raise ValueError(
                f"no axis moves the tool along {'xyz'[int(np.argmax(off))]}, by {1e3 * off.max():.4g} mm from where it stands with axes at zero"
            )
        return np.asarray(positions)


def find_tool_travel(machine: Machine, point: Point) -> ToolTravel:
    """Find the linear axes that move the tool of a point against its work, rotary ones at zero.

    Raises:
        ValueError: None does, or two move it the same way.
    """
    axis_directions = {}
    for name, axis in machine.axes.items():
        share = (point.tool.component in axis.moves) - (point.work.component in axis.moves)
        if axis.kind == "linear" and share:
            axis_directions[name] = share * axis.direction
    if not axis_directions:
        raise ValueError(f"no linear axis moves the tool of {point.name} against its work")
    directions = np.stack(list(axis_directions.values()), axis=1)
    if np.linalg.svd(directions, compute_uv=False)[-1] < PARALLEL or len(axis_directions) > 3:
        raise ValueError(
            f"axes {', '.join(axis_directions)} move the tool of {point.name} the same way twice; leave one out"
        )
    return ToolTravel(tuple(axis_directions), directions)


STANDSTILL = 1e-9  # of the longest step between two poses
NO_FEED: FloatArray = np.full(3, np.nan)
CORNER = np.radians(40.0)  # a path that turns by more than that in a pose has a corner there


@dataclass(frozen=True, eq=False)
class Feed:
    """Direction in which a tool is fed in each of ``n`` poses.

    Attributes:
        directions: ``(n, 3)`` unit vectors of the motion against the work, machine frame; NaN where
            the machine cannot take the pose, and everywhere if the tool never moves.
        corners: Poses in which the path turns; the direction is that of the move that ends there.
        standing: Poses from or to which the tool does not move against the work; the direction is
            that of the path through its place.
    """

    directions: FloatArray
    corners: tuple[int, ...] = ()
    standing: tuple[int, ...] = ()


def find_feed(machine: Machine, point: Point, tip: FloatArray, poses: Sequence[Pose]) -> Feed:
    """Find the tangents of the path of a tool through its work.

    Central differences, exact for parabolas whatever the distances of the poses; one-sided where
    the path begins and ends, unless it is closed without a corner there. Poses that the machine
    cannot take are passed over.

    Args:
        machine: Its components, axes and mechanism.
        tip: ``(3,)`` of the tool in the frame of its component [m].
        poses: One after the other.

    Raises:
        ValueError: A pose names an unknown axis or leaves an axis' limits.
    """
    directions = np.full((len(poses), 3), np.nan)
    taken, places, turns = [], [], []
    for number, pose in enumerate(poses):
        try:
            frames = place_components(machine, pose)
        except PoseError:
            continue
        tool, work = (
            Frame(np.zeros(3)) if end.component is None else frames[end.component]
            for end in (point.tool, point.work)
        )
        taken.append(number)
        places.append(work.rotation.T @ (tool.origin + tool.rotation @ tip - work.origin))
        turns.append(work.rotation)
    if len(taken) < 2:
        return Feed(directions)
    points: FloatArray = np.asarray(places)
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    moves = lengths > STANDSTILL * lengths.max()
    if not moves.any():
        return Feed(directions)
    # poses of one place share its direction
    place_of = np.concatenate([[0], np.cumsum(moves)])
    tangents, turning = _tangents(points[np.concatenate([[True], moves])])
    directions[taken] = np.einsum("nij,nj->ni", np.asarray(turns), tangents[place_of])
    alone = np.bincount(place_of) == 1
    return Feed(
        directions,
        tuple(taken[position] for position in np.flatnonzero(turning[place_of])),
        tuple(taken[position] for position in np.flatnonzero(~alone[place_of])),
    )


def _tangents(points: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return the unit tangents ``(m, 3)`` in the points ``(m, 3)`` of a path, no two neighbours
    alike, and which points are corners ``(m,)``.
    """
    steps = np.diff(points, axis=0)
    lengths = np.linalg.norm(steps, axis=1)[:, None]
    units = steps / lengths
    corners = np.zeros(len(points), dtype=bool)
    corners[1:-1] = _turns(units[:-1], units[1:])
    # the parabola through three points, where none of them is a corner
    middle = _between(units[:-1], units[1:], lengths[:-1], lengths[1:])
    middle = np.where(corners[1:-1, None], units[:-1], middle)
    ends = [units[0], units[-1]]
    gap, reach = np.linalg.norm(points[-1] - points[0]), np.ptp(points, axis=0).max()
    if gap <= STANDSTILL * reach and not _turns(units[-1], units[0]):
        ends = [_between(units[-1], units[0], lengths[-1], lengths[0])] * 2
    elif len(points) > 2:
        if not corners[1]:
            ends[0] = (2.0 * lengths[0] + lengths[1]) * units[0] - lengths[0] * units[1]
        if not corners[-2]:
            ends[1] = (2.0 * lengths[-1] + lengths[-2]) * units[-1] - lengths[-1] * units[-2]
    tangents = np.vstack([ends[0], middle, ends[1]])
    return np.asarray(tangents / np.linalg.norm(tangents, axis=1, keepdims=True)), corners


def _turns(before: FloatArray, after: FloatArray) -> BoolArray:
    """Return whether a path has a corner between moves along unit vectors ``(..., 3)``."""
    return (before * after).sum(axis=-1) < np.cos(CORNER)


def _between(
    before: FloatArray, after: FloatArray, length_before: FloatArray, length_after: FloatArray
) -> FloatArray:
    """Return the direction of the parabola in the middle one of three points ``(..., 3)``, not of
    unit length.

    Args:
        before: ``(..., 3)`` unit vector of the move that ends there.
        after: ``(..., 3)`` of the next one.
        length_before: ``(..., 1)`` [m].
        length_after: ``(..., 1)`` [m].
    """
    return length_after * before + length_before * after
