"""A second-order system whose matrices change along a path: its modes, parallel-transported from
pose to pose and interpolated between sampled poses.

In every pose the coordinates are the modes up to a frequency. Modes of neighbouring poses differ in
sign, in order and, where two frequencies cross, altogether; turned to agree as well as they can
(parallel transport in the mass product) they change as smoothly as the machine does, and the
coupling of their speeds through the change of pose vanishes within them. What is left of it is of
second order in the speed of the axis over the length in which a shape changes, and goes to modes
beyond the highest frequency. Source: Amsallem and Farhat (2011), An online method for interpolating
linear parametric reduced-order models, SIAM J. Sci. Comput. 33, 2169 (consistent coordinates); Kato
(1950), On the adiabatic theorem (parallel transport).
"""

import dataclasses
import functools
import itertools
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from headstock.geometry.frames import DOF_NAMES, FloatArray
from headstock.solvers.errors import ModelError
from headstock.solvers.linear.damping import equivalent_viscous
from headstock.solvers.linear.modal_analysis import ModalResult, keep_lowest
from headstock.solvers.linear.modal_coordinates import (
    ModalCoordinates,
    keep_modes,
    to_modal_coordinates,
)
from headstock.solvers.second_order import Channel, Index, SecondOrderSystem

# of what the largest entries of inputs and outputs would do in the lowest elastic mode
ROUNDOFF = 1e-9
SEARCHED = (
    1.5  # the highest mode kept lies below the widest gap up to so many times the highest frequency
)
HELD = 1e-9  # of the largest motion at a place, in m or rad: less is roundoff
FIELDS = ("stiffness", "damping", "loads", "rows", "direct")


@dataclass(frozen=True, eq=False)
class PosedModes:
    """The system in a pose and its undamped modes.

    Attributes:
        modes: Of the system without damping, all or the lowest.
        motions: ``(n_all, m)`` their shapes in dofs that are the same in every pose.
        momenta: ``(n_all, m)`` mass times shape there.
        feedthrough: Output and input to what the output has of the input at once, whatever moves.
    """

    system: SecondOrderSystem
    modes: ModalResult
    motions: FloatArray
    momenta: FloatArray
    feedthrough: Mapping[tuple[Channel, Channel], float] = field(default_factory=dict)

    def join(
        self,
        rows: Mapping[Channel, FloatArray],
        feedthrough: Mapping[tuple[Channel, Channel], float],
    ) -> "PosedModes":
        """Return the system with further outputs ``(n,)`` and what they have of inputs at once."""
        system = dataclasses.replace(self.system, outputs={**self.system.outputs, **rows})
        taken = {**self.feedthrough, **feedthrough}
        return dataclasses.replace(self, system=system, feedthrough=taken)


@dataclass(frozen=True, eq=False)
class SampledPlant:
    """The system at a position of the path in parallel-transported modes of unit mass; or at ``n`` of
    them, the first axis of every field.

    Attributes:
        channels: Its ``k`` inputs and ``p`` outputs.
        stiffness: ``(m, m)``.
        damping: ``(m, m)`` viscous.
        loads: ``(m, k)`` of each input.
        rows: ``(p, m)`` motion at the outputs.
        direct: ``(p, k)`` what the modes left out add at once.
        reach: ``(p, k)`` or ``(1, k)`` sizes of the compliances of the elastic modes: what ``direct`` is
            compared with. It is not interpolated.
        low_frequency: ``(p, m)`` motion at the outputs of the low-frequency modes alone, which are those
            in the middle of the path; None where they are not parted from the others.
        quasi_static: ``(p,)`` deviation per unit of the first input if all but the low-frequency modes
            respond quasi-statically; likewise.
    """

    channels: "PlantChannels"
    stiffness: FloatArray
    damping: FloatArray
    loads: FloatArray
    rows: FloatArray
    direct: FloatArray
    reach: FloatArray | None = None
    low_frequency: FloatArray | None = None
    quasi_static: FloatArray | None = None

    def loads_of(self, inputs: Iterable[Channel]) -> FloatArray:
        """Return the loads ``(..., m, k')`` of some inputs."""
        return self.loads[..., self.channels.columns.of(inputs)]

    def rows_of(self, outputs: Iterable[Channel]) -> FloatArray:
        """Return the rows ``(..., p', m)`` of some outputs."""
        return self.rows[..., self.channels.rows.of(outputs), :]

    def direct_of(self, outputs: Iterable[Channel], inputs: Iterable[Channel]) -> FloatArray:
        """Return what some outputs have of some inputs at once ``(..., p', k')``."""
        rows = self.direct[..., self.channels.rows.of(outputs), :]
        return rows[..., self.channels.columns.of(inputs)]

    def part_slow(self, slow: int, left_out: FloatArray) -> "SampledPlant":
        """Return it with its first modes parted from the others.

        Args:
            slow: How many are low-frequency modes: the same along the path, so that a mode whose
                frequency passes the limit is no step in what is interpolated.
            left_out: ``(p, k)`` sum over the modes left out: the difference of ``direct`` loses digits.
        """
        held = np.linalg.solve(self.stiffness[slow:, slow:], self.loads[slow:])
        fast = self.rows[:, slow:]
        reach = np.abs(left_out) + np.abs(fast) @ np.abs(held)
        return dataclasses.replace(
            self,
            direct=left_out,
            # what the modes lack is small beside the whole, and often nothing but roundoff: so is
            # the whole across the plane of a symmetric machine
            reach=reach.max(axis=0, keepdims=True, initial=0.0),
            low_frequency=np.where(np.arange(len(self.stiffness)) < slow, self.rows, 0.0),
            quasi_static=left_out[:, 0] + fast @ held[:, 0],
        )

    def sizes(self) -> dict[str, FloatArray]:
        """Return the size of each field that is interpolated, but of stiffness and damping: what its
        misfit is a share of; zero where that does not matter.
        """
        sizes = {
            "loads": np.abs(self.loads).max(axis=0, keepdims=True, initial=0.0),
            "rows": largest_entries(self.rows),
            "direct": np.zeros_like(self.direct) if self.reach is None else self.reach,
        }
        if self.quasi_static is not None:
            sizes["low_frequency"] = sizes["rows"]
            sizes["quasi_static"] = largest_entries(self.quasi_static)
        return sizes


@dataclass(frozen=True)
class PlantChannels:
    """What is asked of a plant along a path.

    Attributes:
        inputs: Where loads act.
        outputs: Where motion is wanted.
        up_to_hz: Modes kept [Hz]; those above follow at once.
        kinds: Output to its kind: the misfit of outputs of one kind is a share of the largest of
            them. An output without a kind stands for itself.
    """

    inputs: tuple[Channel, ...]
    outputs: tuple[Channel, ...]
    up_to_hz: float
    kinds: Mapping[Channel, Channel] = field(default_factory=dict)

    @functools.cached_property
    def columns(self) -> Index:
        """Return the positions of the inputs."""
        return Index(self.inputs)

    @functools.cached_property
    def rows(self) -> Index:
        """Return the positions of the outputs."""
        return Index(self.outputs)

    def share_sizes(self, sizes: FloatArray) -> FloatArray:
        """Sizes ``(p, 1)`` of the outputs, of those of one kind the largest."""
        kinds = [self.kinds.get(channel, channel) for channel in self.outputs]
        largest: dict[Channel, float] = {}
        for kind, size in zip(kinds, map(float, sizes[:, 0]), strict=True):
            largest[kind] = max(largest.get(kind, 0.0), size)
        return np.array([[largest[kind]] for kind in kinds]).reshape(-1, 1)


@dataclass(frozen=True, eq=False)
class VaryingSystem:
    """A system along a path.

    Attributes:
        positions: ``(k,)`` of the sampled poses [m].
        scales: ``(m,)`` angular frequencies of the modes in the middle [rad/s].
        splines: Field of a sampled pose to its cubic spline along the path.
        error: Largest error of splines through the others at the sampled poses added last; of
            splines through all about 1/16 of it.
        rotation_error: Largest difference of modes transported along all sampled poses from
            those transported along all but the last ones [rad].
        next_hz: Lowest frequency, anywhere along the path, of a mode that is not kept [Hz]; inf
            where all are.
    """

    positions: FloatArray
    scales: FloatArray
    splines: dict[str, CubicSpline]
    error: float
    rotation_error: float
    next_hz: float
    channels: PlantChannels

    def at(self, position: float) -> SampledPlant:
        """Return the system at a position [m]."""
        return SampledPlant(
            self.channels,
            **{name: np.asarray(spline(position)) for name, spline in self.splines.items()},
        )


@dataclass(frozen=True, eq=False)
class SampledModes:
    """What is kept of a pose: its modes as they come between some channels, and what each output has of
    each input at once, whatever moves ``(p, k)``.
    """

    channels: PlantChannels
    coordinates: ModalCoordinates
    motions: FloatArray
    momenta: FloatArray
    feedthrough: FloatArray

    def sum_left_out(self, kept: int) -> FloatArray:
        """Return the static compliance ``(p, k)`` of all modes from a number on."""
        modes = self.coordinates
        beyond = (modes.outputs[:, kept:] / modes.eigenvalues[kept:]) @ modes.inputs[kept:]
        return beyond if modes.complete else beyond + modes.residual


def look_at_pose(
    posed: PosedModes, channels: PlantChannels, *, all_modes: bool = True, least: int = 0
) -> SampledModes:
    """A pose in its modes, with the shapes of those that may be kept.

    Args:
        all_modes: Also those that are certainly not kept; else they are in the residual flexibility.
        least: So many may be kept in any case.

    Raises:
        ModelError: A damper acts on a dof without mass, or a matrix is not symmetric.
    """
    # one mode is kept at least, with those close to it
    elastic = posed.modes.frequencies_hz[posed.modes.rigid_count :]
    up_to_hz = SEARCHED * max(channels.up_to_hz, float(elastic[0]) if len(elastic) else 0.0)
    count = max(least, int(np.count_nonzero(posed.modes.frequencies_hz <= up_to_hz)) + 1)
    modes = posed.modes if all_modes else keep_lowest(posed.modes, count=count)
    viscous = equivalent_viscous(posed.system, posed.modes)
    coordinates = to_modal_coordinates(viscous, channels.inputs, channels.outputs, modes)
    if coordinates is None:
        raise ModelError(
            "a damper acts on a dof without mass, or a matrix is not symmetric; give every body a mass"
        )
    held = _find_held_outputs(posed, channels)
    coordinates = dataclasses.replace(
        coordinates,
        outputs=np.where(held[:, None], 0.0, coordinates.outputs),
        residual=np.where(held[:, None], 0.0, coordinates.residual),
        complete=coordinates.complete and len(modes.frequencies_hz) == len(posed.system.mass),
        # a copy: a view would keep the shapes of all modes
        shapes=coordinates.shapes.copy(),
    )
    at_once = np.array(
        [
            [posed.feedthrough.get((output, given), 0.0) for given in channels.inputs]
            for output in channels.outputs
        ]
    ).reshape(len(channels.outputs), len(channels.inputs))
    return SampledModes(
        channels,
        coordinates,
        posed.motions[:, :count].copy(),
        posed.momenta[:, :count].copy(),
        at_once,
    )


def _find_held_outputs(posed: PosedModes, channels: PlantChannels) -> NDArray[np.bool_]:
    """Which outputs ``(p,)`` the machine holds rigidly in a pose: beside its other motions at the same
    place, by as much energy in any one coordinate, nothing but roundoff is left of them, which no
    spline could follow.
    """
    system, outputs = posed.system, channels.outputs
    omega = 2.0 * np.pi * channels.up_to_hz
    energy = system.stiffness.diagonal() + omega**2 * system.mass.diagonal()
    rows = {
        channel: float(np.abs(system.outputs[channel] / np.sqrt(energy)).max(initial=0.0))
        for channel in {(name, dof) for name, _ in outputs for dof in DOF_NAMES} | {*outputs}
        if channel in system.outputs
    }
    largest: dict[str, float] = {}
    for (name, dof), size in rows.items():
        if dof in DOF_NAMES:
            largest[name] = max(largest.get(name, 0.0), size)
    return np.array(
        [
            dof in DOF_NAMES and rows.get((name, dof), 0.0) <= HELD * largest.get(name, 0.0)
            for name, dof in outputs
        ]
    )


def find_middle(positions: Iterable[float]) -> float:
    """Find the one of rising positions that is nearest to the middle of the path."""
    places = list(positions)
    return min(places, key=lambda position: abs(position - 0.5 * (places[0] + places[-1])))


def transport_modes(poses: Mapping[float, SampledModes], kept: int) -> dict[float, FloatArray]:
    """Return the rotation ``(m, m)`` of the modes of each pose that makes them agree with their neighbours';
    those of the middle stay.
    """
    positions = list(poses)
    middle = positions.index(find_middle(positions))
    turns = {positions[middle]: np.eye(kept)}
    for path in (positions[middle:], positions[middle::-1]):
        for before, after in itertools.pairwise(path):
            turns[after] = align_modes(poses[before], poses[after], kept).T @ turns[before]
    return turns


def align_modes(before: SampledModes, after: SampledModes, kept: int) -> FloatArray:
    """Express the first modes of a pose by those of another one: orthogonal ``(m, m)``, a row for each
    of the former.

    Orthogonal Procrustes: of all turns of the new modes the one nearest to the old ones in mass.
    Signs, order and mixtures of close modes are free in every pose; left as they come, entries
    would jump and no spline could join them.
    """
    left, _, right = np.linalg.svd(before.momenta[:, :kept].T @ after.motions[:, :kept])
    return np.asarray(left @ right)


def turn_plant(pose: SampledModes, turn: FloatArray) -> SampledPlant:
    """The matrices of a pose in modes that were carried along a path.

    Args:
        turn: ``(m, m)`` modes are this times the carried ones: where close modes mix, the stiffness
            is full, and smooth along the path.
    """
    kept = len(turn)
    modes = keep_modes(pose.coordinates, kept - pose.coordinates.rigid_count)
    flexible = slice(modes.rigid_count, None)
    damping = np.zeros((kept, kept)) if modes.viscous is None else modes.viscous
    reach = np.abs(modes.outputs[:, flexible]) @ np.abs(
        modes.inputs[flexible] / modes.eigenvalues[flexible, None]
    ) + np.abs(modes.residual)
    if len(modes.eigenvalues) > modes.rigid_count:
        # a travel that bends nothing leaves elastic modes nothing but roundoff
        rows, columns = (
            largest_entries(modes.outputs),
            largest_entries(modes.inputs.T).T,
        )
        reach = reach + ROUNDOFF * rows * columns / modes.eigenvalues[flexible].min()
    return SampledPlant(
        channels=pose.channels,
        stiffness=turn.T @ (modes.eigenvalues[:, None] * turn),
        damping=turn.T @ damping @ turn,
        loads=turn.T @ modes.inputs,
        rows=modes.outputs @ turn,
        direct=pose.feedthrough
        + (np.zeros_like(modes.residual) if modes.complete else modes.residual),
        reach=reach,
    )


def largest_entries(values: FloatArray) -> FloatArray:
    """The largest entry of each row."""
    return np.asarray(np.abs(values).max(axis=-1, keepdims=True, initial=0.0))


def invert_sizes(size: FloatArray) -> FloatArray:
    """One over each entry; zero where it is zero."""
    return np.asarray(np.divide(1.0, size, out=np.zeros_like(size), where=size > 0.0))


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
            values = np.empty((len(times), *shape))
            for piece, splines in enumerate(self.pieces):
                values[piece_of == piece] = splines[name](inside[piece_of == piece])
            return values

        return SampledPlant(self.channels, *(find(name) for name in FIELDS))
