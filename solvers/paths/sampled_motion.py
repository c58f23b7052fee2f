"""A machine on its way through poses: its matrices in parallel-transported modes, sampled at times
of the way and joined by splines.

The way is cut into pieces at its corners; every piece has its own splines, with twice as many poses
until those half-way between are met. Modes beyond a frequency follow at once: what they add
statically is sampled as well. Modes are carried from pose to pose as in
:mod:`headstock.solvers.paths.varying_system`, along the whole way.
"""

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from headstock.geometry.frames import FloatArray
from headstock.solvers.errors import AccuracyError, ModelError
from headstock.solvers.paths.linear_motion import (
    LinearMotion,
    chunk_slices,
    even_nodes,
    interpolate_nodes,
)
from headstock.solvers.paths.varying_system import (
    LEAST_HZ,
    TURN_TOLERANCE,
    PlantChannels,
    PosedModes,
    PoseModes,
    SampledPlant,
    compare_transports,
    count_kept_modes,
    invert_sizes,
    largest_entries,
    look_at_pose,
    transport_modes,
    turn_plant,
)

MOST_SAMPLES = 400
# of what splines miss half-way between poses, as a share of its size, before the last halving
MISS_TOLERANCE = 1e-3
ROUNDOFF = 1e-5  # an input so much smaller than the largest one moves nothing
TOOL = slice(0, 3)  # inputs and outputs begin with those of the tool
GIVEN = slice(3, None)  # then come loads that the way gives, gravity first, and forces of drives
NODE_SPACING = 0.02
LOAD_SPACING = 1e-3
FIELDS = ("stiffness", "damping", "loads", "rows", "direct")


@dataclass(frozen=True, eq=False)
class SampledMotion:
    """A machine on its way.

    Attributes:
        breaks: ``(b,)`` times at which pieces of the way meet, its ends among them [s].
        pieces: Of each piece, field of :class:`SampledPlant` to its spline over time.
        poses: How many poses were taken.
        modes: How many modes are kept.
        error: Largest error of splines through the others at the poses added last; of splines
            through all it is about a sixteenth.
        highest_hz: Highest natural frequency kept, anywhere on the way.
        next_hz: Lowest one left out; infinite where none is.
    """

    breaks: FloatArray
    pieces: tuple[Mapping[str, CubicSpline], ...]
    poses: int
    modes: int
    error: float
    highest_hz: float
    next_hz: float

    def at(self, times: FloatArray, *names: str) -> SampledPlant:
        """The matrices at times ``(n,)`` [s]; of fields that are not named nothing.

        Args:
            times: Before the first and after the last one the outermost pose holds.
            names: Of fields; all where none is named.
        """
        inside = np.clip(times, self.breaks[0], self.breaks[-1])
        places = np.clip(
            np.searchsorted(self.breaks, inside, side="right") - 1, 0, len(self.pieces) - 1
        )

        def find(name: str) -> FloatArray:
            if names and name not in names:
                return np.zeros(0)
            shape = self.pieces[0][name].c.shape[2:]
            found = np.empty((len(times), *shape))
            for piece, splines in enumerate(self.pieces):
                found[places == piece] = splines[name](inside[places == piece])
            return found

        return SampledPlant(*(find(name) for name in FIELDS))


def sample_motion(
    place: Callable[[float], PosedModes], breaks: Sequence[float], channels: PlantChannels
) -> SampledMotion:
    """Poses of a way, twice as many in each piece until splines through the others meet them.

    Args:
        place: The machine at a time of the way [s].
        breaks: ``(b,)`` rising times of its ends and corners [s].
        channels: What is asked.

    Raises:
        ModelError: The machine is free to move, a channel is unknown, or a damper acts on a dof
            without mass.
        AccuracyError: The greatest number of poses does not suffice.
    """
    seen: dict[float, PoseModes] = {}

    def look(time: float) -> PoseModes:
        found = look_at_pose(place(time), channels)
        if found.coordinates.rigid_count:
            raise ModelError(
                f"the machine is free to move in {found.coordinates.rigid_count} rigid-body motion(s), so a force on the tool"
                " drives it away; hold it by supports, joints to ground or drives"
            )
        return found

    spans = list(itertools.pairwise(breaks))
    wide, counts = set(range(len(spans))), [1] * len(spans)
    while True:
        for piece in wide:
            counts[piece] *= 2
        grids = [
            [float(time) for time in np.linspace(low, high, count + 1)]
            for (low, high), count in zip(spans, counts, strict=True)
        ]
        finer = [_halve(grid) for grid in grids]
        wanted = dict.fromkeys(time for grid in finer for time in grid)
        if len(wanted) > MOST_SAMPLES:
            raise AccuracyError(
                f"{MOST_SAMPLES} poses along the contour do not suffice to follow its matrices to {MISS_TOLERANCE:g}; "
                'modes close together change places: write a lower modes_to, or pose_model = "frozen"'
            )
        seen |= {time: look(time) for time in wanted if time not in seen}
        poses = {time: seen[time] for time in sorted(wanted)}
        kept, next_hz = count_kept_modes(poses, channels.up_to_hz)
        turns = transport_modes(poses, kept)
        matrices = {time: turn_plant(pose, turns[time]) for time, pose in poses.items()}
        misses = [_miss(grid, fine, matrices) for grid, fine in zip(grids, finer, strict=True)]
        wide = {piece for piece, miss in enumerate(misses) if miss > MISS_TOLERANCE}
        if not wide:
            coarse = sorted({time for grid in grids for time in grid})
            if compare_transports(poses, turns, coarse) > TURN_TOLERANCE:
                wide = set(range(len(spans)))
        if not wide:
            highest = max(pose.coordinates.omega[kept - 1] for pose in poses.values())
            return SampledMotion(
                breaks=np.array(breaks, dtype=float),
                pieces=tuple(_join(grid, matrices) for grid in finer),
                poses=len(poses),
                modes=kept,
                error=max(misses),
                highest_hz=float(highest) / (2.0 * np.pi),
                next_hz=next_hz,
            )


def _halve(grid: Sequence[float]) -> list[float]:
    return [float(time) for time in np.linspace(grid[0], grid[-1], 2 * len(grid) - 1)]


def _join(grid: Sequence[float], matrices: Mapping[float, SampledPlant]) -> dict[str, CubicSpline]:
    return {
        name: CubicSpline(grid, np.array([getattr(matrices[time], name) for time in grid]))
        for name in FIELDS
    }


def _miss(
    grid: Sequence[float], finer: Sequence[float], matrices: Mapping[float, SampledPlant]
) -> float:
    """How far splines through poses of a grid miss those half-way, each field by its own size."""
    splines = _join(grid, matrices)
    largest = 0.0
    for time in finer[1::2]:
        pose = matrices[time]
        root = np.sqrt(np.maximum(pose.stiffness.diagonal(), (2.0 * np.pi * LEAST_HZ) ** 2))
        # what all modes together answer statically: what is left out is judged by it
        whole = np.abs(pose.rows / root**2) @ np.abs(pose.loads) + np.abs(pose.direct)
        sizes = np.abs(pose.loads).max(axis=0, initial=0.0)
        weights = {
            "stiffness": 1.0 / np.outer(root, root),
            "damping": 1.0 / np.sqrt(np.outer(root, root)),
            "loads": 1.0 / np.maximum(sizes, ROUNDOFF * sizes.max(initial=1.0)),
            "rows": invert_sizes(largest_entries(pose.rows)),
            "direct": invert_sizes(largest_entries(whole)),
        }
        for name, weight in weights.items():
            change = np.abs(weight * (splines[name](time) - getattr(pose, name)))
            largest = max(largest, float(change.max(initial=0.0)))
    return largest


def follow_motion(
    sampled: SampledMotion, times: FloatArray, given: Callable[[FloatArray], FloatArray]
) -> LinearMotion:
    """The linear system along a way: matrices at nodes, loads of the rigid motion at finer ones.

    Args:
        sampled: Its first three inputs and outputs are force on and motion of the tool; the fourth
            input is gravity, others follow.
        times: ``(n,)`` even steps [s].
        given: Values ``(n, r)`` of the inputs from the fourth on, at times ``(n,)``.
    """
    nodes, load_nodes = even_nodes(times, NODE_SPACING), even_nodes(times, LOAD_SPACING)
    found = sampled.at(nodes)
    loads, rests = [], []
    for part in chunk_slices(len(load_nodes)):
        now, amounts = load_nodes[part], given(load_nodes[part])[..., None]
        finer = sampled.at(now, "loads", "direct")
        loads.append((finer.loads[:, :, GIVEN] @ amounts)[..., 0])
        # gravity alone is no deviation: what it adds by the modes left out is taken off again
        beyond = finer.direct[:, TOOL, GIVEN]
        rests.append((beyond[:, :, 1:] @ amounts[:, 1:])[..., 0])
    weight = given(nodes)[:, 0]
    return LinearMotion(
        times=times,
        nodes=nodes,
        mass=np.broadcast_to(np.eye(sampled.modes), found.stiffness.shape),
        damping=found.damping,
        stiffness=found.stiffness,
        tool=found.rows[:, TOOL],
        gravity_deflection=np.asarray(
            np.linalg.solve(
                found.stiffness, (found.loads[:, :, GIVEN.start] * weight[:, None])[..., None]
            )[..., 0]
        ),
        load=interpolate_nodes(times, load_nodes, np.concatenate(loads)),
        flexibility=found.direct[:, TOOL, TOOL],
        rest=interpolate_nodes(times, load_nodes, np.concatenate(rests)),
    )


def follow_drives(
    sampled: SampledMotion,
    times: FloatArray,
    *,
    coordinates: FloatArray,
    force: FloatArray,
    given: FloatArray,
) -> FloatArray:
    """Forces of the drives ``(n, d)``: the outputs after those of the tool.

    Args:
        sampled: The machine on its way.
        times: ``(n,)`` [s].
        coordinates: ``(n, m)`` then.
        force: ``(n, 3)`` on the tool [N].
        given: ``(n, r)`` the other inputs.
    """
    parts = []
    for part in chunk_slices(len(times)):
        found = sampled.at(times[part], "rows", "direct")
        loads = np.concatenate([force[part], given[part]], axis=1)
        parts.append(
            (found.rows[:, GIVEN] @ coordinates[part][..., None])[..., 0]
            + (found.direct[:, GIVEN] @ loads[..., None])[..., 0]
        )
    return np.concatenate(parts)
