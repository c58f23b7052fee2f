"""Frequency response of a system whose modes are coupled by few dampers: a sum over undamped modes
and a small solve per frequency.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg.lapack import dpstrf, dsyevd

from headstock.geometry.frames import FloatArray
from headstock.solvers.linear.modal_coordinates import ModalCoordinates, damps_rigid_motion
from headstock.solvers.linear.quadratic_poles import find_lowest_poles, state_eigenpairs
from headstock.solvers.linear.response_forms import SINGULAR, UNSEEN, RestTerms, rest_terms
from headstock.solvers.second_order import ComplexArray

LARGEST_RANK = 1.0 / 8.0  # dampers over modes: from here on a sum over poles costs no more
MANY_DAMPERS = 1.0 / 3.0  # the same: from here on a solve per frequency costs no more
ROUNDOFF = 1e-13  # of the largest entry: what a factorisation of the damping may leave
# |omega_k^2 - omega^2| over omega^2 below which a mode is not eliminated: it would cost as many
# digits
NEAR = 1e-3
PEAK_TOLERANCE = 1e-9  # of a pole, where it only says where a peak is
BLOCK = 4_000_000  # entries of the products of dampers that are kept at a time


@dataclass(frozen=True, eq=False)
class _CoupledDampers:
    """Damping in modal coordinates as ``diag(diagonal) + factors diag(strengths) factors^T``.

    Attributes:
        diagonal: ``(m,)``.
        factors: ``(m, r)``.
        strengths: ``(r,)``.
    """

    diagonal: FloatArray
    factors: FloatArray
    strengths: FloatArray


@dataclass(frozen=True, eq=False)
class DamperSum:
    """``L (diag(omega_k^2 - omega^2 + i (omega c_k + h_k)) + i (omega C + H))^-1 B`` with C and H
    of few dampers.

    Attributes:
        eigenvalues: ``(m,)`` omega^2 [rad^2/s^2] of the modes that take part: all elastic ones, and
            rigid-body modes that are damped.
        loads: ``(m, n_inputs)``.
        rows: ``(n_outputs, m)``.
        hysteretic: Losses of stiffness.
        rest: Rigid-body motion and residual flexibility.
    """

    eigenvalues: FloatArray
    loads: FloatArray
    rows: FloatArray
    viscous: _CoupledDampers
    hysteretic: _CoupledDampers
    rest: RestTerms

    def evaluate(self, omega: FloatArray) -> ComplexArray:
        """Return the receptance ``(n_freq, n_outputs, n_inputs)`` at positive angular frequencies;
        NaN on an undamped pole that is seen.
        """
        lines = max(1, BLOCK // max(1, len(self.eigenvalues)))
        parts = [
            self._evaluate_block(omega[start : start + lines])
            for start in range(0, len(omega), lines)
        ]
        return np.concatenate(parts) + self.rest.evaluate(omega)

    def poles(self, below: float | None = None) -> ComplexArray:
        """Return the poles at positive frequencies, and real ones [rad/s]; structural damping as a
        viscous one of the same loss per cycle.

        Args:
            below: Only those of modes up to this angular frequency [rad/s]; None for all.
        """
        omega = np.sqrt(self.eigenvalues)
        damping = _whole(self.viscous)
        flexible = np.flatnonzero(omega > 0.0)
        damping[np.ix_(flexible, flexible)] += _whole(self.hysteretic)[
            np.ix_(flexible, flexible)
        ] / np.sqrt(np.outer(omega[flexible], omega[flexible]))
        wanted = len(omega) if below is None else int(np.count_nonzero(omega <= below))
        few = find_lowest_poles(self.eigenvalues, damping, wanted, tolerance=PEAK_TOLERANCE)
        poles, _ = state_eigenpairs(self.eigenvalues, damping) if few is None else few
        return poles[poles.imag >= 0.0]

    def _evaluate_block(self, omega: FloatArray) -> ComplexArray:
        """Eliminate the modes far from each frequency, and solve for those near it."""
        square = omega[:, None] ** 2
        dynamic = (
            self.eigenvalues
            - square
            + 1j * (omega[:, None] * self.viscous.diagonal + self.hysteretic.diagonal)
        )
        near = (np.abs(self.eigenvalues - square) < NEAR * square) | (self.eigenvalues == 0.0)
        factors = np.hstack([self.viscous.factors, self.hysteretic.factors])
        still = np.ones((len(omega), 1)) * self.hysteretic.strengths
        weights = 1j * np.hstack([omega[:, None] * self.viscous.strengths, still])
        far = np.where(near, 0.0, 1.0 / np.where(near, 1.0, dynamic))
        plain = _products(far, self.rows.T, self.loads)
        stretched = _products(far, factors, self.loads)
        coupled = _products(far, self.rows.T, factors)
        # Woodbury: forces of the dampers on the far modes, f = (1 + W F^T g F)^-1 W F^T (...)
        coupling = weights[:, :, None] * _squares(far, factors)
        coupling[:, np.arange(factors.shape[1]), np.arange(factors.shape[1])] += 1.0
        receptance = plain - coupled @ np.linalg.solve(coupling, weights[:, :, None] * stretched)
        for line in np.flatnonzero(near.any(axis=1)):
            # G is nearly infinite for modes near a line: they stay unknowns, and the far ones are
            # eliminated from their equations
            near_modes = np.flatnonzero(near[line])
            local = factors[near_modes]
            forces = np.linalg.solve(
                coupling[line], weights[line, :, None] * np.hstack([local.T, stretched[line]])
            )
            matrix = np.asarray(
                np.diag(dynamic[line, near_modes]) + local @ forces[:, : len(near_modes)],
                dtype=complex,
            )
            loads = self.loads[near_modes] - local @ forces[:, len(near_modes) :]
            rows = self.rows[:, near_modes] - coupled[line] @ forces[:, : len(near_modes)]
            receptance[line] += self._solve_near(matrix + 0j, rows, loads, float(square[line, 0]))
        return receptance

    def _solve_near(
        self,
        matrix: ComplexArray,
        rows: ComplexArray | FloatArray,
        loads: ComplexArray | FloatArray,
        square: float,
    ) -> ComplexArray:
        """Answer of the modes near a frequency; NaN where an undamped one lies exactly there."""
        left, sizes, right = np.linalg.svd(matrix)
        resting = sizes <= 2.0 * SINGULAR * square
        inverse = np.where(resting, 0.0, 1.0 / np.where(resting, 1.0, sizes))
        given, observed = left.conj().T @ loads, rows @ right.conj().T
        response = (observed * inverse) @ given
        if resting.any():
            reach = np.abs(self.rows).max(axis=1, initial=0.0)
            push = np.abs(self.loads).max(axis=0, initial=0.0)
            moved = np.abs(observed[:, resting]) > UNSEEN * reach[:, None]
            excited = np.abs(given[resting]) > UNSEEN * push
            response[(moved.astype(float) @ excited.astype(float)) > 0.0] = np.nan
        return np.asarray(response)


def sum_over_dampers(
    coordinates: ModalCoordinates, largest_rank: float = LARGEST_RANK
) -> DamperSum | None:
    """Return the sum for damping of low rank; None where too many dampers couple the modes.

    Low rank is what is left of a damping matrix when damping that couples no modes (one damping
    ratio, one loss factor, one mass- or stiffness-proportional part for most of the machine) is
    taken out.

    Args:
        largest_rank: Dampers over modes.

    Source: Woodbury (1950), Inverting modified matrices; Ozguven (1987), J. Sound Vib. 117,
    313-328, for structural modifications of
        receptances.
    """
    undamped = not damps_rigid_motion(coordinates)
    taken = slice(coordinates.rigid_count if undamped else 0, None)
    omega = coordinates.omega[taken]
    viscous = _split(coordinates.viscous, taken, omega, (0.5, 0.0, 1.0), largest_rank)
    hysteretic = _split(coordinates.hysteretic, taken, omega, (1.0,), largest_rank)
    if (
        viscous is None
        or hysteretic is None
        or len(viscous.strengths) + len(hysteretic.strengths) > largest_rank * len(omega)
    ):
        return None
    rest = rest_terms(coordinates)
    return DamperSum(
        eigenvalues=coordinates.eigenvalues[taken],
        loads=coordinates.inputs[taken],
        rows=coordinates.outputs[:, taken],
        viscous=viscous,
        hysteretic=hysteretic,
        rest=rest if undamped else RestTerms(np.zeros_like(rest.rigid), rest.residual, rest.square),
    )


def _products(far: ComplexArray, left: FloatArray, right: FloatArray) -> ComplexArray:
    """Return ``left^T diag(far) right`` for each frequency: ``(n_freq, n_left, n_right)``."""
    flat = np.einsum("mi,mj->mij", left, right).reshape(len(left), -1)
    return _weighed(far, flat).reshape(len(far), left.shape[1], right.shape[1])


def _squares(far: ComplexArray, factors: FloatArray) -> ComplexArray:
    """Return ``factors^T diag(far) factors`` for each frequency ``(n_freq, r, r)``: one product for
    many frequencies, else one for each.
    """
    rank = factors.shape[1]
    if len(far) < rank:
        return np.array([_weighed(factors.T * line, factors) for line in far]).reshape(
            len(far), rank, rank
        )
    upper = np.triu_indices(rank)
    half = _weighed(far, factors[:, upper[0]] * factors[:, upper[1]])
    places = np.zeros((rank, rank), dtype=np.int64)
    places[upper] = places.T[upper] = np.arange(half.shape[1])
    return np.take(half, places.ravel(), axis=1).reshape(len(far), rank, rank)


def _weighed(weights: ComplexArray, matrix: FloatArray) -> ComplexArray:
    """Return a complex matrix times a real one, without the product of an imaginary part that is
    not there.
    """
    # the parts of a complex array are strided, for which there is no fast product
    real, imaginary = np.ascontiguousarray(weights.real), np.ascontiguousarray(weights.imag)
    product = np.asarray(real @ matrix, dtype=np.complex128)
    if np.any(imaginary):
        product += 1j * (imaginary @ matrix)
    return product


def _whole(dampers: _CoupledDampers) -> FloatArray:
    return np.diag(dampers.diagonal) + (dampers.factors * dampers.strengths) @ dampers.factors.T


def _split(
    matrix: FloatArray | None,
    taken: slice,
    omega: FloatArray,
    powers: tuple[float, ...],
    largest_rank: float,
) -> _CoupledDampers | None:
    """Return the damping of few dampers, apart from one that is proportional to a power of the
    modes' frequencies.
    """
    count = len(omega)
    if matrix is None:
        return _CoupledDampers(np.zeros(count), np.zeros((count, 0)), np.zeros(0))
    block = matrix[taken, taken]
    limit = ROUNDOFF * count * float(np.abs(block).max(initial=0.0))
    factor, pivots, rank, _ = dpstrf(block, tol=limit, lower=1)
    if rank <= largest_rank * count:
        factors = np.zeros((count, rank))
        factors[np.asarray(pivots) - 1] = np.tril(factor)[:, :rank]
        if np.abs(block - factors @ factors.T).max(initial=0.0) <= limit:
            return _CoupledDampers(np.zeros(count), factors, np.ones(rank))
    for power in powers:
        if power > 0.0 and not omega.min(initial=np.inf) > 0.0:
            continue
        scale = omega**power
        levels, vectors, info = dsyevd(block / np.outer(scale, scale))
        if info != 0:
            continue
        common = float(np.median(levels))
        roundoff = ROUNDOFF * len(levels) * np.abs(levels).max(initial=0.0)
        apart = np.flatnonzero(np.abs(levels - common) > roundoff)
        dampers = _CoupledDampers(
            common * scale**2, scale[:, None] * vectors[:, apart], levels[apart] - common
        )
        if (
            len(dampers.strengths) <= largest_rank * count
            and np.abs(block - _whole(dampers)).max(initial=0.0) <= limit
        ):
            return dampers
    return None
