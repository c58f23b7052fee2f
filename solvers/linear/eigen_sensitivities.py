"""Derivatives of natural frequencies, mode shapes and static compliances of a small dense system.

No eigenvalue is ever differenced: where two of them meet or change places, only the matrices are asked how they change.

Source: Fox and Kapoor (1968) for eigenvalues; Nelson (1976) for shapes, with every mode of a cluster in the border
(Mills-Curran 1988), so that repeated eigenvalues leave the system solvable.
"""

import numpy as np
from scipy.linalg import lu_factor, lu_solve

from headstock.geometry.frames import FloatArray

CLUSTER_GAP = 1e-7  # eigenvalues closer than this share of themselves are one cluster: their shapes may turn into each other


def slope_squares(shapes: FloatArray, forces: FloatArray) -> FloatArray:
    """Derivatives ``(m,)`` of ``omega^2`` by one parameter.

    Args:
        shapes: ``(n, m)`` mass-normalised mode shapes ``phi_i``.
        forces: ``(n, m)`` column ``(dK - omega_i^2 dM) phi_i`` for each mode.
    """
    return np.asarray(np.einsum("ij,ij->j", shapes, forces))


def slope_compliance(motion: FloatArray, force: FloatArray, stiffness_slope: FloatArray) -> float:
    """Derivative of ``a^T K^-1 b`` with fixed a and b: ``-v^T dK u`` for ``u = K^-1 b`` and ``v = K^-1 a``, both ``(n,)``."""
    return -float(motion @ stiffness_slope @ force)


def slope_shape(
    stiffness: FloatArray,
    mass: FloatArray,
    squares: FloatArray,
    shapes: FloatArray,
    index: int,
    slopes: tuple[FloatArray, FloatArray],
) -> FloatArray:
    """Derivatives ``(n, p)`` of one mass-normalised mode shape by p parameters.

    In a cluster of repeated eigenvalues the part that turns the shapes of the cluster into each other is left out: it has no
    definite value.

    Args:
        stiffness: ``(n, n)``.
        mass: ``(n, n)``.
        squares: ``(m,)`` omega^2 [rad^2/s^2].
        shapes: ``(n, m)`` mass-normalised.
        index: Which mode.
        slopes: ``(dK - omega^2 dM) phi`` of that mode for each parameter ``(n, p)``, and ``phi^T dM phi`` ``(p,)``.
    """
    forces, mass_terms = slopes
    square = float(squares[index])
    cluster = np.flatnonzero(np.abs(squares - square) <= CLUSTER_GAP * abs(square))
    held = mass @ shapes[:, cluster]
    count, size = len(cluster), len(mass)
    system = np.zeros((size + count, size + count))
    # the border in the units of the stiffness, so that the factorisation sees one scale
    border = held * np.sqrt(np.abs(stiffness.diagonal()).mean() / np.einsum("ij,ij->", held, held))
    system[:size, :size] = stiffness - square * mass
    system[:size, size:], system[size:, :size] = border, border.T
    right = np.zeros((size + count, forces.shape[1]))
    right[:size] = held @ (shapes[:, cluster].T @ forces) - forces
    turned = lu_solve(lu_factor(system, check_finite=False), right, check_finite=False)[:size]
    return np.asarray(turned - 0.5 * np.outer(shapes[:, index], mass_terms))
