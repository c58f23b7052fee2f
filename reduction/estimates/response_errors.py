"""Errors of the frequency response of a reduced machine compared with finer meshes and all modes
kept, in a small trial space.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import cho_factor, cho_solve, eigh

from headstock.geometry.frames import FloatArray
from headstock.geometry.parts.components import RayleighDamping
from headstock.reduction.estimates.frequency_errors import TruncatedPart, new_directions
from headstock.reduction.estimates.mesh_errors import MeshedPart
from headstock.solvers.control.closed_response import ControlForces
from headstock.solvers.linear.modal_analysis import ModalResult
from headstock.solvers.linear.symmetric_matrices import symmetrise
from headstock.solvers.second_order import Channel, ComplexArray, SecondOrderSystem

# over the highest frequency: modes of the trial space; static responses represent those above
REACH = 2.0
# share of the square of the lowest elastic frequency, used as zero where rigid motions are free
RESTING = 1e-6
CHUNK = 256  # frequencies evaluated together
PASSING = 3  # number of peaks that may pass over a line
PASSING_MARGIN = 1.25  # as the shift of a peak is evaluated at one share only
# A change of a few percent grows linearly towards finer meshes, so that it is largest at the
# end. A larger one may be largest before, where a peak comes near a line or an antiresonance lies
# on it: shares of the change that are tried then
EVEN = 0.05
ON_THE_WAY = (0.25, 0.5, 0.75)
STEP = 1e-3  # relative step of omega^2, to both sides, for a slope
# Under control it is unknown at which share of the change a peak passes over a line
CLOSELY = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)


@dataclass(frozen=True, eq=False)
class ErrorSources:
    """List the sources of the difference between the response of a machine and that with finer
    meshes and all modes kept.

    Attributes:
        truncated: Components that leave modes out.
        meshed: Components whose mesh has an estimate.
        loss_factors: Structural loss factors by component, where they act in the system.
        rayleigh: Damping by mass and stiffness, likewise.
    """

    truncated: Mapping[str, TruncatedPart] = field(default_factory=dict)
    meshed: Mapping[str, MeshedPart] = field(default_factory=dict)
    loss_factors: Mapping[str, float] = field(default_factory=dict)
    rayleigh: Mapping[str, RayleighDamping] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class SystemChange:
    """Store matrices added to the stiffness ``(m, m)`` with its structural damping, to the mass
    ``(m, m)`` and to the viscous damping ``(m, m)`` of a system; None for zero.
    """

    stiffness: ComplexArray
    mass: FloatArray
    damping: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class _MeshChanges:
    """Store the changes by the mesh of one component: by refinement, by its true curved faces, and
    by the small features that it lacks; None where they are unknown or zero.
    """

    finer: SystemChange
    faces: SystemChange | None
    left_out: SystemChange | None

    @property
    def surfaces(self) -> list[SystemChange]:
        """Known changes by faces and by features."""
        return [change for change in (self.faces, self.left_out) if change is not None]


@dataclass(frozen=True, eq=False)
class _Moments:
    """Store moments of the modes that a component leaves out, see ``Truncation``, in a trial space,
    with the damping of these modes.

    Attributes:
        first: ``(m, m)``.
        second: ``(m, m)``.
        limit: Lowest ``omega_k^2`` [rad^2/s^2].
        loss: ``1 + i eta`` with the structural loss factor.
    """

    first: FloatArray
    second: FloatArray
    limit: float
    loss: complex
    rayleigh: RayleighDamping


class ResponseSpace:
    """Describe a damped system and its sources of error in a trial space.

    Attributes:
        loads: ``(m, n_inputs)``.
        rows: ``(n_outputs, m)``.
        rest: Square of the angular frequency that counts as zero.
        control: Dynamic stiffness of drives under control; None where motors are locked.
        meshes: The same, and the opposite where the meshes are corrected by their estimates.
        parts: Changes by the mesh of each component alone.
        faces: Changes by curved faces, alone and together with finer meshes; empty where no face is
            curved.
    """

    def __init__(
        self,
        system: SecondOrderSystem,
        sources: ErrorSources,
        space: FloatArray,
        channels: tuple[FloatArray, FloatArray],
        rest: float,
        control: ControlForces | None = None,
        squares: FloatArray | None = None,
    ) -> None:
        self.sources, self.rest = sources, rest
        self.control = None if control is None else control.project(space)
        self.loads: FloatArray = space.T @ channels[0]
        self.rows: FloatArray = channels[1] @ space
        squares = np.zeros(0) if squares is None else squares
        self._rigid = int(np.count_nonzero(squares == 0.0))
        self._stiffness = space.T @ system.stiffness @ space
        # roundoff relative to the squares of natural frequencies would act as a spring, soft or
        # negative
        modal = np.arange(len(squares))
        self._stiffness[modal] = self._stiffness[:, modal] = 0.0
        self._stiffness[modal, modal] = squares
        self._hysteretic = (
            None if system.hysteretic is None else space.T @ system.hysteretic @ space
        )
        if self._hysteretic is not None:
            self._hysteretic[: self._rigid] = self._hysteretic[:, : self._rigid] = 0.0
        self._mass = space.T @ system.mass @ space
        self._damping = None if system.damping is None else space.T @ system.damping @ space
        self._moments = {
            name: self._project_moments(name, part, space)
            for name, part in sources.truncated.items()
        }
        self._missing: dict[str, FloatArray] = {}
        self.parts = {
            name: self._project_changes(name, part, space) for name, part in sources.meshed.items()
        }
        self.finer = self._find_finer()
        corrected = [
            self.parts[name].finer for name, part in sources.meshed.items() if part.corrected
        ]
        stiffer = self._add_up(corrected, -1.0)
        self.meshes: tuple[SystemChange, ...] = (
            (self.finer, stiffer) if stiffer.stiffness.any() else (self.finer,)
        )
        # finer meshes and true faces may act together or against each other
        shape = self._add_up([change for part in self.parts.values() for change in part.surfaces])
        self.faces: tuple[SystemChange, ...] = (
            (shape, self._add_up([shape, self.finer]))
            if shape.stiffness.any() or shape.mass.any()
            else ()
        )

    def _project_moments(self, name: str, part: TruncatedPart, space: FloatArray) -> _Moments:
        moved, moments = part.rows @ space, part.truncation
        return _Moments(
            moved.T @ moments.first @ moved,
            moved.T @ moments.second @ moved,
            moments.limit,
            *self._damping_of(name),
        )

    def _project_changes(self, name: str, part: MeshedPart, space: FloatArray) -> _MeshChanges:
        loss, damped = self._damping_of(name)
        moved, strained = part.rows @ space, part.strain(space)
        strained[:, : self._rigid] = 0.0

        def change(stiffness: FloatArray, mass: FloatArray) -> SystemChange:
            # the damping of a component is proportional to its own stiffness and mass
            viscous = damped.alpha * mass + damped.beta * stiffness if damped else None
            return SystemChange(loss * stiffness, mass, viscous)

        missing = self._missing[name] = strained.T @ part.energy @ strained
        softer = change(-self._find_lost(missing), np.zeros_like(self._mass))
        faces, left_out = (
            None
            if shape is None
            else change(strained.T @ shape.stiffness @ strained, moved.T @ shape.mass @ moved)
            for shape in (part.faces, part.left_out)
        )
        return _MeshChanges(softer, faces, left_out)

    def _find_finer(self) -> SystemChange:
        """Return the change by all meshes together, the damping of each as by it alone."""
        together = self._add_up([part.finer for part in self.parts.values()])
        missing = np.sum([np.zeros_like(self._mass), *self._missing.values()], axis=0)
        stiffness = 1j * together.stiffness.imag - self._find_lost(missing)
        return dataclasses.replace(together, stiffness=stiffness)

    def _find_lost(self, missing: FloatArray) -> FloatArray:
        """Return the stiffness ``(m, m)`` that the machine loses with finer meshes: the flexibility
        ``K^-1`` grows by ``K^-1 E K^-1``, as a mesh misses the energy ``E`` under given loads.

        Taken off the stiffness itself, the same energy counts too much where it is large: a column of
        two linear hexes across, whose compliance is 1.2 times itself too small, would be unstable.

        Args:
            missing: ``E`` ``(m, m)``.

        Source: Strang and Fix (1973), An Analysis of the Finite Element Method, section 1.6.
        """
        lost, elastic = np.zeros_like(missing), slice(self._rigid, None)
        stiffness, energy = self._stiffness[elastic, elastic], missing[elastic, elastic]
        lost[elastic, elastic] = symmetrise(energy @ np.linalg.solve(stiffness + energy, stiffness))
        return lost

    def _damping_of(self, name: str) -> tuple[complex, RayleighDamping]:
        """Return ``1 + i eta`` with the structural loss factor of a component, and its damping by
        mass and stiffness.
        """
        loss = 1.0 + 1j * self.sources.loss_factors.get(name, 0.0)
        return loss, self.sources.rayleigh.get(name, RayleighDamping())

    def _add_up(self, changes: Sequence[SystemChange], factor: float = 1.0) -> SystemChange:
        """Return the sum of changes, times a factor."""
        viscous = [change.damping for change in changes if change.damping is not None]
        nothing = np.zeros_like(self._mass)
        return SystemChange(
            factor * np.sum([nothing + 0j, *(change.stiffness for change in changes)], axis=0),
            factor * np.sum([nothing, *(change.mass for change in changes)], axis=0),
            factor * np.sum(viscous, axis=0) if viscous else None,
        )

    @property
    def limit(self) -> float:
        """Square of the lowest angular frequency of the modes left out."""
        return min(
            (part.truncation.limit for part in self.sources.truncated.values()), default=np.inf
        )

    def dynamic_stiffness(
        self,
        squares: FloatArray,
        change: SystemChange | None = None,
        shares: FloatArray | float = 1.0,
    ) -> ComplexArray:
        """Return ``K + i H + i omega C - omega^2 M`` ``(n_freq, m, m)``, plus the dynamic stiffness
        of control; structural damping does not act at rest.

        Args:
            squares: ``(n_freq,)`` of the angular frequencies; 0 for rest.
            change: Change that is added, such as by finer meshes; None for none.
            shares: ``(n_freq,)`` share of the change that is added.
        """
        moving = (squares > 0.0)[:, None, None]
        dynamic: ComplexArray = (
            self._stiffness - np.where(moving, squares[:, None, None], self.rest) * self._mass + 0j
        )
        if self._hysteretic is not None:
            dynamic += 1j * moving * self._hysteretic
        if self._damping is not None:
            dynamic += 1j * np.sqrt(squares)[:, None, None] * self._damping
        if self.control is not None:
            dynamic += self.control.dynamic_stiffness(
                np.sqrt(np.where(squares > 0.0, squares, self.rest))
            )
        if change is not None:
            added: ComplexArray = np.asarray(
                np.where(moving, change.stiffness, change.stiffness.real)
                - squares[:, None, None] * change.mass
            )
            if change.damping is not None:
                added += 1j * np.sqrt(squares)[:, None, None] * change.damping
            dynamic += np.broadcast_to(shares, squares.shape)[:, None, None] * added
        return dynamic

    def changed_system(
        self,
        inputs: Sequence[Channel],
        outputs: Sequence[Channel],
        change: SystemChange | None = None,
    ) -> SecondOrderSystem:
        """Return the machine in the trial space as a separate system.

        Args:
            change: Change that is added, such as by finer meshes; None for none.
        """
        added = change or SystemChange(
            np.zeros(self._mass.shape, dtype=complex), np.zeros_like(self._mass)
        )
        hysteretic: FloatArray = np.asarray(added.stiffness.imag)
        if self._hysteretic is not None:
            hysteretic = hysteretic + self._hysteretic
        viscous = [matrix for matrix in (self._damping, added.damping) if matrix is not None]
        return SecondOrderSystem(
            mass=symmetrise(self._mass + added.mass),
            damping=symmetrise(np.sum(viscous, axis=0)) if viscous else None,
            stiffness=symmetrise(self._stiffness + added.stiffness.real),
            inputs={channel: self.loads[:, index] for index, channel in enumerate(inputs)},
            outputs={channel: self.rows[index] for index, channel in enumerate(outputs)},
            labels=tuple(f"trial.{number}" for number in range(len(self._mass))),
            hysteretic=symmetrise(hysteretic) if hysteretic.any() else None,
        )

    def squares(self, change: SystemChange | None = None, near_hz: float = 0.0) -> FloatArray:
        """Return ``omega^2`` of the undamped modes ``(m,)``, with a change or without; with drives
        under control as stiff as they are near a frequency.
        """
        stiffness = self._stiffness if change is None else self._stiffness + change.stiffness.real
        mass = self._mass if change is None else self._mass + change.mass
        if self.control is not None:
            added = self.control.dynamic_stiffness(np.array([2.0 * np.pi * near_hz]))[0].real
            stiffness = stiffness + symmetrise(added)
        return eigh(stiffness, mass, eigvals_only=True)

    def softening(self, hz: float) -> float:
        """Return the frequency of the nearest mode with finer meshes over its present one."""
        now, then = self.squares(near_hz=hz), self.squares(self.finer, hz)
        mode = int(np.argmin(np.abs(now - (2.0 * np.pi * hz) ** 2)))
        return float(np.sqrt(max(then[mode], 0.0) / now[mode])) if now[mode] > 0.0 else 1.0

    def participations(
        self, squares: FloatArray, only: str | None = None
    ) -> tuple[ComplexArray, ComplexArray]:
        """Return lower and upper bound of ``lambda^2 R`` ``(n_freq, m, m)``, of one part or all."""
        shape = (len(squares), *self._mass.shape)
        least, most = np.zeros(shape, dtype=complex), np.zeros(shape, dtype=complex)
        column, omega = squares[:, None, None], np.sqrt(squares)[:, None, None]
        for name, moments in self._moments.items():
            if only in (None, name):
                # viscous damping by mass and stiffness acts on modes left out as on those kept
                loss = moments.loss + 1j * omega * moments.rayleigh.beta
                inertia = column - 1j * omega * moments.rayleigh.alpha
                ratio = inertia / loss
                least += inertia * ratio * (moments.first + ratio * moments.second)
                most += (
                    inertia
                    * ratio
                    * (moments.first + ratio / (1.0 - column / moments.limit) * moments.second)
                )
        return least, most

    def linearise_modes(self, square: float) -> tuple[SystemChange, SystemChange]:
        """Return the lower and upper bound of the term of the modes left out in the dynamic
        stiffness, linearised in ``omega^2`` at one ``square``.
        """
        ends = square * np.array([1.0 - STEP, 1.0 + STEP])
        changes = []
        for low, high in self.participations(ends):
            value, slope = 0.5 * (low + high), (high - low) / (ends[1] - ends[0])
            # rigid-body motions remain free: they change by mass alone
            slope[: self._rigid] = value[: self._rigid] / square
            slope[:, : self._rigid] = value[:, : self._rigid] / square
            stiffness = square * slope - value
            stiffness[: self._rigid] = stiffness[:, : self._rigid] = 0.0
            changes.append(SystemChange(stiffness, np.asarray(slope.real)))
        return changes[0], changes[1]


def project_response(
    system: SecondOrderSystem,
    sources: ErrorSources,
    modes: ModalResult,
    channels: tuple[FloatArray, FloatArray],
    highest_hz: float,
    control: ControlForces | None = None,
) -> ResponseSpace:
    """Project a machine onto its modes, its static responses at channels and the first corrections
    of its modes.

    Args:
        system: The coupled machine with its damping.
        channels: Loads ``(n, n_inputs)`` and output rows ``(n_outputs, n)``.
        highest_hz: Highest frequency at which the response is evaluated.
        control: Dynamic stiffness of the drives of the system, where its motors are free.
    """
    elastic = modes.frequencies_hz[modes.rigid_count :]
    lowest = (2.0 * np.pi * float(elastic[0])) ** 2 if len(elastic) else 0.0
    shift = lowest if modes.rigid_count else 0.0
    pushes = [channels[0], channels[1].T]
    if control is not None:
        pushes += [control.pushed, control.seen.T]
    count = max(
        modes.rigid_count + 1,
        int(np.searchsorted(modes.frequencies_hz, REACH * highest_hz, side="right")),
    )
    squares = (2.0 * np.pi * modes.frequencies_hz[:count]) ** 2
    squares[: modes.rigid_count] = 0.0
    space = _trial_space(
        system,
        sources.truncated,
        modes,
        count=count,
        pushes=np.hstack(pushes),
        highest_hz=highest_hz,
        shift=shift,
    )
    # an integrator is at rest nowhere else
    rest = RESTING * (shift if control is None else lowest)
    return ResponseSpace(system, sources, space, channels, rest, control, squares=squares)


def _trial_space(
    system: SecondOrderSystem,
    parts: Mapping[str, TruncatedPart],
    modes: ModalResult,
    *,
    count: int,
    pushes: FloatArray,
    highest_hz: float,
    shift: float,
) -> FloatArray:
    """Return the M-orthonormal directions ``(n, m)`` of the trial space of the response and its
    change: the given number of lowest modes, and others.
    """
    shapes = modes.shapes[:, :count]
    near = shapes[
        :,
        : max(
            modes.rigid_count + 1,
            int(np.searchsorted(modes.frequencies_hz, 1.2 * highest_hz, side="right")),
        ),
    ]
    applied = (
        [
            np.sum(
                [
                    part.rows.T @ (part.truncation.first @ (part.rows @ near))
                    for part in parts.values()
                ],
                axis=0,
            )
        ]
        if parts
        else []
    )
    try:
        factor = cho_factor(system.stiffness + shift * system.mass)
    except np.linalg.LinAlgError:
        return shapes
    return np.hstack(
        [
            shapes,
            new_directions(cho_solve(factor, np.hstack([pushes, *applied])), shapes, system.mass),
        ]
    )


@dataclass(frozen=True, eq=False)
class ResponseErrors:
    """Store changes of a receptance by the modes left out and by finer meshes, each on its own.

    Attributes:
        least: ``(n_freq, n_outputs, n_inputs)`` change by the lower bound of the modes left out;
            NaN where there is no bound.
        most: The same by their upper bound; the true change lies between both as a rule.
        mesh: Estimated change by finer meshes; None where no mesh has an estimate, NaN where modes
            without one take part.
        mesh_sizes: The largest change ``(n_freq, n_outputs, n_inputs)`` between the present and
            finer meshes: a peak may pass over lines.
        face_sizes: Possible additional change by curved faces; None where no face is curved.
    """

    least: ComplexArray
    most: ComplexArray
    mesh: ComplexArray | None = None
    mesh_sizes: FloatArray | None = None
    face_sizes: FloatArray | None = None

    @property
    def bounds(self) -> FloatArray:
        """Error by the modes left out ``(n_freq, n_outputs, n_inputs)``: the larger change and the
        difference of both.
        """
        return np.maximum(np.abs(self.least), np.abs(self.most)) + np.abs(self.most - self.least)

    def mix(self, weights: ComplexArray) -> "ResponseErrors":
        """Return the same for inputs that act by several loads.

        Args:
            weights: ``(n_freq, n_loads, n_inputs)`` loads per input.
        """
        sizes = np.abs(weights)
        return ResponseErrors(
            self.least @ weights,
            self.most @ weights,
            None if self.mesh is None else self.mesh @ weights,
            None if self.mesh_sizes is None else self.mesh_sizes @ sizes,
            None if self.face_sizes is None else self.face_sizes @ sizes,
        )


def bound_response_errors(space: ResponseSpace, frequencies_hz: FloatArray) -> ResponseErrors:
    """Return the change of a frequency response by the modes that components leave out, and by
    finer meshes.

    Modes left out subtract ``lambda^2 R(lambda)`` from the dynamic stiffness (see
    ``bound_frequency_errors``); a loss factor eta of a component divides its ``omega_k^2`` by
    ``1 / (1 + i eta)``. Finer meshes add the energy that the present ones miss to the flexibility, and
    damping with the stiffness they lose: at rest the response between two channels then changes by
    the energy product of the errors of the responses to both, otherwise so to first order.

    Args:
        frequencies_hz: ``(n_freq,)``.

    Source: Leung (1978) for the condensed dynamic stiffness; Jakobsson, Bengzon and Larson (2012,
    arXiv:1206.5479) estimate the same
        error by a dual problem. Prudhomme and Oden (1999), Comput. Methods Appl. Mech. Engrg. 176,
        313-331, for a quantity's error as a product of two errors.
    """
    squares, inputs = (2.0 * np.pi * frequencies_hz) ** 2, space.loads.shape[1]
    shape = (len(squares), len(space.rows), inputs)
    least, most = np.zeros(shape, dtype=complex), np.zeros(shape, dtype=complex)
    mesh = np.zeros(shape, dtype=complex) if space.sources.meshed else None
    sizes, faces = np.zeros(shape), np.zeros(shape)
    beyond = squares >= space.limit
    least[beyond] = most[beyond] = np.nan
    silent = frequencies_hz >= min(
        (part.reach_hz for part in space.sources.meshed.values()), default=np.inf
    )
    moves = (
        []
        if mesh is None
        else [
            _Move(change, space.squares(), space.squares(change))
            if space.control is None
            else _Move(change, np.zeros(0), np.zeros(0))
            for change in (*space.meshes, *space.faces)
        ]
    )
    for start in range(0, len(squares), CHUNK):
        lines = np.arange(start, min(start + CHUNK, len(squares)))
        if not (space.sources.truncated or space.sources.meshed):
            break
        dynamic = space.dynamic_stiffness(squares[lines])
        plain = space.rows @ np.linalg.solve(dynamic, space.loads.astype(complex))
        if mesh is not None:
            mesh[lines] = soften_response(space, frequencies_hz[lines]) - plain
            changes = []
            for move in moves:
                moved = _respond(space, space.dynamic_stiffness(squares[lines], move.change))
                changes.append(_largest_change(space, move, squares[lines], plain, moved - plain))
            sizes[lines] = np.max(changes[: len(space.meshes)], axis=0)
            faces[lines] = (
                np.max([sizes[lines], *changes[len(space.meshes) :]], axis=0) - sizes[lines]
            )
        inside = (squares[lines] > 0.0) & ~beyond[lines]
        if space.sources.truncated and inside.any():
            kept = lines[inside]
            least[kept], most[kept] = _add_modes(
                space, squares[kept], dynamic[inside], plain[inside]
            )
    if mesh is None:
        return ResponseErrors(least, most)
    mesh[silent] = sizes[silent] = np.nan
    return ResponseErrors(least, most, mesh, sizes, faces if space.faces else None)


def soften_response(space: ResponseSpace, frequencies_hz: FloatArray) -> ComplexArray:
    """Return the receptance ``(n_freq, n_outputs, n_inputs)`` as finer meshes would have it, by
    their estimates.
    """
    return _respond(
        space, space.dynamic_stiffness((2.0 * np.pi * frequencies_hz) ** 2, space.finer)
    )


def _respond(space: ResponseSpace, dynamic: ComplexArray) -> ComplexArray:
    return space.rows @ np.linalg.solve(dynamic, space.loads.astype(complex))


@dataclass(frozen=True, eq=False)
class _Move:
    """Store a change of a system, and ``omega^2`` of its modes ``(m,)`` before and after; none
    under control.
    """

    change: SystemChange
    before: FloatArray
    after: FloatArray


def _largest_change(
    space: ResponseSpace, move: _Move, squares: FloatArray, plain: ComplexArray, whole: ComplexArray
) -> FloatArray:
    """Return the largest change of lines ``(n_freq, n_outputs, n_inputs)`` anywhere between
    ``plain`` and the ``whole`` change.
    """
    largest = np.maximum(np.abs(whole), _largest_passing(space, move, squares, plain))
    lines = np.flatnonzero((np.abs(whole) > EVEN * np.abs(plain)).any(axis=(1, 2)))
    shares = ON_THE_WAY if space.control is None else CLOSELY
    for share in shares if len(lines) else ():
        moved = _respond(space, space.dynamic_stiffness(squares[lines], move.change, share))
        largest[lines] = np.maximum(largest[lines], np.abs(moved - plain[lines]))
    return np.asarray(largest)


def _largest_passing(
    space: ResponseSpace, move: _Move, squares: FloatArray, plain: ComplexArray
) -> FloatArray:
    """Return the largest change of lines ``(n_freq, n_outputs, n_inputs)`` while peaks pass over
    them; 0 where none does.

    The true change may be any share of the estimated one. As the share grows, natural frequencies
    shift, and those that pass over a line coincide with it at some share, which is interpolated
    linearly.
    """
    largest = np.zeros(plain.shape)
    low, high = np.minimum(move.before, move.after), np.maximum(move.before, move.after)
    passing = (low < squares[:, None]) & (squares[:, None] < high)
    for _ in range(int(min(PASSING, passing.sum(axis=1).max(initial=0)))):
        lines = np.flatnonzero(passing.any(axis=1))
        modes = passing[lines].argmax(axis=1)
        passing[lines, modes] = False
        shares = (move.before[modes] - squares[lines]) / (move.before[modes] - move.after[modes])
        moved = _respond(space, space.dynamic_stiffness(squares[lines], move.change, shares))
        largest[lines] = np.maximum(largest[lines], PASSING_MARGIN * np.abs(moved - plain[lines]))
    return largest


def _add_modes(
    space: ResponseSpace, squares: FloatArray, dynamic: ComplexArray, plain: ComplexArray
) -> tuple[ComplexArray, ComplexArray]:
    """Return the changes by the lower and upper bound of the modes left out."""
    inputs = space.loads.shape[1]
    low, high = space.participations(squares)
    loads, rows = space.loads.astype(complex), space.rows.T.astype(complex)
    if space.control is None:
        moved = np.linalg.solve(dynamic - high, np.hstack([loads, rows]))
        given, observed = moved[:, :, :inputs], moved[:, :, inputs:]
    else:
        given = np.linalg.solve(dynamic - high, loads)
        observed = np.linalg.solve((dynamic - high).transpose(0, 2, 1), rows)
    most = space.rows @ given - plain
    # the lower bound is close to the upper one and found to first order: one more factorisation
    # would cost half as much again
    return most - observed.transpose(0, 2, 1) @ ((high - low) @ given), most
