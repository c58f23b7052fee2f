"""Shapes measured at a few channels, expanded to all coordinates of a model."""

import numpy as np
import scipy  # whose dense solvers are loaded where they are used

from headstock.geometry.frames import FloatArray
from headstock.solvers.pairing.mode_pairing import Field

# channels do not tell motions apart that move them by less than this share of the most mobile one
INDEPENDENT = 0.02
# of the mass, at the lowest frequency: what no channel determines then rests
AT_REST = 1e-8


def expand_by_modes(measured: Field, rows: FloatArray, modes: FloatArray) -> Field:
    """Return the combinations ``(n, k)`` of computed modes that come nearest to measured shapes.

    Combinations that the channels do not tell apart are left out, so that noise is not blown up.

    Args:
        measured: ``(c, k)``.
        rows: ``(c, n)`` motion of each channel per coordinate.
        modes: ``(n, m)`` mass-normalised.

    Source: O'Callahan, Avitabile and Riemer (1989), SEREP.
    """
    return modes @ (np.linalg.pinv(rows @ modes, rcond=INDEPENDENT) @ measured)


def expand_by_stiffness(
    measured: Field,
    rows: FloatArray,
    stiffness: FloatArray,
    mass: FloatArray,
    *,
    frequencies_hz: FloatArray,
    dynamic: bool = False,
) -> Field:
    """Return the motions ``(n, k)`` with the measured ones at the channels and no force anywhere else.

    Relative motions of channels that would take frequencies far above the measured ones are noise
    and are left out.

    Args:
        measured: ``(c, k)``.
        rows: ``(c, n)`` motion of each channel per coordinate.
        stiffness: ``(n, n)``.
        mass: ``(n, n)``.
        frequencies_hz: ``(k,)`` of the shapes, above zero.
        dynamic: Inertia of the shape's own frequency counts.

    Source: Guyan (1965), static; Kidder (1973), dynamic.
    """
    squares = (2.0 * np.pi * frequencies_hz) ** 2
    # in these coordinates a motion of the highest measured frequency has the energy two
    factor = np.linalg.cholesky(stiffness + squares.max() * mass).T
    into = scipy.linalg.solve_triangular(factor, np.eye(len(factor)))
    left, sizes, right = np.linalg.svd(rows @ into, full_matrices=False)
    count = int(np.count_nonzero(sizes > INDEPENDENT * sizes.max(initial=0.0)))
    constraint = right[:count]
    motions = (left[:, :count].T @ measured) / sizes[:count, None]
    elastic, inertial = into.T @ stiffness @ into, into.T @ mass @ into
    shifts = -squares if dynamic else np.full(len(squares), AT_REST * squares.min())
    expanded = np.zeros((len(factor), measured.shape[1]), dtype=measured.dtype)
    for shift in np.unique(shifts):
        columns = np.flatnonzero(shifts == shift)
        system = np.block(
            [
                [elastic + shift * inertial, constraint.T],
                [constraint, np.zeros((count, count))],
            ]
        )
        load = np.vstack([np.zeros((len(factor), len(columns))), motions[:, columns]])
        expanded[:, columns] = np.linalg.solve(system, load)[: len(factor)]
    return into @ expanded
