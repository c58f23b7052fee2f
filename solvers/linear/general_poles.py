"""Poles of any linear second-order system: unsymmetric terms, dofs without mass and structural damping included."""

import numpy as np
import scipy.linalg

from headstock.solvers.linear.symmetric_matrices import EPS
from headstock.solvers.second_order import ComplexArray, SecondOrderSystem

INFINITE = 16.0 * EPS


def find_poles(system: SecondOrderSystem) -> ComplexArray:
    """All finite poles ``(p,)`` [rad/s], rising in size; conjugate pairs stand twice.

    Structural damping is taken as it acts at positive frequencies, so that with it only poles above the real axis mean anything.

    Args:
        system: Any; nothing is symmetrised.

    Source: Tisseur and Meerbergen (2001), The quadratic eigenvalue problem, section 3.4 (first companion form) and section 5.1
        (scaling of Fan, Lin and Van Dooren 2004); Moler and Stewart (1973), QZ.
    """
    size = len(system.mass)
    stiffness = system.stiffness + (0.0 if system.hysteretic is None else 1j * system.hysteretic)
    damping = np.zeros((size, size)) if system.damping is None else system.damping
    stiff, heavy = float(np.abs(stiffness).max(initial=0.0)), float(np.abs(system.mass).max(initial=0.0))
    # s = scale z makes stiffness and mass equally large
    scale = np.sqrt(stiff / heavy) if stiff > 0.0 and heavy > 0.0 else 1.0
    level = max(stiff, heavy * scale**2) or 1.0
    zero, unit = np.zeros((size, size)), np.eye(size)
    left = np.block([[zero, unit], [-stiffness / level, -damping * (scale / level)]])
    right = np.block([[unit, zero], [zero, system.mass * (scale**2 / level)]])
    numerator, denominator = scipy.linalg.eigvals(left, right, homogeneous_eigvals=True, check_finite=False)
    finite = np.abs(denominator) > INFINITE * (np.abs(numerator) + np.abs(denominator))
    poles = scale * numerator[finite] / denominator[finite]
    return np.asarray(poles[np.argsort(np.abs(poles), kind="stable")])
