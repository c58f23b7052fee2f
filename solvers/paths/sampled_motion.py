"""A machine along its trajectory through poses: its matrices in parallel-transported modes, sampled at times
of the trajectory and joined by splines.

The trajectory is cut into pieces at its corners; every piece has its own splines, with twice as many poses
until those half-way between are met. Modes beyond a frequency follow at once: what they add
statically is sampled as well. Modes are transported from pose to pose as in
:mod:`headstock.solvers.paths.varying_system`, along the whole trajectory.

Modes cross that frequency, and each other about it, so that no number of modes is the same set in
all poses. What moves a mode and what it moves therefore fade out smoothly above that frequency, and
its static share takes over: a mode that leaves or joins those kept does so without any.
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
from headstock.solvers.paths.linear_motion import (
    CompliantHistory,
    LinearMotion,
    apply_matrices,
    chunk_slices,
    even_nodes,
    interpolate_nodes,
)
from headstock.solvers.paths.varying_system import (
    TURN_TOLERANCE,
    PlantChannels,
    PosedModes,
    PoseModes,
    SampledPlant,
    invert_sizes,
    largest_entries,
    look_at_pose,
    match_modes,
    transport_modes,
    turn_plant,
)
from headstock.solvers.second_order import Channel
from headstock.solvers.watched_outputs import Watch

MOST_SAMPLES = 400
# of what splines miss half-way between poses, as a share of its size, before the last halving
MISS_TOLERANCE = 1e-3
FADED = 1.5  # times the frequency up to which modes are kept: there nothing is left of them
ROUNDOFF = 1e-5  # an input so much smaller than the largest one moves nothing
NODE_SPACING = 0.02
LOAD_SPACING = 1e-3
FIELDS = ("stiffness", "damping", "loads", "rows", "direct")
ANCHORED = 4  # parts of a piece at whose ends a machine that differs little is looked at


@dataclass(frozen=True, eq=False)
class TrajectoryLoads:
    """What acts on a machine along its trajectory.

    Attributes:
        at: Values ``(n, r)`` of these at times ``(n,)``.
        weight: The one of gravity: what it moves alone is no deviation.
    """

    channels: tuple[Channel, ...]
    at: Callable[[FloatArray], FloatArray]
    weight: Channel

    def deviating(self, times: FloatArray) -> FloatArray:
        """Return the values ``(n, r)`` at times ``(n,)``, zero of the weight."""
        values = np.array(self.at(times))
        values[:, self.channels.index(self.weight)] = 0.0
        return values


@dataclass(frozen=True, eq=False)
class SampledMotion:
    """A machine along its trajectory.

    Attributes:
        breaks: ``(b,)`` times at which pieces of the trajectory meet, its ends among them [s].
        pieces: Of each piece, field of :class:`SampledPlant` to its spline over time.
        poses: How many poses were taken.
        modes: How many modes are kept.
        error: Largest error of splines through the others at the poses added last; of splines
            through all it is about a sixteenth.
        rotation_error: What modes transported over steps of twice the length are turned by beside these [rad].
        highest_hz: Highest natural frequency, anywhere on the trajectory, of a mode kept by half or more.
        complete: No mode is left out or fades.
        anchors: Times of a few poses to the momenta ``(n_all, m)`` of the transported modes there.
        along: Places of the trajectory at times ``(n,)``, where it was not sampled by time; None where it
            was.
    """

    channels: PlantChannels
    breaks: FloatArray
    pieces: tuple[Mapping[str, CubicSpline], ...]
    poses: int
    modes: int
    error: float
    rotation_error: float
    highest_hz: float
    complete: bool
    anchors: Mapping[float, FloatArray]
    along: Callable[[FloatArray], FloatArray] | None = None

    def at(self, times: FloatArray, *names: str) -> SampledPlant:
        """The matrices at times ``(n,)`` [s]; of fields that are not named nothing.

        Args:
            times: Before the first and after the last one the outermost pose holds.
            names: Of fields; all where none is named.
        """
        places = times if self.along is None else self.along(times)
        inside = np.clip(places, self.breaks[0], self.breaks[-1])
        piece_of = np.clip(
            np.searchsorted(self.breaks, inside, side="right") - 1, 0, len(self.pieces) - 1
        )

        def find(name: str) -> FloatArray:
            if names and name not in names:
                return np.zeros(0)
            shape = self.pieces[0][name].c.shape[2:]
            found = np.empty((len(times), *shape))
            for piece, splines in enumerate(self.pieces):
                found[piece_of == piece] = splines[name](inside[piece_of == piece])
            return found

        return SampledPlant(self.channels, *(find(name) for name in FIELDS))


@dataclass(frozen=True, eq=False)
class TransportedPose:
    """A pose in modes that were transported along the trajectory.

    Attributes:
        pose: In its natural modes, which fade.
        turn: ``(m, m)`` these are this times the transported ones.
        plant: Its matrices in the transported ones.
        shares: ``(m,)`` how much is kept of each natural mode.
    """

    pose: PoseModes
    turn: FloatArray
    plant: SampledPlant
    shares: FloatArray


def sample_motion(
    place: Callable[[float], PosedModes], breaks: Sequence[float], channels: PlantChannels
) -> SampledMotion:
    """Poses of a trajectory, twice as many in each piece until splines through the others meet them.

    Args:
        place: The machine at a time of the trajectory [s].
        breaks: ``(b,)`` rising times of its ends and corners [s].

    Raises:
        ModelError: The machine is free to move, a channel is unknown, or a damper acts on a dof
            without mass.
        AccuracyError: The greatest number of poses does not suffice.
    """
    seen: dict[float, PoseModes] = {}

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
                f"{MOST_SAMPLES} poses along the trajectory do not suffice to follow its matrices to {MISS_TOLERANCE:g}; "
                'write a lower modes_to, or pose_model = "frozen"'
            )
        seen |= {time: _look(place(time), channels) for time in wanted if time not in seen}
        poses = {time: seen[time] for time in sorted(wanted)}
        kept, highest_hz = _count_fading_modes(poses.values(), channels.up_to_hz)
        turns = transport_modes(poses, kept)
        transported = {
            time: _transport(pose, turns[time], channels) for time, pose in poses.items()
        }
        misses = [
            _miss(grid, fine, transported, channels)
            for grid, fine in zip(grids, finer, strict=True)
        ]
        rotations = [_find_rotation_error(fine, transported) for fine in finer]
        wide = {
            piece
            for piece, (miss, rotation) in enumerate(zip(misses, rotations, strict=True))
            if miss > MISS_TOLERANCE or rotation > TURN_TOLERANCE / len(spans)
        }
        if not wide:
            return SampledMotion(
                channels=channels,
                breaks=np.array(breaks, dtype=float),
                pieces=tuple(_join(grid, transported) for grid in finer),
                poses=len(poses),
                modes=kept,
                error=max(misses),
                rotation_error=sum(rotations),
                highest_hz=highest_hz,
                complete=all(pose.coordinates.complete for pose in poses.values()),
                anchors={
                    time: transported[time].pose.momenta[:, :kept] @ transported[time].turn
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
    """The trajectory of a machine that differs little from one that was sampled: what it differs by is
    looked at in a few poses, in the modes nearest to those of the other, and joined by splines.

    Args:
        base: The other machine along its trajectory.
        place: This one at a time of the trajectory [s].
        channels: What was asked of the other.
        shared: Rows of its motions that are those of the other, in their order.

    Raises:
        ModelError: The machine is free to move, or a damper acts on a dof without mass.
        AccuracyError: It has fewer modes than the other.
    """
    times = np.array(list(base.anchors))
    before, poses = base.at(times), list[PoseModes]()
    plants: dict[str, list[FloatArray]] = {name: [] for name in FIELDS}
    for time, momenta in base.anchors.items():
        pose = _look(place(time), channels, base.modes)
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


def _look(posed: PosedModes, channels: PlantChannels, least: int = 0) -> PoseModes:
    """The modes of a pose that may be kept, so many at least, faded.

    Raises:
        ModelError: The machine is free to move.
    """
    found = look_at_pose(posed, channels, all_modes=False, least=least)
    found = _fade_modes(found, channels.up_to_hz)
    if found.coordinates.rigid_count:
        raise ModelError(
            f"the machine is free to move in {found.coordinates.rigid_count} rigid-body motion(s), so a force on the tool"
            " drives it away; hold it by supports, joints to ground or drives"
        )
    return found


def _fade_modes(pose: PoseModes, up_to_hz: float) -> PoseModes:
    """A pose whose modes beyond a frequency are moved less and less, and move less; what they lack
    follows at once.

    Args:
        up_to_hz: Up to here they are kept as they are; from ``FADED`` times that on nothing is left
            [Hz].
    """
    found = pose.coordinates
    shares = _shares(found.omega, up_to_hz)
    viscous = found.viscous
    if viscous is not None:
        # what couples modes by damping fades as they do; their own damping stays
        own = np.diag(viscous.diagonal() * (1.0 - shares**2))
        viscous = shares[:, None] * viscous * shares + own
    faded = dataclasses.replace(
        found,
        inputs=shares[:, None] * found.inputs,
        outputs=found.outputs * shares,
        viscous=viscous,
        complete=found.complete and bool((shares == 1.0).all()),
    )
    return dataclasses.replace(pose, coordinates=faded)


def _shares(omega: FloatArray, up_to_hz: float) -> FloatArray:
    """How much of what moves each mode, and of what it moves, is kept ``(m,)``: falls from one to
    zero with continuous second derivative.
    """
    left = (FADED - omega / (2.0 * np.pi * up_to_hz)) / (FADED - 1.0)
    place = np.clip(left, 0.0, 1.0)
    return np.asarray(place**3 * (10.0 + place * (6.0 * place - 15.0)))


def _count_fading_modes(poses: Collection[PoseModes], up_to_hz: float) -> tuple[int, float]:
    """How many modes there are that are kept or fading in some pose, and the highest frequency of
    one that is kept by half or more [Hz].
    """
    shares = [(pose.coordinates.omega, _shares(pose.coordinates.omega, up_to_hz)) for pose in poses]
    known = min(pose.motions.shape[1] for pose in poses)
    kept = min(max(1, *(np.count_nonzero(share) for _, share in shares)), known)
    highest = max(float(omega[share >= 0.5].max(initial=0.0)) for omega, share in shares)
    return int(kept), highest / (2.0 * np.pi)


def _halve(grid: Sequence[float]) -> list[float]:
    return [float(time) for time in np.linspace(grid[0], grid[-1], 2 * len(grid) - 1)]


def _transport(pose: PoseModes, turn: FloatArray, channels: PlantChannels) -> TransportedPose:
    shares = _shares(pose.coordinates.omega[: len(turn)], channels.up_to_hz)
    return TransportedPose(pose, turn, turn_plant(pose, turn), shares)


def _join(
    grid: Sequence[float], transported: Mapping[float, TransportedPose]
) -> dict[str, CubicSpline]:
    return {
        name: CubicSpline(grid, np.array([getattr(transported[time].plant, name) for time in grid]))
        for name in FIELDS
    }


def _miss(
    grid: Sequence[float],
    finer: Sequence[float],
    transported: Mapping[float, TransportedPose],
    channels: PlantChannels,
) -> float:
    """How far splines through poses of a grid miss those half-way, each field by its own size, and
    no more than its mode is kept.
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
        # what all modes together answer statically: what is left out is judged by it
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
        largest = max(largest, *(float(np.abs(each).max(initial=0.0)) for each in changes))
    return largest


def _find_rotation_error(
    finer: Sequence[float], transported: Mapping[float, TransportedPose]
) -> float:
    """By how much modes that are transported over two steps differ from those transported over one step of
    twice the length, along a piece and no more than they are kept [rad].
    """
    total = 0.0
    for first, middle, last in zip(finer[:-2:2], finer[1:-1:2], finer[2::2], strict=True):
        before, half, after = transported[first], transported[middle], transported[last]
        kept = len(before.turn)
        twice = match_modes(before.pose, half.pose, kept) @ match_modes(half.pose, after.pose, kept)
        off = twice - match_modes(before.pose, after.pose, kept)
        total += float(np.abs(before.shares[:, None] * off * after.shares).max())
    return total


def follow_motion(
    sampled: SampledMotion,
    times: FloatArray,
    loads: TrajectoryLoads,
    tool: Sequence[Channel],
    *,
    node_spacing: float = NODE_SPACING,
    load_spacing: float = LOAD_SPACING,
) -> LinearMotion:
    """The linear system along a trajectory: matrices at nodes, loads of the rigid motion at finer ones.

    Args:
        times: ``(n,)`` even steps [s].
        loads: That act on it, but for those on the tool.
        tool: Its three inputs and outputs of force and motion.
        node_spacing: Time between which matrices are linear [s].
        load_spacing: Time between which loads are linear [s].
    """
    nodes, load_nodes = even_nodes(times, node_spacing), even_nodes(times, load_spacing)
    found, moved = sampled.at(nodes), sampled.channels.rows.of(tool)
    given = sampled.channels.columns.of(loads.channels)
    acting, rests = [], []
    for part in chunk_slices(len(load_nodes)):
        now = load_nodes[part]
        finer = sampled.at(now, "loads", "direct")
        acting.append(apply_matrices(finer.loads[:, :, given], loads.at(now)))
        # gravity alone is no deviation, also of the modes left out
        beyond = finer.direct[:, moved][:, :, given]
        rests.append(apply_matrices(beyond, loads.deviating(now)))
    weight = loads.at(nodes)[:, loads.channels.index(loads.weight)]
    return LinearMotion(
        times=times,
        nodes=nodes,
        mass=np.broadcast_to(np.eye(sampled.modes), found.stiffness.shape),
        damping=found.damping,
        stiffness=found.stiffness,
        tool=found.rows_of(tool),
        gravity_deflection=np.asarray(
            np.linalg.solve(
                found.stiffness, found.loads_of([loads.weight]) * weight[:, None, None]
            )[..., 0]
        ),
        load=interpolate_nodes(times, load_nodes, np.concatenate(acting)),
        flexibility=found.direct_of(tool, tool),
        rest=interpolate_nodes(times, load_nodes, np.concatenate(rests)),
    )


def interpolate_smooth(
    given: Callable[[FloatArray], FloatArray], times: FloatArray, spacing: float = LOAD_SPACING
) -> FloatArray:
    """Values ``(n, r)`` at times ``(n,)`` of what is as smooth as the rigid motion: linear between
    nodes so far apart, where these are fewer [s].
    """
    nodes = even_nodes(times, spacing)
    return (
        given(times) if len(nodes) >= len(times) else interpolate_nodes(times, nodes, given(nodes))
    )


@dataclass(frozen=True, eq=False)
class SampledHistory:
    """What a machine did along its trajectory, and what acted on it beside its weight.

    Attributes:
        motion: The machine; its first coordinates are its modes.
        plant: Its matrices at the nodes of the motion.
        inputs: Where something acts.
        acting: Values ``(m, k)`` of these in a part of the steps.
    """

    motion: LinearMotion
    history: CompliantHistory
    plant: SampledPlant
    inputs: tuple[Channel, ...]
    acting: Callable[[slice], FloatArray]

    def observe(self, watch: Watch) -> FloatArray:
        """Return what is watched ``(n, p)``, less what the weight alone does."""
        motion, plant, states = self.motion, self.plant, self.history
        modes = plant.rows.shape[2]
        rows, direct = plant.rows_of(watch.channels), plant.direct_of(watch.channels, self.inputs)
        added = [
            (self._added_rows(watch.channels, outputs), values)
            for outputs, values in (
                (watch.rates, states.rate),
                (watch.accelerations, states.acceleration),
            )
            if outputs
        ]
        found = np.empty((len(motion.times), len(watch.channels)))
        for part in chunk_slices(len(motion.times)):
            moved = states.compliant[part] - motion.deflect(part)
            found[part] = apply_matrices(motion.between(rows, part), moved[:, :modes])
            for others, values in added:
                found[part] += apply_matrices(motion.between(others, part), values[part, :modes])
            found[part] += apply_matrices(motion.between(direct, part), self.acting(part))
        return found

    def _added_rows(
        self, channels: Sequence[Channel], outputs: Mapping[Channel, Channel]
    ) -> FloatArray:
        rows = np.zeros((len(self.motion.nodes), len(channels), self.plant.rows.shape[2]))
        some = [number for number, channel in enumerate(channels) if channel in outputs]
        rows[:, some] = self.plant.rows_of(outputs[channels[number]] for number in some)
        return rows


def follow_outputs(
    sampled: SampledMotion,
    times: FloatArray,
    *,
    outputs: Sequence[Channel],
    coordinates: FloatArray,
    acting: FloatArray,
    inputs: Sequence[Channel],
) -> FloatArray:
    """Return outputs ``(n, p)`` of a machine along its trajectory.

    Args:
        times: ``(n,)`` [s].
        outputs: ``p`` of them.
        coordinates: ``(n, m)`` of its modes then.
        acting: ``(n, k)`` values of inputs.
    """
    rows, columns = sampled.channels.rows.of(outputs), sampled.channels.columns.of(inputs)
    parts = []
    for part in chunk_slices(len(times)):
        found = sampled.at(times[part], "rows", "direct")
        direct = found.direct[:, rows][:, :, columns]
        parts.append(
            apply_matrices(found.rows[:, rows], coordinates[part])
            + apply_matrices(direct, acting[part])
        )
    return np.concatenate(parts)
