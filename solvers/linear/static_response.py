"""Static displacements of any second-order system."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from headstock.geometry.frames import BoolArray, FloatArray
from headstock.meshing.scipy_library import scipy
from headstock.solvers.errors import AccuracyError, ModelError
from headstock.solvers.linear.sparse_systems import factorise_sparse, find_sparse
from headstock.solvers.linear.symmetric_matrices import (
    DEAD_DIAGONAL,
    EPS,
    PIVOT_FACTOR,
    IntArray,
    NullSpace,
    absolute_product,
    find_null_space,
    is_symmetric,
    require_symmetric,
)
from headstock.solvers.second_order import SecondOrderSystem

RESIDUAL_LIMIT = 1e-10
WORK_LIMIT = 1e-9  # of the size of load and motion: less work than this is roundoff


@dataclass(frozen=True, eq=False)
class StaticResult:
    """Static displacements.

    Attributes:
        displacements: ``(n, m)`` generalised displacements, one column per load case.
        residual: Largest ``|K q - f|`` against the terms it is made of.
    """

    displacements: FloatArray
    residual: float


def solve_static(system: SecondOrderSystem, loads: FloatArray) -> StaticResult:
    """Return the displacements under static loads.

    Args:
        system: Its stiffness must hold every motion; a control term may make it unsymmetric.
        loads: ``(n,)`` or ``(n, m)`` generalised loads.

    Raises:
        ModelError: The system is a mechanism or statically unstable.
        AccuracyError: The residual is too large.
    """
    loads = np.asarray(loads, dtype=float)
    columns = loads[:, None] if loads.ndim == 1 else loads
    if not np.isfinite(columns).all():
        raise ModelError("a static load holds values that are not finite")
    solve = _solve_symmetric if is_symmetric(system.stiffness) else _solve_general
    displacements = solve(system, columns)
    residual = _residual(system.stiffness, displacements, columns)
    if not residual <= RESIDUAL_LIMIT:
        raise AccuracyError(
            f"the static solution leaves a residual of {residual:.2g}, limit {RESIDUAL_LIMIT:g}; "
            "look for joint stiffnesses that differ by more than 14 decades"
        )
    return StaticResult(displacements.reshape(loads.shape), residual)


def solve_pinned(system: SecondOrderSystem, free: IntArray, loads: FloatArray) -> FloatArray:
    """Return the displacements ``(n, m)`` under loads ``(n, m)`` with all but some dofs at rest."""
    fixed = np.ix_(free, free)
    labels = tuple(system.labels[int(dof)] for dof in free)
    inner = SecondOrderSystem(system.mass[fixed], None, system.stiffness[fixed], {}, {}, labels)
    displacements = np.zeros_like(loads)
    displacements[free] = solve_static(inner, loads[free]).displacements
    return displacements


@dataclass(frozen=True, eq=False)
class BalancedResult:
    """Static displacements of a system that may leave motions free.

    Attributes:
        displacements: ``(n, m)``; of several answers that differ by a free motion the one with the
            dofs ``free.pinned`` at rest, zero for a load that has none.
        balanced: ``(m,)`` the load does no work on the free motions, so that it has an answer.
        weights: ``(n,)`` stiffness of each dof, by which motions and loads in different units are
            compared.
    """

    displacements: FloatArray
    balanced: BoolArray
    free: NullSpace
    weights: FloatArray

    def determines(self, rows: FloatArray) -> BoolArray:
        """Return whether outputs ``(k, n)`` are the same in all answers: they do not move in a free
        motion.
        """
        return _does_no_work(rows.T, self.free.vectors, self.weights)


def solve_balanced(system: SecondOrderSystem, loads: FloatArray) -> BalancedResult:
    """Return the static displacements under those loads that do no work on the motions that nothing
    holds.

    Args:
        system: Symmetric where motions are free.
        loads: ``(n, m)`` generalised loads.

    Raises:
        ModelError: The system is statically unstable.
        AccuracyError: The residual is too large.

    Source: Geradin and Rixen (2015), section 2.6 (solvability condition and pseudo-inverse of a
    free structure).
    """
    weights = np.array(system.stiffness.diagonal())
    every = np.ones(loads.shape[1], dtype=bool)
    try:
        static = solve_static(system, loads).displacements
        return BalancedResult(
            static,
            every,
            NullSpace(np.zeros((len(weights), 0)), np.zeros(0, int), np.arange(len(weights))),
            weights,
        )
    except ModelError:
        null = find_null_space(system.stiffness)
        if not null.dimension:
            raise
    weights = np.where(
        weights > 0.0, weights, np.median(weights[weights > 0.0]) if (weights > 0.0).any() else 1.0
    )
    balanced = _does_no_work(loads, null.vectors, weights)
    displacements = np.zeros(loads.shape)
    if balanced.any():
        displacements[:, balanced] = solve_pinned(system, null.free, loads[:, balanced])
    return BalancedResult(displacements, balanced, null, weights)


def _does_no_work(loads: FloatArray, motions: FloatArray, weights: FloatArray) -> BoolArray:
    """Return whether each load ``(n, m)`` does no work on any motion ``(n, r)`` but roundoff."""
    size = np.sqrt(weights)[:, None]
    reach = np.linalg.norm(motions * size, axis=0)[:, None] * np.linalg.norm(loads / size, axis=0)
    return np.asarray((np.abs(motions.T @ loads) <= WORK_LIMIT * reach).all(axis=0))


def _solve_symmetric(system: SecondOrderSystem, loads: FloatArray) -> FloatArray:
    stiffness = system.stiffness
    diagonal = np.array(stiffness.diagonal())
    if not len(diagonal):
        return np.zeros_like(loads)
    if diagonal.min() <= DEAD_DIAGONAL * diagonal.max():
        _raise_if_mechanism(stiffness, system.labels)
    sparse = find_sparse(stiffness)
    thin = None if sparse is None else factorise_sparse(sparse)
    if thin is not None and not thin.negative:
        if thin.reciprocal_condition() < _least_condition(len(diagonal)):
            _raise_if_mechanism(stiffness, system.labels)
        return thin.solve(loads)
    scale = 1.0 / np.sqrt(diagonal)
    scaled = stiffness * scale * scale[:, None]
    factor, info = scipy.linalg.lapack.dpotrf(scaled, lower=1)
    suspect = info != 0
    if not suspect:
        reciprocal, _ = scipy.linalg.lapack.dpocon(
            factor, np.abs(scaled).sum(axis=0).max(), uplo="L"
        )
        suspect = reciprocal < _least_condition(len(scale))
    if suspect:
        _raise_if_mechanism(stiffness, system.labels)
    if info != 0:
        raise ModelError(
            "the stiffness matrix is not positive definite; look for joint stiffnesses that differ by more than 14 decades"
        )
    solution = scale[:, None] * scipy.linalg.cho_solve((factor, True), scale[:, None] * loads)
    correction = loads - stiffness @ solution
    return np.asarray(
        solution
        + scale[:, None] * scipy.linalg.cho_solve((factor, True), scale[:, None] * correction)
    )


def _least_condition(size: int) -> float:
    """Return the reciprocal condition below which a matrix may be singular but for roundoff."""
    return PIVOT_FACTOR * size * EPS * size


def _raise_if_mechanism(stiffness: FloatArray, labels: Sequence[str]) -> None:
    """Refuse a stiffness matrix that leaves motions free.

    Raises:
        ModelError: Names how many motions are free and the dofs that move most.
    """
    null = find_null_space(stiffness)
    if null.dimension:
        dofs = sorted({labels[int(i)] for i in null.pinned})
        raise ModelError(
            f"{null.dimension} rigid motion(s) are free, so there is no static answer; they move {', '.join(dofs)}: "
            "hold them by a joint or a support"
        )


def _solve_general(system: SecondOrderSystem, loads: FloatArray) -> FloatArray:
    try:
        return np.asarray(np.linalg.solve(system.stiffness, loads))
    except np.linalg.LinAlgError as error:
        require_symmetric(
            system.stiffness, "stiffness", "and it is singular: a rigid motion is free"
        )
        raise ModelError("the stiffness matrix is singular") from error


def _residual(stiffness: FloatArray, displacements: FloatArray, loads: FloatArray) -> float:
    """Return the largest backward error over the columns (Oettli and Prager 1964, by columns)."""
    residual = np.abs(stiffness @ displacements - loads).max(axis=0, initial=0.0)
    terms = (absolute_product(stiffness, displacements) + np.abs(loads)).max(axis=0, initial=0.0)
    return float((residual / np.maximum(terms, np.finfo(float).tiny)).max(initial=0.0))
