"""The test a matrix must pass before a symmetric solver may see it."""

import numpy as np

from headstock.geometry.frames import FloatArray
from headstock.solvers.errors import ModelError

SYMMETRY_TOLERANCE = 1e-12
PIECE = 256  # rows looked at together, so that large matrices are not copied


def is_symmetric(matrix: FloatArray) -> bool:
    """Whether ``|A - A^T|`` stays below 1e-12 of the largest entry; False too when a value is not finite."""
    # without copies of the matrix; what is not a number stays one in a sum
    largest = max(matrix.max(initial=0.0), -matrix.min(initial=0.0))
    if not np.isfinite(largest):
        return False
    pieces = (slice(start, start + PIECE) for start in range(0, len(matrix), PIECE))
    return all(np.abs(matrix[piece] - matrix[:, piece].T).max() <= SYMMETRY_TOLERANCE * largest for piece in pieces)


def symmetrise(matrix: FloatArray) -> FloatArray:
    """``(A + A^T) / 2`` in the place of ``A``, which is given back."""
    for start in range(0, len(matrix), PIECE):
        piece, rest = slice(start, start + PIECE), slice(start, None)
        half = 0.5 * (matrix[piece, rest] + matrix[rest, piece].T)
        matrix[piece, rest] = half
        matrix[rest, piece] = half.T
    return matrix


def absolute_product(matrix: FloatArray, vectors: FloatArray) -> FloatArray:
    """``|A| |x|``: the size of the terms of a product."""
    sizes = np.abs(vectors)
    parts = [np.abs(matrix[start : start + PIECE]) @ sizes for start in range(0, len(matrix), PIECE)]
    return np.concatenate(parts) if parts else sizes


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
