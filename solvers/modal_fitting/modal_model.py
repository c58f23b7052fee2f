"""The modal model of frequency responses: shapes and residual terms by linear least squares for given
poles (LSFD), and poles refined together with them.
"""

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import BoolArray, FloatArray
from headstock.solvers.second_order import ComplexArray

ITERATIONS = 40
FIRST_DAMPING, LEAST_DAMPING, MOST_DAMPING = 1e-3, 1e-9, 1e8  # of Levenberg and Marquardt
CONVERGED = 1e-2  # fall of the sum of weighted squares, where each has variance one
MOST_RATE, MOST_SHIFT = 0.8, 0.3  # steps of a pole over its distance to the axis and to zero
LEAST_WIDTH = 1e-3  # of a pole's half width, in spacings of lines: what is narrower is not seen
SMALLEST_LEVEL = 1e-14  # of the largest eigenvalue of a matrix that is inverted
LEAST_SIGNAL = 0.05  # of the curvature by a parameter: noise may make up the rest
NOTHING = 1e-30  # of the largest number on a diagonal: what is smaller is rounding
STRONGEST_LINES = 2  # that alone do not show a mode: noise may be large at the top of another one


@dataclass(frozen=True, eq=False)
class ModalModel:
    """Poles, participations and shapes: ``H = sum psi l^T / (s - p) + conjugate + R / s^2 + D``.

    Attributes:
        poles: ``(k,)`` with positive imaginary parts [1/s].
        participations: ``(f, k)``.
        shapes: ``(m, k)``.
        lower: ``(m, f)`` R, what stands for modes below the band.
        upper: ``(m, f)`` D, what stands for modes above it.
        shape_deviations: ``(m, k)`` standard deviations of the parts of the shapes, for known poles.
    """

    poles: ComplexArray
    participations: ComplexArray
    shapes: ComplexArray
    lower: ComplexArray
    upper: ComplexArray
    shape_deviations: FloatArray

    def evaluate(self, frequencies_hz: FloatArray) -> ComplexArray:
        """Return the responses ``(l, m, f)``."""
        laplace = 2j * np.pi * frequencies_hz[:, None]
        residues = np.einsum("mk,fk->kmf", self.shapes, self.participations)
        modal = np.tensordot(1.0 / (laplace - self.poles), residues, axes=1)
        modal += np.tensordot(1.0 / (laplace - self.poles.conj()), residues.conj(), axes=1)
        return np.asarray(modal + self.lower / laplace[:, :, None] ** 2 + self.upper)


@dataclass(frozen=True, eq=False)
class WeightedResponses:
    """Responses divided by the deviations that are expected of them.

    Attributes:
        frequencies_hz: ``(l,)``.
        values: ``(l, m, f)``; nan throughout a pair that was not measured.
        lines: ``(l,)`` weights; a value has the product of its three.
        motions: ``(m,)``.
        forces: ``(f,)``.
    """

    frequencies_hz: FloatArray
    values: ComplexArray
    lines: FloatArray
    motions: FloatArray
    forces: FloatArray

    @property
    def measured(self) -> BoolArray:
        """Pairs that were measured, ``(m, f)``."""
        return np.asarray(np.isfinite(self.values[0]))

    def freedom(self, modes: int) -> float:
        """Return the count of real values less that of parameters."""
        motions, forces = self.values.shape[1:]
        lines = len(self.frequencies_hz) - 2.0  # residual terms take two of each pair
        return 2.0 * lines * float(self.measured.sum()) - 2.0 * modes * (motions + forces)

    @cached_property
    def weighted(self) -> ComplexArray:
        """``(l, m, f)``, zero where not measured."""
        weights = self.motions[:, None] * self.forces
        return np.asarray(np.nan_to_num(self.values) * self.lines[:, None, None] * weights)

    @cached_property
    def residual_terms(self) -> FloatArray:
        """Orthonormal columns ``(l, 2)`` that residual terms span."""
        terms = np.stack([np.ones_like(self.lines), 1.0 / self.frequencies_hz**2], axis=1)
        return np.linalg.qr(self.lines[:, None] * terms / np.linalg.norm(terms, axis=0))[0]

    @cached_property
    def blocks(self) -> list["_Block"]:
        """Motions that were measured with the same forces."""
        patterns, members = np.unique(self.measured, axis=0, return_inverse=True)
        found = []
        for number, pattern in enumerate(patterns):
            forces, motions = np.flatnonzero(pattern), np.flatnonzero(members.ravel() == number)
            if len(forces):
                values = self.weighted[:, motions][:, :, forces].transpose(2, 0, 1)
                found.append(_Block(forces, motions, np.stack([self.clear(v) for v in values])))
        return found

    def clear(self, columns: ComplexArray) -> FloatArray:
        """Return columns ``(l, c)`` without their share of residual terms, as real rows
        ``(2 l, c)``.
        """
        rest = columns - self.residual_terms @ (self.residual_terms.T @ columns)
        return np.concatenate([rest.real, rest.imag])

    def pole_columns(self, poles: ComplexArray, power: int) -> FloatArray:
        """Return what the real and imaginary parts of residues of ``(s - p)^-power`` multiply,
        with conjugates: ``(2 l, 2 k)``.
        """
        laplace = 2j * np.pi * self.frequencies_hz[:, None]
        given, mirrored = (
            self.lines[:, None] / (laplace - each) ** power for each in (poles, poles.conj())
        )
        pairs = np.stack([given + mirrored, 1j * (given - mirrored)], axis=-1)
        return self.clear(pairs.reshape(len(laplace), -1))


@dataclass(frozen=True, eq=False)
class _Block:
    """Motions measured with the same forces: indices of both, values ``(f, 2 l, m)``."""

    forces: NDArray[np.int64]
    motions: NDArray[np.int64]
    values: FloatArray


@dataclass(frozen=True, eq=False)
class _BlockFit:
    """Shapes of one block for given poles.

    Attributes:
        rotations: ``(f, 2 k, 2 k)`` products with the participation of each mode, weighted.
        inverse: ``(2 k, 2 k)`` of the normal matrix.
        factors: ``(2 k, m)`` real and imaginary parts of shapes.
        products: ``(f, 2 k, m)`` of columns and values.
    """

    rotations: FloatArray
    inverse: FloatArray
    factors: FloatArray
    products: FloatArray


@dataclass(frozen=True, eq=False)
class _State:
    """All shapes for given poles.

    Attributes:
        poles: ``(k,)``.
        participations: ``(f, k)``.
        columns: ``(2 l, 2 k)`` of the poles; a force only rotates them.
        blocks: In the order of those of the data.
        squares: Sum of weighted squares that is left.
    """

    poles: ComplexArray
    participations: ComplexArray
    columns: FloatArray
    blocks: list[_BlockFit]
    squares: float


@dataclass(frozen=True, eq=False)
class RefinedPoles:
    """A modal model fitted to weighted responses.

    Attributes:
        poles: ``(k,)`` [1/s].
        participations: ``(f, k)``.
        squares: Sum of weighted squares that is left.
        gains: ``(k,)`` how much of it each mode takes away, the others staying as they are, at all
            lines but the two where it is most.
    """

    poles: ComplexArray
    participations: ComplexArray
    squares: float
    gains: FloatArray


def fit_shapes(
    data: WeightedResponses, poles: ComplexArray, participations: ComplexArray
) -> RefinedPoles:
    """Fit shapes to responses for given poles and participations ``(f, k)``."""
    return _describe(data, _solve(data, poles, participations))


def refine(
    data: WeightedResponses, poles: ComplexArray, participations: ComplexArray
) -> RefinedPoles:
    """Refine poles and participations until the sum of weighted squares is least.

    Shapes and residual terms are eliminated in every step.

    Source: Golub and Pereyra (2003), variable projection, with the Jacobian of Kaufman (1975).
    """
    sizes = np.linalg.norm(participations, axis=0)
    state = _solve(data, poles, participations / sizes)
    damping = FIRST_DAMPING
    for _ in range(ITERATIONS if len(poles) else 0):
        matrix, slope, free, _ = _normal_equations(data, state)
        scale = _scale(matrix)
        levels, vectors = np.linalg.eigh(scale[:, None] * matrix * scale)
        along = vectors.T @ (scale * slope)
        last = state
        while state is last and damping <= MOST_DAMPING:
            step = scale * (vectors @ (along / (np.maximum(levels, 0.0) + damping)))
            tried = _solve(data, *_advance(data, last, step, free))
            state = tried if tried.squares <= last.squares else last
            damping *= 10.0
        damping = max(damping * 0.01, LEAST_DAMPING)
        if last.squares - state.squares < CONVERGED:
            break
    return _describe(data, state)


def pole_covariances(data: WeightedResponses, fit: RefinedPoles) -> FloatArray:
    """Return the covariance ``(k, 2, 2)`` of the real and imaginary part of each refined pole.

    That of equal noise, or where it is larger that of noise as each line and force has it. Fitted shapes
    contain noise, which would make a weakly excited pole look better known than it is: its share is
    taken out of the curvature.

    Sources: White (1980), covariance with unequal noise; Liang and Zeger (1995), Statistical Science 10,
    158, estimating equations with many nuisance parameters.
    """
    count = len(fit.poles)
    if not count:
        return np.zeros((0, 2, 2))
    state = _solve(data, fit.poles, fit.participations)
    variance = max(1.0, state.squares / data.freedom(count))
    matrix, _, free, noise = _normal_equations(data, state)
    inverse = _invert_without_noise(matrix, variance * noise)
    scores = np.zeros((len(free), len(free)))
    both = np.hstack([state.columns, data.pole_columns(state.poles, 2)])
    inner = (both.T @ both).reshape(2, 2 * count, 2, 2 * count)
    for block, solved, slopes in _slopes(data, state, inner):
        for place, values in enumerate(block.values):
            own = state.columns @ solved.rotations[place]
            rest = values - own @ solved.factors
            changes = np.einsum(
                "rai,gaij->grj",
                both.reshape(len(both), 2, -1),
                slopes.turns[:, place],
                optimize=True,
            ) - own @ (solved.inverse @ slopes.overlap)
            pulls = np.einsum("rm,ktam->rkta", rest, slopes.factors, optimize=True)
            changes = changes.reshape(len(changes), len(both), count, 2)
            rows = np.einsum("grka,rkta->rgkt", changes, pulls, optimize=True)
            rows = rows.reshape(len(both), -1)[:, free]
            scores += rows.T @ rows
    places = 2 * np.arange(count)[:, None] + np.arange(2)
    equal, unequal = (
        each[places[:, :, None], places[:, None, :]]
        for each in (variance * inverse @ matrix @ inverse, inverse @ scores @ inverse)
    )
    larger = np.trace(unequal, axis1=1, axis2=2) > np.trace(equal, axis1=1, axis2=2)
    return np.where(larger[:, None, None], unequal, equal)


def build_model(data: WeightedResponses, fit: RefinedPoles) -> ModalModel:
    """Return the modal model with its shapes and residual terms in the units of the responses."""
    motions, forces = data.measured.shape
    shapes = np.zeros((motions, len(fit.poles)), dtype=np.complex128)
    deviations = np.full((motions, len(fit.poles)), np.nan)
    state = _solve(data, fit.poles, fit.participations)
    for block, solved in zip(data.blocks, state.blocks, strict=True):
        weights = data.motions[block.motions, None]
        shapes[block.motions] = (solved.factors[::2] + 1j * solved.factors[1::2]).T / weights
        deviations[block.motions] = np.sqrt(solved.inverse.diagonal()[::2]) / weights
    empty = np.zeros((motions, forces), dtype=np.complex128)
    modal = ModalModel(fit.poles, fit.participations, shapes, empty, empty, deviations)
    rest = np.nan_to_num(data.values - modal.evaluate(data.frequencies_hz))
    squares = -((2.0 * np.pi * data.frequencies_hz) ** 2)
    terms = data.lines[:, None] * np.stack([np.ones_like(squares), 1.0 / squares], axis=1)
    sizes = np.linalg.norm(terms, axis=0)
    weighted = data.lines[:, None] * rest.reshape(len(squares), -1)
    solved_terms = np.linalg.lstsq(terms / sizes, weighted)[0] / sizes[:, None]
    upper, lower = solved_terms.reshape(2, motions, forces)
    return dataclasses.replace(modal, lower=lower, upper=upper)


def _solve(data: WeightedResponses, poles: ComplexArray, participations: ComplexArray) -> _State:
    """Fit the shapes of all motions."""
    columns = data.pole_columns(poles, 1)
    inner = columns.T @ columns
    blocks, squares = [], 0.0
    for block in data.blocks:
        rotations = _rotations(data.forces[block.forces, None] * participations[block.forces])
        products = columns.T @ block.values
        matrix = np.einsum("fji,jk,fkl->il", rotations, inner, rotations, optimize=True)
        right = np.einsum("fji,fjm->im", rotations, products, optimize=True)
        inverse = _invert(matrix)
        factors = inverse @ right
        squares += float(np.sum(block.values**2) - np.sum(right * factors))
        blocks.append(_BlockFit(rotations, inverse, factors, products))
    return _State(poles, participations, columns, blocks, max(squares, 0.0))


def _rotations(factors: ComplexArray) -> FloatArray:
    """Return products with complex factors ``(f, k)`` as matrices ``(f, 2 k, 2 k)`` for real and
    imaginary parts.
    """
    forces, count = factors.shape
    matrices = np.zeros((forces, count, 2, count, 2))
    modes = np.arange(count)
    for row, column, part in (
        (0, 0, factors.real),
        (1, 1, factors.real),
        (0, 1, -factors.imag),
        (1, 0, factors.imag),
    ):
        matrices[:, modes, row, modes, column] = part
    return matrices.reshape(forces, 2 * count, 2 * count)


def _scale(matrix: FloatArray) -> FloatArray:
    """Return what makes the diagonal of a symmetric matrix one; zero where it is rounding."""
    diagonal = matrix.diagonal()
    known = diagonal > NOTHING * np.max(diagonal, initial=0.0)
    return np.where(known, 1.0 / np.sqrt(np.where(known, diagonal, 1.0)), 0.0)


def _invert(matrix: FloatArray) -> FloatArray:
    """Return the inverse of a symmetric matrix, scaled; a pseudo-inverse where columns are one."""
    scale = _scale(matrix)
    inverse = np.linalg.pinv(scale[:, None] * matrix * scale, rcond=1e-14, hermitian=True)
    return np.asarray(scale[:, None] * inverse * scale)


def _invert_without_noise(matrix: FloatArray, noise: FloatArray) -> FloatArray:
    """Return the inverse of a symmetric matrix less the share of noise in it, of which a little stays in
    every direction.
    """
    scale = _scale(matrix)
    levels, vectors = np.linalg.eigh(scale[:, None] * matrix * scale)
    half = scale[:, None] * vectors / np.sqrt(np.maximum(levels, SMALLEST_LEVEL * levels[-1]))
    shares, directions = np.linalg.eigh(half.T @ noise @ half)
    whole = half @ directions
    return np.asarray(whole / np.maximum(1.0 - shares, LEAST_SIGNAL) @ whole.T)


def _describe(data: WeightedResponses, state: _State) -> RefinedPoles:
    count = len(state.poles)
    gains = np.zeros(count)
    for mode in range(count):
        pair = slice(2 * mode, 2 * mode + 2)
        by_line = np.zeros(len(data.lines))
        for fit in state.blocks:
            alone = fit.inverse[:, pair] @ np.linalg.pinv(fit.inverse[pair, pair], hermitian=True)
            energy = fit.factors[pair] @ fit.factors[pair].T
            for rotation in fit.rotations:
                share = state.columns @ (rotation @ alone)
                by_line += np.sum((share @ energy) * share, axis=1).reshape(2, -1).sum(axis=0)
        gains[mode] = float(np.sum(np.sort(by_line)[:-STRONGEST_LINES]))
    return RefinedPoles(state.poles, state.participations, state.squares, gains)


@dataclass(frozen=True, eq=False)
class _Slopes:
    """What the real and imaginary parts of poles (kind 0) and of participations of each force (kinds 1
    and on) change, on one block.

    Attributes:
        turns: ``(1 + f, f, 2, 2 k, 2 k)``: on the rows of a force it is a rotation of the columns of
            poles or of squared poles.
        overlap: ``(1 + f, 2 k, 2 k)`` with the columns that shapes multiply.
        factors: ``(k, 2, 2, m)`` of shapes, and of shapes times i.
    """

    turns: FloatArray
    overlap: FloatArray
    factors: FloatArray


def _slopes(
    data: WeightedResponses, state: _State, inner: FloatArray
) -> Iterator[tuple[_Block, _BlockFit, _Slopes]]:
    """Return the slopes of all blocks.

    Args:
        inner: ``(2, 2 k, 2, 2 k)`` products of the columns of poles and of squared poles.
    """
    forces, count = state.participations.shape
    for block, fit in zip(data.blocks, state.blocks, strict=True):
        turns = np.zeros((1 + forces, len(block.forces), 2, 2 * count, 2 * count))
        turns[0, :, 1] = fit.rotations
        for place, force in enumerate(block.forces):
            turns[1 + force, place, 0] = data.forces[force] * np.eye(2 * count)
        overlap = np.einsum("fji,jbk,gfbkl->gil", fit.rotations, inner[0], turns, optimize=True)
        yield block, fit, _Slopes(turns, overlap, _turn_factors(fit.factors))


def _turn_factors(factors: FloatArray) -> FloatArray:
    """Return real and imaginary parts of shapes ``(2 k, m)``, and of shapes times i, as ``(k, 2, 2, m)``:
    a factor i of a derivative turns its shape by a quarter.
    """
    real, imaginary = factors[::2], factors[1::2]
    return np.stack([[real, imaginary], [-imaginary, real]]).transpose(2, 0, 1, 3)


def _normal_equations(
    data: WeightedResponses, state: _State
) -> tuple[FloatArray, FloatArray, NDArray[np.int64], FloatArray]:
    """Return the Gauss–Newton matrix and the right-hand side for the real and imaginary parts of poles
    (first) and of participations, which of all are free, as the largest participation of a mode is not, and
    the share of the matrix that noise of variance one brings into it with the shapes.
    """
    forces, count = state.participations.shape
    kinds, size = 1 + forces, 2 * count
    both = np.hstack([state.columns, data.pole_columns(state.poles, 2)])
    inner = (both.T @ both).reshape(2, size, 2, size)
    matrices = np.zeros((2, kinds, count, 2, kinds, count, 2))
    slope = np.zeros((kinds, count, 2))
    for block, fit, slopes in _slopes(data, state, inner):
        turned = np.einsum("aibj,gfbjk->gfaik", inner, slopes.turns, optimize=True)
        gram = np.einsum("gfaji,hfajk->gihk", slopes.turns, turned, optimize=True)
        gram -= np.einsum(
            "gji,jk,hkl->gihl", slopes.overlap, fit.inverse, slopes.overlap, optimize=True
        )
        gram = gram.reshape(kinds, count, 2, kinds, count, 2)
        levels, vectors = np.linalg.eigh(fit.inverse)
        spread = vectors * np.sqrt(np.maximum(levels, 0.0) * len(block.motions))
        for matrix, factors in zip(matrices, (slopes.factors, _turn_factors(spread)), strict=True):
            energies = np.einsum("ktam,qubm->ktaqub", factors, factors, optimize=True)
            matrix += np.einsum("gkahqb,ktaqub->gkthqu", gram, energies, optimize=True)
        model = np.einsum("fij,jm->fim", fit.rotations, fit.factors, optimize=True)
        second = both[:, size:].T @ block.values
        rest = np.stack([fit.products, second], axis=1) - np.einsum(
            "aij,fjm->faim", inner[:, :, 0], model, optimize=True
        )
        pulls = np.einsum("gfaji,fajm->gim", slopes.turns, rest, optimize=True)
        pulls = pulls.reshape(kinds, count, 2, -1)
        slope += np.einsum("gkam,ktam->gkt", pulls, slopes.factors, optimize=True)
    largest = np.argmax(np.abs(state.participations), axis=0)
    fixed = 2 * ((1 + largest) * count + np.arange(count))
    free = np.setdiff1d(np.arange(2 * kinds * count), np.concatenate([fixed, fixed + 1]))
    whole, noise = matrices.reshape(2, 2 * kinds * count, -1)[:, free][:, :, free]
    return whole, slope.ravel()[free], free, noise


def _advance(
    data: WeightedResponses, state: _State, step: FloatArray, free: NDArray[np.int64]
) -> tuple[ComplexArray, ComplexArray]:
    """Return poles and participations after a step of their free parts."""
    forces, count = state.participations.shape
    whole = np.zeros(2 * count * (1 + forces))
    whole[free] = step
    change = (whole[::2] + 1j * whole[1::2]).reshape(1 + forces, count)
    # a pole that would go too far goes less far, which leaves the others alone
    rates, sizes = -state.poles.real, np.abs(state.poles)
    speeds = np.maximum(
        change[0].real / (MOST_RATE * rates), np.abs(change[0]) / (MOST_SHIFT * sizes)
    )
    poles = state.poles + change[0] / np.maximum(speeds, 1.0)
    least = LEAST_WIDTH * 2.0 * np.pi * float(np.min(np.diff(data.frequencies_hz)))
    poles = np.minimum(poles.real, -least) + 1j * poles.imag
    participations = state.participations + change[1:]
    return poles, participations / np.linalg.norm(participations, axis=0)
