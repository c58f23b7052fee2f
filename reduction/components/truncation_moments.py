"""The moments of the fixed-interface modes that a reduction leaves out, with the factorisation at hand."""

import dataclasses

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.reduction.components.fixed_interface_modes import FixedInterfaceModes
from headstock.reduction.truncation import Truncation, lowest_participating
from headstock.solvers.elastic.constrained_solver import ConstrainedSolver

COLUMNS = 48  # at a time: what products take beside the solution


def measure_truncation(solver: ConstrainedSolver, psi: FloatArray, modes: FixedInterfaceModes) -> Truncation:
    """Moments of the modes left out, by one solve per boundary dof.

    ``X = K^-1 M psi`` in the space of the fixed-interface modes, less its part along those kept, has the energies
    ``X^T K X = X^T M psi = sum p_k p_k^T / omega_k^2`` and ``X^T M X = sum p_k p_k^T / omega_k^4`` over those left out.

    Args:
        solver: With the interfaces fixed; collective.
        psi: ``(3 n_owned, n_b)`` constraint modes.
        modes: Fixed-interface modes kept.

    Source: Kim and Lee (2015), residual substructural modes as the error of a Craig-Bampton basis.
    """
    operators, boundary = solver.operators, psi.shape[1]
    if not np.isfinite(modes.cutoff_hz):
        return Truncation(np.zeros((boundary, boundary)), np.zeros((boundary, boundary)), np.inf)
    weighted = operators.apply_mass(psi)
    rest = solver.apply(weighted)
    if modes.shapes.shape[1]:
        rest -= modes.shapes @ (solver.product(modes.shapes, weighted) / modes.eigenvalues[:, None])
    # K rest is M psi less what lies along the modes kept and what holds the interfaces, and rest is free of both
    first, second = solver.product(rest, weighted), np.zeros((boundary, boundary))
    for start in range(0, boundary, COLUMNS):
        part = slice(start, start + COLUMNS)
        second[:, part] = solver.product(rest, operators.apply_mass(rest[:, part]))
    found = Truncation(0.5 * (first + first.T), 0.5 * (second + second.T), (2.0 * np.pi * modes.cutoff_hz) ** 2)
    if modes.cutoff_hz > 0.0:
        return found
    return dataclasses.replace(found, limit=lowest_participating(found.first, found.second))
