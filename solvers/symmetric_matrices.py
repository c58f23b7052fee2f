"""The test a matrix must pass before a symmetric solver may see it."""

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.solvers.errors import ModelError

SYMMETRY_TOLERANCE = 1e-12


def is_symmetric(matrix: FloatArray) -> bool:
    """Whether ``|A - A^T|`` stays below 1e-12 of the largest entry; False too when a value is not finite."""
    largest = np.abs(matrix).max(initial=0.0)
    if not np.isfinite(largest):
        return False
    return bool(np.abs(matrix - matrix.T).max(initial=0.0) <= SYMMETRY_TOLERANCE * largest)


def require_symmetric(matrix: FloatArray, what: str, remedy: str) -> None:
    """Refuse a matrix that a symmetric solver would silently symmetrise.

    Raises:
        ModelError: A value is not finite, or the matrix is not symmetric.
    """
    if is_symmetric(matrix):
        return
    if not np.isfinite(matrix).all():
        raise ModelError(f"the {what} matrix holds values that are not finite; look for NaN or inf in its superelements and joints")
    error = float(np.abs(matrix - matrix.T).max() / np.abs(matrix).max())
    raise ModelError(
        f"the {what} matrix is not symmetric: |A - A^T| = {error:.2g} of its largest entry, limit {SYMMETRY_TOLERANCE:g}; {remedy}"
    )
