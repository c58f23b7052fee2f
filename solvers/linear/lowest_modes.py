"""The lowest natural modes of a system of a few hundred dofs, no others: what a pose of a sweep needs."""

import numpy as np
from scipy.linalg import solve_triangular
from scipy.linalg.lapack import dpotrf, dsyevr, dsygst

from headstock.geometry.frames import FloatArray
from headstock.solvers.linear.modal_analysis import ModalResult, finish_modes, solve_modal
from headstock.solvers.linear.symmetric_matrices_2 import is_symmetric
from headstock.solvers.linear.symmetric_modes import BEYOND, ModalPairs, loses_digits, spreads_too_far
from headstock.solvers.second_order import SecondOrderSystem

FEW = 0.5  # of all modes: from here on all of them cost no more
WIDENING = 1.0 + 1e-12


def solve_lowest_modes(system: SecondOrderSystem, *, count: int | None = None, up_to_hz: float | None = None) -> ModalResult:
    """Like ``solve_modal``, at two thirds of its cost where few modes are wanted; dofs without mass are not counted.

    ``M x = mu K x`` is reduced by ``K = L L^T`` to one symmetric matrix, of which LAPACK finds the largest eigenvalues only. Where the
    answer may not be good enough (free motions, a wide spread) ``solve_modal`` takes over.

    Raises:
        ModelError, ConvergenceError, AccuracyError: As ``solve_modal``.

    Source: Dhillon and Parlett (2004), relatively robust representations (LAPACK ``dsyevr``).
    """
    pairs = None
    if is_symmetric(system.stiffness) and is_symmetric(system.mass):
        pairs = _largest_flexibilities(system.stiffness, system.mass, count, up_to_hz)
    if pairs is None:
        return solve_modal(system, count=count, up_to_hz=up_to_hz)
    return finish_modes(system, pairs, up_to_hz)


def _largest_flexibilities(stiffness: FloatArray, mass: FloatArray, count: int | None, up_to_hz: float | None) -> ModalPairs | None:
    size = len(mass)
    if size == 0 or (count is None and up_to_hz is None) or (count is not None and count > FEW * size):
        return None
    lower, info = dpotrf(stiffness, lower=1)
    if info != 0:
        return None
    reduced, info = dsygst(mass, lower, itype=1, lower=1)
    if info != 0:
        return None
    if up_to_hz is None:
        found = dsyevr(reduced, range="I", il=size - (count or 0) + 1, iu=size, lower=1)
    else:
        least = BEYOND / (2.0 * np.pi * up_to_hz) ** 2
        # no eigenvalue is negative, so none is larger than their sum
        found = dsyevr(reduced, range="V", vl=least, vu=max(WIDENING * float(np.trace(reduced)), 2.0 * least), lower=1)
    values, vectors, number, _, info = found
    flexibilities, vectors = values[:number], vectors[:, :number]
    if info != 0 or number == 0 or spreads_too_far(flexibilities[0], flexibilities[-1]):
        return None
    kept = number if count is None else min(number, count)
    shapes = solve_triangular(lower, vectors[:, : -kept - 1 : -1], lower=True, trans="T", check_finite=False)
    if loses_digits(stiffness, shapes[:, 0]):
        return None
    squares = 1.0 / flexibilities[: -kept - 1 : -1]
    return ModalPairs(squares, shapes * np.sqrt(squares))
