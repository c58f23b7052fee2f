"""A second-order system whose matrices change along a path: its modes, parallel-transported from
pose to pose and interpolated between sampled poses.

In every pose the coordinates are the modes up to a frequency. Modes of neighbouring poses differ in
sign, in order and, where two frequencies cross, in shape; rotated to agree as well as possible
(parallel transport in the mass product) they change as smoothly as the machine does, and the
coupling of their speeds through the change of pose vanishes within them. The remaining coupling is
of second order in the speed of the axis over the length in which a shape changes, and excites modes
beyond the highest frequency. Source: Amsallem and Farhat (2011), An online method for interpolating
linear parametric reduced-order models, SIAM J. Sci. Comput. 33, 2169 (consistent coordinates); Kato
(1950), On the adiabatic theorem (parallel transport).
"""

import dataclasses
import functools
import itertools
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

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

if TYPE_CHECKING:  # lumped machines load this module without a spline
    from scipy.interpolate import CubicSpline

# of the response of the lowest elastic mode with the largest entries of inputs and outputs
ROUNDOFF = 1e-9
# the highest mode kept lies below the widest gap up to this multiple of the highest frequency
SEARCHED = 1.5
HELD = 1e-9  # of the largest motion at a point, in m or rad: less is roundoff
FIELDS = ("stiffness", "damping", "loads", "rows", "direct")


@dataclass(frozen=True, eq=False)
class PosedModes:
    """Store the system in a pose and its undamped modes.

    Attributes:
        modes: Modes of the system without damping, all or the lowest.
        motions: ``(n_all, m)`` their shapes in dofs that are the same in every pose.
        momenta: ``(n_all, m)`` mass times shape there.
        feedthrough: Output and input to the direct feedthrough between them, independent of any
            motion.
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
        """Return the system with further outputs ``(n,)`` and their direct feedthrough."""
        system = dataclasses.replace(self.system, outputs={**self.system.outputs, **rows})
        taken = {**self.feedthrough, **feedthrough}
        return dataclasses.replace(self, system=system, feedthrough=taken)


@dataclass(frozen=True, eq=False)
class SampledPlant:
    """Store the system at a position of the path in parallel-transported modes of unit mass; or at
    ``n`` positions, the first axis of every field.

    Attributes:
        channels: Its ``k`` inputs and ``p`` outputs.
        stiffness: ``(m, m)``.
        damping: ``(m, m)`` viscous.
        loads: ``(m, k)`` modal load of each input.
        rows: ``(p, m)`` motion at the outputs.
        direct: ``(p, k)`` residual flexibility of the modes left out, and direct feedthrough.
        reach: ``(p, k)`` or ``(1, k)`` sizes of the compliances of the elastic modes: the scale of
            errors of ``direct``. It is not interpolated.
        low_frequency: ``(p, m)`` motion at the outputs of the low-frequency modes alone, which are
            those in the middle of the path; None where they are not separated from the others.
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
        """Return the direct feedthrough ``(..., p', k')`` from some inputs to some outputs."""
        rows = self.direct[..., self.channels.rows.of(outputs), :]
        return rows[..., self.channels.columns.of(inputs)]

    def part_slow(self, slow: int, left_out: FloatArray) -> "SampledPlant":
        """Return the system with its lowest modes separated from the others.

        Args:
            slow: Number of low-frequency modes: the same along the path, so that a mode whose
                frequency crosses the limit causes no step in interpolated fields.
            left_out: ``(p, k)`` sum over the modes left out: as a difference of ``direct`` it would
                lose digits.
        """
        static = np.linalg.solve(self.stiffness[slow:, slow:], self.loads[slow:])
        fast = self.rows[:, slow:]
        reach = np.abs(left_out) + np.abs(fast) @ np.abs(static)
        return dataclasses.replace(
            self,
            direct=left_out,
            # the residual flexibility is small relative to the whole, and often roundoff: so is
            # the whole across the plane of a symmetric machine
            reach=reach.max(axis=0, keepdims=True, initial=0.0),
            low_frequency=np.where(np.arange(len(self.stiffness)) < slow, self.rows, 0.0),
            quasi_static=left_out[:, 0] + fast @ static[:, 0],
        )

    def sizes(self) -> dict[str, FloatArray]:
        """Return the size of each interpolated field, except stiffness and damping, that its misfit
        is relative to; zero where it does not matter.
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
    """Define the inputs and outputs of a plant along a path.

    Attributes:
        inputs: Inputs where loads act.
        outputs: Outputs where motion is wanted.
        up_to_hz: Highest frequency of modes kept [Hz]; those above respond statically.
        kinds: Output to its kind: the misfit of outputs of one kind is relative to the largest of
            them. An output without a kind is a kind of its own.
    """

    inputs: tuple[Channel, ...]
    outputs: tuple[Channel, ...]
    up_to_hz: float
    kinds: Mapping[Channel, Channel] = field(default_factory=dict)

    @functools.cached_property
    def columns(self) -> Index:
        """Return the indices of the inputs."""
        return Index(self.inputs)

    @functools.cached_property
    def rows(self) -> Index:
        """Return the indices of the outputs."""
        return Index(self.outputs)

    def share_sizes(self, sizes: FloatArray) -> FloatArray:
        """Return sizes ``(p, 1)`` of the outputs, of those of one kind the largest."""
        kinds = [self.kinds.get(channel, channel) for channel in self.outputs]
        largest: dict[Channel, float] = {}
        for kind, size in zip(kinds, map(float, sizes[:, 0]), strict=True):
            largest[kind] = max(largest.get(kind, 0.0), size)
        return np.array([[largest[kind]] for kind in kinds]).reshape(-1, 1)


@dataclass(frozen=True, eq=False)
class VaryingSystem:
    """Interpolate a system along a path.

    Attributes:
        positions: ``(k,)`` of the sampled poses [m].
        scales: ``(m,)`` angular frequencies of the modes in the middle [rad/s].
        splines: Field of a sampled pose to its cubic spline along the path.
        error: Largest error, at the sampled poses added last, of splines through the others; with
            all poses it is about 1/16 of that.
        rotation_error: Largest difference of modes transported along all sampled poses from those
            transported along all but the last ones [rad].
        next_hz: Lowest frequency, anywhere along the path, of a mode that is not kept [Hz]; inf
            where all are.
    """

    positions: FloatArray
    scales: FloatArray
    splines: "dict[str, CubicSpline]"
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
    """Store the modes of a pose between some channels, and the direct feedthrough ``(p, k)`` of
    each input to each output.
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


def sample_pose(
    posed: PosedModes, channels: PlantChannels, *, all_modes: bool = True, least: int = 0
) -> SampledModes:
    """Return the modes of a pose between its channels, with shapes of those to be kept.

    Args:
        all_modes: Include modes that are certainly not kept; else they are in the residual
            flexibility.
        least: Number of modes that may be kept in any case.

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
    constrained = _find_constrained_outputs(posed, channels)
    coordinates = dataclasses.replace(
        coordinates,
        outputs=np.where(constrained[:, None], 0.0, coordinates.outputs),
        residual=np.where(constrained[:, None], 0.0, coordinates.residual),
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


def _find_constrained_outputs(posed: PosedModes, channels: PlantChannels) -> NDArray[np.bool_]:
    """Find outputs ``(p,)`` that are rigidly constrained in a pose: relative to other motions at
    the same point, with the same energy in any one coordinate, only roundoff is left of them, which
    no spline could fit.
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
    """Find the position that is nearest to the middle of the path."""
    places = list(positions)
    return min(places, key=lambda position: abs(position - 0.5 * (places[0] + places[-1])))


def transport_modes(poses: Mapping[float, SampledModes], kept: int) -> dict[float, FloatArray]:
    """Return the rotation ``(m, m)`` of the modes of each pose that aligns them with those of its
    neighbours; those of the middle pose are kept.
    """
    positions = list(poses)
    middle = positions.index(find_middle(positions))
    turns = {positions[middle]: np.eye(kept)}
    for path in (positions[middle:], positions[middle::-1]):
        for before, after in itertools.pairwise(path):
            turns[after] = align_modes(poses[before], poses[after], kept).T @ turns[before]
    return turns


def align_modes(before: SampledModes, after: SampledModes, kept: int) -> FloatArray:
    """Express the lowest modes of a pose by those of another one: orthogonal ``(m, m)``, a row for
    each of the former.

    Orthogonal Procrustes: the rotation of the new modes that is closest to the old ones in mass.
    Signs, order and mixtures of close modes are arbitrary in every pose; without alignment, entries
    would jump and could not be interpolated.
    """
    left, _, right = np.linalg.svd(before.momenta[:, :kept].T @ after.motions[:, :kept])
    return left @ right


def turn_plant(pose: SampledModes, turn: FloatArray) -> SampledPlant:
    """Return the matrices of a pose in transported modes.

    Args:
        turn: ``(m, m)`` modes are this times the transported ones: where close modes mix, the
            stiffness is full, and smooth along the path.
    """
    kept = len(turn)
    modes = keep_modes(pose.coordinates, kept - pose.coordinates.rigid_count)
    flexible = slice(modes.rigid_count, None)
    damping = np.zeros((kept, kept)) if modes.viscous is None else modes.viscous
    reach = np.abs(modes.outputs[:, flexible]) @ np.abs(
        modes.inputs[flexible] / modes.eigenvalues[flexible, None]
    ) + np.abs(modes.residual)
    if len(modes.eigenvalues) > modes.rigid_count:
        # where rigid motion causes no deformation, the loads of elastic modes are roundoff
        rows = largest_entries(modes.outputs)
        columns = largest_entries(modes.inputs.T).T
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
    """Return the largest entry of each row."""
    return np.abs(values).max(axis=-1, keepdims=True, initial=0.0)


def invert_sizes(size: FloatArray) -> FloatArray:
    """Return one over each entry; zero where it is zero."""
    return np.divide(1.0, size, out=np.zeros_like(size), where=size > 0.0)


@dataclass(frozen=True, eq=False)
class SampledMotion:
    """Interpolate a machine along its trajectory.

    Attributes:
        breaks: ``(b,)`` times at which pieces of the trajectory meet, its ends among them [s].
        pieces: Of each piece, field of :class:`SampledPlant` to its spline over time.
        error: Largest error, at the poses added last, of splines through the others; with all poses
            it is about a sixteenth.
        rotation_error: Rotation between modes transported over steps of twice the length and these
            [rad].
        highest_hz: Highest natural frequency, anywhere on the trajectory, of a mode that is kept
            with a share of at least one half.
        complete: No mode is left out or fades.
        anchors: Times of a few poses to the momenta ``(n_all, m)`` of the transported modes there.
        along: Returns positions on the trajectory at times ``(n,)``, where it was not sampled by
            time; None where it was.
    """

    channels: PlantChannels
    breaks: FloatArray
    pieces: "tuple[Mapping[str, CubicSpline], ...]"
    poses: int
    modes: int
    error: float
    rotation_error: float
    highest_hz: float
    complete: bool
    anchors: Mapping[float, FloatArray]
    along: Callable[[FloatArray], FloatArray] | None = None

    def at(self, times: FloatArray, *names: str) -> SampledPlant:
        """Return the matrices at times ``(n,)`` [s]; of fields that are not named none.

        Args:
            times: Times; before the first and after the last pose, that pose holds.
            names: Names of fields; all where none is named.
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
