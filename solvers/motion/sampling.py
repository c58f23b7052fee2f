"""Poses of a system along a path, as many as interpolation by splines needs; modes are transported
from pose to pose (:mod:`headstock.solvers.motion.plant`). There are two policies for the modes that
are kept.

Hard: the same number of modes everywhere, up to the widest gap above a frequency. A span is halved
where splines through the other poses are inaccurate in its middle.

Fading: the trajectory is cut into pieces at its corners; every piece has its own splines, and its
number of poses is doubled until the poses half-way between are matched. Modes beyond a frequency
respond statically: their residual flexibility is sampled as well. Modes cross that frequency, and
each other near it, so that no number of modes is the same set in all poses. The input and output
rows of a mode therefore fade out smoothly above that frequency, and its static share takes over: a
mode has no influence when it joins or leaves those kept.
"""

import dataclasses
import itertools
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from headstock.geometry.frames import FloatArray
from headstock.solvers.errors import AccuracyError, ModelError
from headstock.solvers.motion.exact import PathModel
from headstock.solvers.motion.plant import (
    FIELDS,
    PlantChannels,
    PosedModes,
    SampledModes,
    SampledMotion,
    SampledPlant,
    VaryingSystem,
    align_modes,
    find_middle,
    invert_sizes,
    largest_entries,
    sample_pose,
    transport_modes,
    turn_plant,
)

FIRST_POSES = 5
MOST_POSES = 257
# error of interpolation half-way between sampled poses, relative to its size; 1/16 of it between
# all
TOLERANCE = 5e-5
TURN_TOLERANCE = 1e-3  # of transported modes before the last halving [rad]; 1/4 with all poses
LEAST_HZ = 1.0
MOST_SAMPLES = 400
# misfit of splines half-way between poses, relative to the size of a field, before the last halving
MISS_TOLERANCE = 1e-3
FADED = 1.5  # over the frequency up to which modes are kept in full: nothing is left above
ROUNDOFF = 1e-5  # an input smaller than this share of the largest one counts as zero
ANCHORED = 4  # parts of a piece at whose ends a machine that differs little is sampled


def sample_system(
    place: Callable[[float], PosedModes], length: float, model: PathModel
) -> VaryingSystem:
    """Sample poses along a path, closer where splines through the others are inaccurate.

    Args:
        place: Returns the system at a position of the path [m].
        length: Of the path [m].

    Raises:
        ModelError: A damper acts on a dof without mass.
        AccuracyError: The greatest number of sampled poses does not suffice.
    """
    if model.up_to_hz is None:
        raise ValueError("a system along a path keeps modes up to a frequency")
    channels = PlantChannels(model.inputs, model.outputs, model.up_to_hz)
    return sample_plant(place, length, channels, slow_below_hz=model.low_frequency_limit_hz)


def sample_plant(
    place: Callable[[float], PosedModes],
    length: float,
    channels: PlantChannels,
    *,
    slow_below_hz: float | None = None,
) -> VaryingSystem:
    """Sample poses of a system between any loads and motions, likewise.

    Args:
        slow_below_hz: Modes below are separated from the others [Hz]; None for none.

    Raises:
        ModelError: A damper acts on a dof without mass.
        AccuracyError: The greatest number of sampled poses does not suffice.
    """
    first = [float(value) for value in np.linspace(0.0, length, FIRST_POSES)]
    poses = {position: sample_pose(place(position), channels) for position in first}
    wide = list(itertools.pairwise(first))
    while True:
        before, halves = list(poses), [0.5 * (low + high) for low, high in wide]
        poses |= {position: sample_pose(place(position), channels) for position in halves}
        poses = dict(sorted(poses.items()))
        kept, next_hz = _count_kept_modes(poses, channels.up_to_hz)
        turns = transport_modes(poses, kept)
        sampled_poses = _turn_poses(poses, turns, slow_below_hz)
        scales = _scales(sampled_poses)
        splines = _interpolate({position: sampled_poses[position] for position in before})
        misses = [
            _misfit(splines, position, sampled_poses[position], scales) for position in halves
        ]
        rotation_error = _compare_transports(poses, turns, before)
        wide = [
            side
            for span, half, miss in zip(wide, halves, misses, strict=True)
            if miss > TOLERANCE
            for side in ((span[0], half), (half, span[1]))
        ]
        if not wide and rotation_error > TURN_TOLERANCE:
            wide = list(itertools.pairwise(poses))
        if not wide:
            return VaryingSystem(
                np.array(list(poses)),
                scales,
                _interpolate(sampled_poses),
                max(misses),
                rotation_error,
                next_hz,
                channels,
            )
        if len(poses) + len(wide) > MOST_POSES:
            raise AccuracyError(
                f"{len(poses)} poses along the path leave an error of {max(misses):.2g} between them (limit {TOLERANCE:g}), of "
                f"{rotation_error:.2g} in the direction of modes (limit {TURN_TOLERANCE:g}); shorten the path, or write "
                'pose_model = "frozen"'
            )


def _count_kept_modes(poses: Mapping[float, SampledModes], up_to_hz: float) -> tuple[int, float]:
    """Return the number of modes that are kept everywhere: all up to a frequency, at least one, and
    on to the widest gap; and the lowest frequency left out [Hz].
    """
    frequencies = [pose.coordinates.omega / (2.0 * np.pi) for pose in poses.values()]
    most = min(len(part) for part in frequencies)
    least = max(1, *(int(np.count_nonzero(part <= up_to_hz)) for part in frequencies))
    if least >= most:
        return most, np.inf
    available = min(most, *(pose.motions.shape[1] for pose in poses.values()))
    gaps = {}
    for count in range(least, available + (available == most)):
        gaps[count] = (
            np.inf
            if count == most
            else min(float(part[count] / max(part[count - 1], LEAST_HZ)) for part in frequencies)
        )
    kept = max(gaps, key=lambda count: gaps[count]) if gaps else least
    return kept, np.inf if kept == most else min(float(part[kept]) for part in frequencies)


def _turn_poses(
    poses: Mapping[float, SampledModes],
    turns: Mapping[float, FloatArray],
    slow_below_hz: float | None,
) -> dict[float, SampledPlant]:
    plants = {position: turn_plant(pose, turns[position]) for position, pose in poses.items()}
    if slow_below_hz is None:
        return plants
    omega = poses[find_middle(poses)].coordinates.omega
    slow = int(np.count_nonzero(omega < 2.0 * np.pi * slow_below_hz))
    return {
        position: plant.part_slow(slow, poses[position].sum_left_out(len(plant.stiffness)))
        for position, plant in plants.items()
    }


def _scales(sampled_poses: Mapping[float, SampledPlant]) -> FloatArray:
    middle = sampled_poses[find_middle(sampled_poses)]
    return np.sqrt(np.maximum(middle.stiffness.diagonal(), (2.0 * np.pi * LEAST_HZ) ** 2))


def _interpolate(sampled_poses: Mapping[float, SampledPlant]) -> dict[str, CubicSpline]:
    names = ("stiffness", "damping", *next(iter(sampled_poses.values())).sizes())
    positions = list(sampled_poses)
    return {
        name: CubicSpline(
            positions,
            np.array([getattr(sampled_pose, name) for sampled_pose in sampled_poses.values()]),
        )
        for name in names
    }


def _misfit(
    splines: Mapping[str, CubicSpline],
    position: float,
    sampled_pose: SampledPlant,
    scales: FloatArray,
) -> float:
    """Return the misfit of splines in a sampled pose: of matrices relative to natural frequencies,
    of the rest relative to its largest entry.
    """
    root = np.sqrt(scales)
    sizes = sampled_pose.sizes() | {
        "stiffness": np.outer(scales, scales),
        "damping": np.outer(root, root),
    }
    misses = [
        np.abs(invert_sizes(sizes[name]) * (spline(position) - getattr(sampled_pose, name))).max(
            initial=0.0
        )
        for name, spline in splines.items()
    ]
    return float(max(misses))


def _compare_transports(
    poses: Mapping[float, SampledModes], turns: Mapping[float, FloatArray], some: Sequence[float]
) -> float:
    """Return the largest difference between modes transported along some of the poses and those
    transported along all.
    """
    kept = len(next(iter(turns.values())))
    middle = find_middle(poses)
    coarse = transport_modes(
        {position: poses[position] for position in poses if position in some or position == middle},
        kept,
    )
    # both as if they began in the same pose
    back = coarse[middle].T @ turns[middle]
    return max(
        float(np.abs(turn @ back - turns[position]).max(initial=0.0))
        for position, turn in coarse.items()
    )


@dataclass(frozen=True, eq=False)
class _TransportedPose:
    """Store a pose in modes that were transported along the trajectory.

    Attributes:
        pose: The pose in its natural modes, which fade.
        turn: ``(m, m)`` natural modes are this times the transported ones.
        plant: Matrices in the transported modes.
        shares: ``(m,)`` share that is kept of each natural mode.
    """

    pose: SampledModes
    turn: FloatArray
    plant: SampledPlant
    shares: FloatArray

    @property
    def momenta(self) -> FloatArray:
        """Return the momenta ``(n_all, m)`` of the transported modes."""
        return self.pose.momenta[:, : len(self.turn)] @ self.turn


def sample_motion(
    place: Callable[[float], PosedModes], breaks: Sequence[float], channels: PlantChannels
) -> SampledMotion:
    """Sample poses of a trajectory, doubled in each piece until splines match them.

    Args:
        place: Returns the machine at a time of the trajectory [s].
        breaks: ``(b,)`` rising times of its ends and corners [s].

    Raises:
        ModelError: The machine is free to move, a channel is unknown, or a damper acts on a dof
            without mass.
        AccuracyError: The greatest number of poses does not suffice.
    """
    looks: dict[float, SampledModes] = {}
    spans = list(itertools.pairwise(breaks))
    wide, counts = set(range(len(spans))), [1] * len(spans)
    while wide:
        counts = [count * (2 if piece in wide else 1) for piece, count in enumerate(counts)]
        grids = [_cut_evenly(*span, count) for span, count in zip(spans, counts, strict=True)]
        finer = [_cut_evenly(grid[0], grid[-1], 2 * (len(grid) - 1)) for grid in grids]
        wanted = dict.fromkeys(itertools.chain(*finer))
        if len(wanted) > MOST_SAMPLES:
            raise AccuracyError(
                f"{MOST_SAMPLES} poses along the trajectory do not suffice to follow its matrices to {MISS_TOLERANCE:g}; "
                'write a lower modes_to, or pose_model = "frozen"'
            )
        looks |= {
            time: _find_fading_modes(place(time), channels) for time in wanted if time not in looks
        }
        poses = {time: looks[time] for time in sorted(wanted)}
        kept, highest_hz = _count_fading_modes(poses.values(), channels.up_to_hz)
        turns = transport_modes(poses, kept)
        transported = {
            time: _transport(pose, turns[time], channels) for time, pose in poses.items()
        }
        misses, rotations = _find_errors(grids, finer, transported, channels)
        missed, rotated = misses > MISS_TOLERANCE, rotations > TURN_TOLERANCE / len(spans)
        wide = set(map(int, np.flatnonzero(missed | rotated)))
    return SampledMotion(
        channels=channels,
        breaks=np.array(breaks, dtype=float),
        pieces=tuple(_join(grid, transported) for grid in finer),
        poses=len(poses),
        modes=kept,
        error=float(misses.max()),
        rotation_error=float(sum(rotations)),
        highest_hz=highest_hz,
        complete=all(pose.coordinates.complete for pose in poses.values()),
        anchors={
            time: transported[time].momenta
            for grid in finer
            for time in grid[:: max(1, (len(grid) - 1) // ANCHORED)]
        },
    )


def vary_motion(
    base: SampledMotion,
    place: Callable[[float], PosedModes],
    channels: PlantChannels,
    shared: NDArray[np.intp],
) -> SampledMotion:
    """Return the trajectory of a machine that differs little from one that was sampled: the
    differences are sampled in a few poses, in the modes nearest to those of the other, and
    interpolated by splines.

    Args:
        base: The other machine along its trajectory.
        place: Returns this machine at a time of the trajectory [s].
        shared: Rows of its motions that the other machine has, in the order of the latter.

    Raises:
        ModelError: The machine is free to move, or a damper acts on a dof without mass.
        AccuracyError: It has fewer modes than the other.
    """
    times = np.array(list(base.anchors))
    before, poses = base.at(times), list[SampledModes]()
    plants: dict[str, list[FloatArray]] = {name: [] for name in FIELDS}
    for time, momenta in base.anchors.items():
        pose = _find_fading_modes(place(time), channels, base.modes)
        if pose.motions.shape[1] < base.modes:
            raise AccuracyError(
                f"{base.modes} modes are kept along the trajectory, and this machine has {pose.motions.shape[1]} that may be"
            )
        left, _, right = np.linalg.svd(momenta.T @ pose.motions[shared, : base.modes])
        plant = turn_plant(pose, np.asarray((left @ right).T))
        poses.append(pose)
        for name in FIELDS:
            plants[name].append(getattr(plant, name))
    changes = {name: np.array(plants[name]) - getattr(before, name) for name in FIELDS}
    pieces = []
    for splines, (low, high) in zip(base.pieces, itertools.pairwise(base.breaks), strict=True):
        here = (times >= low) & (times <= high)
        pieces.append(
            {
                name: CubicSpline(
                    splines[name].x,
                    splines[name](splines[name].x)
                    + CubicSpline(times[here], changes[name][here])(splines[name].x),
                )
                for name in FIELDS
            }
        )
    return dataclasses.replace(
        base,
        pieces=tuple(pieces),
        poses=len(poses),
        highest_hz=_count_fading_modes(poses, channels.up_to_hz)[1],
    )


def _find_fading_modes(posed: PosedModes, channels: PlantChannels, least: int = 0) -> SampledModes:
    """Return the modes of a pose that may be kept, at least a given number, faded.

    Raises:
        ModelError: The machine is free to move.
    """
    modes = sample_pose(posed, channels, all_modes=False, least=least)
    modes = _fade_modes(modes, channels.up_to_hz)
    if modes.coordinates.rigid_count:
        raise ModelError(
            f"the machine is free to move in {modes.coordinates.rigid_count} rigid-body motion(s), so a force on the tool"
            " drives it away; hold it by supports, joints to ground or drives"
        )
    return modes


def _fade_modes(pose: SampledModes, up_to_hz: float) -> SampledModes:
    """Return a pose whose modes beyond a frequency have smaller and smaller input and output rows;
    their static share is added to the residual flexibility.

    Args:
        up_to_hz: Highest frequency of modes that are kept in full; from ``FADED`` times that on
            nothing is left [Hz].
    """
    modes = pose.coordinates
    shares = _shares(modes.omega, up_to_hz)
    viscous = modes.viscous
    if viscous is not None:
        # what couples modes by damping fades as they do; their own damping stays
        diagonal = np.diag(viscous.diagonal() * (1.0 - shares**2))
        viscous = shares[:, None] * viscous * shares + diagonal
    faded = dataclasses.replace(
        modes,
        inputs=shares[:, None] * modes.inputs,
        outputs=modes.outputs * shares,
        viscous=viscous,
        complete=modes.complete and bool((shares == 1.0).all()),
    )
    return dataclasses.replace(pose, coordinates=faded)


def _shares(omega: FloatArray, up_to_hz: float) -> FloatArray:
    """Return the share ``(m,)`` that is kept of the input and output rows of each mode: it falls
    from one to zero with continuous second derivative.
    """
    left = (FADED - omega / (2.0 * np.pi * up_to_hz)) / (FADED - 1.0)
    level = np.clip(left, 0.0, 1.0)
    return level**3 * (10.0 + level * (6.0 * level - 15.0))


def _count_fading_modes(poses: Collection[SampledModes], up_to_hz: float) -> tuple[int, float]:
    """Return the number of modes that are kept or fading in some pose, and the highest frequency of
    one that is kept with a share of at least one half [Hz].
    """
    shares = [(pose.coordinates.omega, _shares(pose.coordinates.omega, up_to_hz)) for pose in poses]
    available = min(pose.motions.shape[1] for pose in poses)
    kept = min(max(1, *(np.count_nonzero(share) for _, share in shares)), available)
    highest = max(float(omega[share >= 0.5].max(initial=0.0)) for omega, share in shares)
    return int(kept), highest / (2.0 * np.pi)


def _find_errors(
    grids: Sequence[Sequence[float]],
    finer: Sequence[Sequence[float]],
    transported: Mapping[float, _TransportedPose],
    channels: PlantChannels,
) -> tuple[FloatArray, FloatArray]:
    """Return the misfit of each piece's splines ``(n,)`` and its rotation error [rad]."""
    pairs = zip(grids, finer, strict=True)
    misses = [_find_misfit(grid, fine, transported, channels) for grid, fine in pairs]
    return np.array(misses), np.array([_find_rotation_error(fine, transported) for fine in finer])


def _cut_evenly(low: float, high: float, count: int) -> list[float]:
    return [float(time) for time in np.linspace(low, high, count + 1)]


def _transport(pose: SampledModes, turn: FloatArray, channels: PlantChannels) -> _TransportedPose:
    shares = _shares(pose.coordinates.omega[: len(turn)], channels.up_to_hz)
    return _TransportedPose(pose, turn, turn_plant(pose, turn), shares)


def _join(
    grid: Sequence[float], transported: Mapping[float, _TransportedPose]
) -> dict[str, CubicSpline]:
    return {
        name: CubicSpline(grid, np.array([getattr(transported[time].plant, name) for time in grid]))
        for name in FIELDS
    }


def _find_misfit(
    grid: Sequence[float],
    finer: Sequence[float],
    transported: Mapping[float, _TransportedPose],
    channels: PlantChannels,
) -> float:
    """Return the misfit of splines through poses of a grid at those half-way, each field relative
    to its size, and weighted by the share that is kept of a mode.
    """
    splines = _join(grid, transported)
    largest = 0.0

    def size(values: FloatArray) -> FloatArray:
        return channels.share_sizes(largest_entries(values))

    for time in finer[1::2]:
        here = transported[time]
        plant, turn, shares = here.plant, here.turn, here.shares
        omega = here.pose.coordinates.omega[: len(turn)]
        off = {name: splines[name](time) - getattr(plant, name) for name in FIELDS}
        # static response of all modes together: the scale for errors of the residual flexibility
        single = np.abs(plant.rows @ turn.T / omega**2)
        whole = single @ np.abs(turn @ plant.loads) + np.abs(plant.direct)
        sizes = np.abs(plant.loads).max(axis=0, initial=0.0)
        sizes = np.maximum(sizes, ROUNDOFF * sizes.max(initial=1.0))
        # in the natural modes of the pose, in which the stiffness is diagonal. What couples two modes
        # there by a share e of both frequencies changes these by its square, and the shapes by e times
        # the lower over the higher of them
        by_size = (shares / omega)[:, None] * turn
        by_speed = (shares / np.sqrt(omega))[:, None] * turn
        stiffer = np.abs(by_size @ off["stiffness"] @ by_size.T)
        apart = np.minimum.outer(omega, omega) / np.maximum.outer(omega, omega)
        changes = (
            stiffer * np.where(np.eye(len(omega), dtype=bool), 1.0, np.maximum(stiffer, apart)),
            by_speed @ off["damping"] @ by_speed.T,
            shares[:, None] * (turn @ off["loads"]) / sizes,
            (off["rows"] @ turn.T) * shares * invert_sizes(size(plant.rows)),
            off["direct"] * invert_sizes(size(whole)),
        )
        largest = max(largest, *(float(np.abs(change).max(initial=0.0)) for change in changes))
    return largest


def _find_rotation_error(
    finer: Sequence[float], transported: Mapping[float, _TransportedPose]
) -> float:
    """Return the rotation between modes that are transported over two steps and over one step of
    twice the length, along a piece and weighted by the share that is kept of them [rad].
    """
    total = 0.0
    for first, middle, last in zip(finer[:-2:2], finer[1:-1:2], finer[2::2], strict=True):
        before, half, after = transported[first], transported[middle], transported[last]
        kept = len(before.turn)
        twice = align_modes(before.pose, half.pose, kept) @ align_modes(half.pose, after.pose, kept)
        off = twice - align_modes(before.pose, after.pose, kept)
        total += float(np.abs(before.shares[:, None] * off * after.shares).max())
    return total
