"""Upper bounds on how much too high the natural frequencies of a reduced machine are, by the modes
that its components leave out.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve, eigh

from headstock.geometry.frames import FloatArray
from headstock.reduction.coupling.coupling import CoupledMachine
from headstock.reduction.coupling.dof_layout import turn_dofs
from headstock.reduction.superelement import Truncation, most_participation
from headstock.solvers.linear.modal_analysis import ModalResult
from headstock.solvers.second_order import SecondOrderSystem

KRYLOV_BLOCKS = 2  # a single one leaves an error of 0.1 % of the bound where the next mode is close
DEPENDENT = 1e-10  # least share of a direction outside the trial space for which it is added


@dataclass(frozen=True, eq=False)
class _FrequencyErrors:
    """Bound the difference of each natural frequency from that with every mode kept.

    Attributes:
        bounds_hz: ``(m,)`` [Hz]; NaN where there is no bound.
        by_component: Component to its part ``(m,)`` [Hz], to first order.
        beyond: For each mode, the components whose modes are complete only to below its frequency,
            so that there is no bound.
    """

    bounds_hz: FloatArray
    by_component: dict[str, FloatArray]
    beyond: tuple[tuple[str, ...], ...]


@dataclass(frozen=True, eq=False)
class TruncatedPart:
    """Describe a component that leaves modes out, with its boundary dofs as rows of the machine's
    coordinates ``(n_b, n)``.
    """

    truncation: Truncation
    rows: FloatArray


def truncated_parts(coupled: CoupledMachine) -> dict[str, TruncatedPart]:
    """List the components of a machine that leave modes out."""
    parts = {}
    for name, superelement in coupled.layout.superelements.items():
        truncation = superelement.errors.truncation
        if truncation is not None and np.isfinite(truncation.limit):
            local_rows = (
                turn_dofs(superelement, coupled.placements[name])
                @ coupled.basis[coupled.offsets[name]]
            )
            parts[name] = TruncatedPart(truncation, local_rows[: superelement.boundary_size])
    return parts


def bound_frequency_errors(
    system: SecondOrderSystem, parts: Mapping[str, TruncatedPart], modes: ModalResult
) -> _FrequencyErrors:
    """Bound the reduction error of natural frequencies.

    With every mode kept a frequency solves ``(K - lambda M - lambda^2 R(lambda)) q = 0``, with R
    the contribution of the modes left out. R grows with lambda and is at most
    ``most_participation``: with ``lambda_j`` of the reduced machine, the j-th eigenvalue of
    ``(K, M + lambda_j R)`` is a lower bound of that of the complete machine, and lambda_j is an
    upper bound. The small eigenproblem is solved in the space of the modes and of their first
    corrections ``K^-1 R q``.

    Args:
        parts: Its components that leave modes out.

    Source: Leung (1978) for the condensed dynamic stiffness; Boo, Kim and Lee (2016) for residual
    modes as an error estimator that splits
        into components; Elssel and Voss (2006) for a bound, from the cut-off alone: ``lambda /
        (omega_c^2 - lambda)``.
    """
    eigenvalues = np.where(
        np.arange(len(modes.frequencies_hz)) < modes.rigid_count,
        0.0,
        (2.0 * np.pi * modes.frequencies_hz) ** 2,
    )
    space = _trial_space(system, parts, modes)
    stiffness, mass = space.T @ system.stiffness @ space, space.T @ system.mass @ space
    inner = {
        name: TruncatedPart(part.truncation, part.rows @ space) for name, part in parts.items()
    }
    boundary_motions = {name: part.rows @ modes.shapes for name, part in parts.items()}
    bounds, beyond = np.zeros(len(eigenvalues)), []
    by_component: dict[str, FloatArray] = {name: np.zeros(len(eigenvalues)) for name in parts}
    for mode, square in enumerate(eigenvalues):
        beyond.append(
            tuple(name for name, part in parts.items() if not square < part.truncation.limit)
        )
        if beyond[-1]:
            bounds[mode] = np.nan
            continue
        if square == 0.0:
            continue
        added = {name: most_participation(part.truncation, square) for name, part in parts.items()}
        heavier = mass + square * sum(
            part.rows.T @ added[name] @ part.rows for name, part in inner.items()
        )
        lowered = eigh(stiffness, heavier, eigvals_only=True, subset_by_index=[mode, mode])[0]
        bounds[mode] = modes.frequencies_hz[mode] - np.sqrt(max(lowered, 0.0)) / (2.0 * np.pi)
        for name in parts:
            column = boundary_motions[name][:, mode]
            by_component[name][mode] = (
                0.5 * modes.frequencies_hz[mode] * square * float(column @ added[name] @ column)
            )
    return _FrequencyErrors(np.maximum(bounds, 0.0), by_component, tuple(beyond))


def _trial_space(
    system: SecondOrderSystem, parts: Mapping[str, TruncatedPart], modes: ModalResult
) -> FloatArray:
    """Return the modes ``(n, m)`` and their first corrections, M-orthonormal."""
    shapes = modes.shapes
    if not parts or not shapes.shape[1]:
        return shapes
    elastic = modes.frequencies_hz[modes.rigid_count :]
    shift = (2.0 * np.pi * float(elastic[0])) ** 2 if modes.rigid_count and len(elastic) else 0.0
    try:
        factor = cho_factor(system.stiffness + shift * system.mass)
    except np.linalg.LinAlgError:
        # dofs without mass or stiffness: the modes alone give the error to first order
        return shapes
    applied = np.sum(
        [part.rows.T @ (part.truncation.first @ (part.rows @ shapes)) for part in parts.values()],
        axis=0,
    )
    space = shapes
    for _ in range(KRYLOV_BLOCKS):
        moved = new_directions(cho_solve(factor, applied), space, system.mass)
        space, applied = np.hstack([space, moved]), system.mass @ moved
    return space


def new_directions(block: FloatArray, space: FloatArray, mass: FloatArray) -> FloatArray:
    """Return the M-orthonormal directions that a block adds to an M-orthonormal space; directions
    already in the space are dropped.

    Args:
        block: ``(n, k)`` directions of any length.
        space: ``(n, m)`` with ``space^T M space = I``.
        mass: ``M``, ``(n, n)``.

    Returns:
        ``(n, r)`` with ``r <= k``.
    """
    sizes = np.sqrt(np.einsum("ij,ij->j", block, mass @ block))
    block = block / np.where(sizes > 0.0, sizes, 1.0)
    for _ in range(2):
        block = block - space @ (space.T @ (mass @ block))
    values, vectors = np.linalg.eigh(block.T @ mass @ block)
    kept = values > DEPENDENT
    return block @ (vectors[:, kept] / np.sqrt(values[kept]))
