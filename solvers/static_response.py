"""Static displacements of any second-order system."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_solve
from scipy.linalg.lapack import dpocon, dpotrf

from headstock.geometry.frames import FloatArray
from headstock.solvers.errors import AccuracyError, ModelError
from headstock.solvers.null_space import EPS, PIVOT_FACTOR, find_null_space
from headstock.solvers.second_order import SecondOrderSystem
from headstock.solvers.symmetric_matrices import is_symmetric, require_symmetric

RESIDUAL_LIMIT = 1e-10


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
    """Displacements under static loads.

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


def _solve_symmetric(system: SecondOrderSystem, loads: FloatArray) -> FloatArray:
    stiffness = system.stiffness
    diagonal = np.array(stiffness.diagonal())
    if not len(diagonal):
        return np.zeros_like(loads)
    if diagonal.min() <= 0.0:
        raise_if_mechanism(stiffness, system.labels)
    scale = 1.0 / np.sqrt(diagonal)
    scaled = stiffness * scale * scale[:, None]
    factor, info = dpotrf(scaled, lower=1)
    suspect = info != 0
    if not suspect:
        reciprocal, _ = dpocon(factor, np.abs(scaled).sum(axis=0).max(), uplo="L")
        suspect = reciprocal < PIVOT_FACTOR * len(scale) * EPS * len(scale)
    if suspect:
        raise_if_mechanism(stiffness, system.labels)
    if info != 0:
        raise ModelError(
            "the stiffness matrix is not positive definite; look for joint stiffnesses that differ by more than 14 decades"
        )
    solution = scale[:, None] * cho_solve((factor, True), scale[:, None] * loads)
    correction = loads - stiffness @ solution
    return np.asarray(solution + scale[:, None] * cho_solve((factor, True), scale[:, None] * correction))


def raise_if_mechanism(stiffness: FloatArray, labels: Sequence[str]) -> None:
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
        require_symmetric(system.stiffness, "stiffness", "and it is singular: a rigid motion is free")
        raise ModelError("the stiffness matrix is singular") from error


def _residual(stiffness: FloatArray, displacements: FloatArray, loads: FloatArray) -> float:
    """Largest backward error over the columns (Oettli and Prager 1964, by columns)."""
    residual = np.abs(stiffness @ displacements - loads).max(axis=0, initial=0.0)
    terms = (np.abs(stiffness) @ np.abs(displacements) + np.abs(loads)).max(axis=0, initial=0.0)
    return float((residual / np.maximum(terms, np.finfo(float).tiny)).max(initial=0.0))
