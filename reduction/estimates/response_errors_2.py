"""How far the frequency response of a reduced machine is from that of finer meshes with every mode kept."""

from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.reduction.estimates.response_errors import ResponseSpace, SystemChange
from headstock.solvers.second_order import ComplexArray

CHUNK = 256  # frequencies at a time
PASSING = 3  # peaks that may pass over a line
PASSING_MARGIN = 1.25  # the way of a peak is tried in one place only
# A change of a few percent grows evenly on the way to finer meshes, so that it is largest at the end. A larger one may be largest
# before, where a peak comes near a line or an antiresonance lies on it: shares of the way that are tried then
EVEN = 0.05
ON_THE_WAY = (0.25, 0.5, 0.75)


@dataclass(frozen=True, eq=False)
class ResponseErrors:
    """What the modes left out and finer meshes change of a receptance, each on its own.

    Attributes:
        least: ``(n_freq, n_outputs, n_inputs)`` change by the least that the modes left out can add; NaN where there is no bound.
        most: The same by the most they can add; the truth lies between both as a rule.
        mesh: The same by finer meshes, an estimate; None where no mesh has one, NaN where modes without one take part.
        mesh_sizes: The largest change ``(n_freq, n_outputs, n_inputs)`` anywhere on the way to finer meshes: a peak may pass over lines.
        face_sizes: What the parts' curved faces may add to that; None where nothing is curved.
    """

    least: ComplexArray
    most: ComplexArray
    mesh: ComplexArray | None = None
    mesh_sizes: FloatArray | None = None
    face_sizes: FloatArray | None = None

    @property
    def bounds(self) -> FloatArray:
        """Error by the modes left out ``(n_freq, n_outputs, n_inputs)``: the larger change and the distance between both."""
        return np.asarray(np.maximum(np.abs(self.least), np.abs(self.most)) + np.abs(self.most - self.least))


def bound_response_errors(space: ResponseSpace, frequencies_hz: FloatArray) -> ResponseErrors:
    """Change of a frequency response by the modes that components leave out, and by finer meshes.

    Modes left out take ``lambda^2 R(lambda)`` from the dynamic stiffness (see ``bound_frequency_errors``); a loss factor eta of a
    component divides its ``omega_k^2`` by ``1 / (1 + i eta)``. Finer meshes take the energy that the present ones miss from the
    stiffness, times ``1 + i eta``: to first order the response between two ports then changes by the energy product of the errors of
    the responses to both.

    Args:
        space: The machine in its trial space.
        frequencies_hz: ``(n_freq,)``.

    Source: Leung (1978) for the condensed dynamic stiffness; Jakobsson, Bengzon and Larson (2012, arXiv:1206.5479) estimate the same
        error by a dual problem. Prudhomme and Oden (1999), Comput. Methods Appl. Mech. Engrg. 176, 313-331, for a quantity's error as a
        product of two errors.
    """
    squares, inputs = (2.0 * np.pi * frequencies_hz) ** 2, space.loads.shape[1]
    shape = (len(squares), len(space.rows), inputs)
    least, most = np.zeros(shape, dtype=complex), np.zeros(shape, dtype=complex)
    mesh = np.zeros(shape, dtype=complex) if space.sources.meshed else None
    sizes, faces = np.zeros(shape), np.zeros(shape)
    beyond = squares >= space.limit
    least[beyond] = most[beyond] = np.nan
    silent = frequencies_hz >= min((part.reach_hz for part in space.sources.meshed.values()), default=np.inf)
    moves = (
        [] if mesh is None else [_Move(change, space.squares(), space.squares(change)) for change in (space.finer, *space.faces)]
    )
    for start in range(0, len(squares), CHUNK):
        lines = np.arange(start, min(start + CHUNK, len(squares)))
        if not (space.sources.truncated or space.sources.meshed):
            break
        dynamic = space.dynamic_stiffness(squares[lines])
        plain = space.rows @ np.linalg.solve(dynamic, space.loads.astype(complex))
        if mesh is not None:
            mesh[lines] = soften_response(space, frequencies_hz[lines]) - plain
            sizes[lines] = _largest_change(space, moves[0], squares[lines], plain, mesh[lines])
            for move in moves[1:]:
                whole = _respond(space, space.dynamic_stiffness(squares[lines], move.change)) - plain
                added = _largest_change(space, move, squares[lines], plain, whole) - sizes[lines]
                faces[lines] = np.maximum(faces[lines], added)
        inside = (squares[lines] > 0.0) & ~beyond[lines]
        if space.sources.truncated and inside.any():
            kept = lines[inside]
            least[kept], most[kept] = _add_modes(space, squares[kept], dynamic[inside], plain[inside])
    if mesh is None:
        return ResponseErrors(least, most)
    mesh[silent] = sizes[silent] = np.nan
    return ResponseErrors(least, most, mesh, sizes, faces if space.faces else None)


def soften_response(space: ResponseSpace, frequencies_hz: FloatArray) -> ComplexArray:
    """Receptance ``(n_freq, n_outputs, n_inputs)`` as finer meshes would have it, by their estimates."""
    return _respond(space, space.dynamic_stiffness((2.0 * np.pi * frequencies_hz) ** 2, space.finer))


def _respond(space: ResponseSpace, dynamic: ComplexArray) -> ComplexArray:
    return np.asarray(space.rows @ np.linalg.solve(dynamic, space.loads.astype(complex)))


@dataclass(frozen=True, eq=False)
class _Move:
    """A change of a system, and ``omega^2`` of its modes ``(m,)`` before and after."""

    change: SystemChange
    before: FloatArray
    after: FloatArray


def _largest_change(space: ResponseSpace, move: _Move, squares: FloatArray, plain: ComplexArray, whole: ComplexArray) -> FloatArray:
    """The largest change of lines ``(n_freq, n_outputs, n_inputs)`` anywhere on the way from ``plain`` to the ``whole`` change."""
    largest = np.maximum(np.abs(whole), _largest_passing(space, move, squares, plain))
    lines = np.flatnonzero((np.abs(whole) > EVEN * np.abs(plain)).any(axis=(1, 2)))
    for share in ON_THE_WAY if len(lines) else ():
        moved = _respond(space, space.dynamic_stiffness(squares[lines], move.change, share))
        largest[lines] = np.maximum(largest[lines], np.abs(moved - plain[lines]))
    return np.asarray(largest)


def _largest_passing(space: ResponseSpace, move: _Move, squares: FloatArray, plain: ComplexArray) -> FloatArray:
    """The largest change of lines ``(n_freq, n_outputs, n_inputs)`` while peaks pass over them; 0 where none does.

    The truth may lie anywhere between no change and the whole. While the change grows modes move from here to there, and those
    that pass over a line are on it at some share of the change, which is taken to grow evenly along the way.
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
    """Changes by the least and by the most that the modes left out can add."""
    inputs = space.loads.shape[1]
    low, high = space.participations(squares)
    moved = np.linalg.solve(dynamic - high, np.hstack([space.loads, space.rows.T]).astype(complex))
    given, seen = moved[:, :, :inputs], moved[:, :, inputs:]
    most = space.rows @ given - plain
    # from the most to the least it is a small step, taken to first order: one more factorisation would cost half as much again
    return most - seen.transpose(0, 2, 1) @ ((high - low) @ given), most
