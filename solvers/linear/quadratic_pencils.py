"""The pencil ``s^2 + s C + Omega^2`` in modal coordinates: applied, all its poles by one state
matrix, and its projection on a small space.
"""

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy.linalg.lapack import dpotrf

from headstock.geometry.frames import FloatArray
from headstock.solvers.second_order import ComplexArray

NEGATIVE = 1e-12  # of the largest entry: below zero by more than this, a damper feeds energy
REAL_POLE = 1e-9
AT_REST = 1e-8  # of the radius: poles below it are at rest


@dataclass(frozen=True, eq=False)
class Pencil:
    """``Q(s) = s^2 + s C + Omega^2`` and the circle in which its poles are wanted.

    Attributes:
        eigenvalues: ``(m,)`` of Omega [rad^2/s^2].
        viscous: ``(m, m)`` C [1/s].
        radius: [rad/s].
        tolerance: Error of a pole over its size that is good enough.
    """

    eigenvalues: FloatArray
    viscous: FloatArray
    radius: float
    tolerance: float

    def apply(self, poles: ComplexArray, shapes: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
        """Return ``Q(s) x`` and ``Q'(s) x`` of poles ``(p,)`` and shapes ``(m, p)``."""
        damped = real_product(self.viscous, shapes)
        inner = (poles**2 + self.eigenvalues[:, None]) * shapes + poles * damped
        return inner, 2.0 * poles * shapes + damped

    def allowed(self, poles: ComplexArray) -> FloatArray:
        """Return the errors ``(p,)`` of poles that are good enough [rad/s]."""
        return np.asarray(self.tolerance * np.maximum(np.abs(poles), AT_REST * self.radius))


@dataclass(frozen=True, eq=False)
class ProjectedPencil:
    """All poles of the pencil on the lower modes and on columns of the outer ones.

    Attributes:
        columns: ``(k, w)`` orthonormal.
        stiffness: ``(n, n)`` on the space.
        damping: ``(n, n)``.
        poles: ``(2 n,)``.
        coordinates: ``(n, 2 n)`` of shapes in the space, of unit length.
        slopes: ``(2 n,)`` ``x^T Q'(s) x``.
        upper: Indices of poles on and above the real axis.
    """

    columns: FloatArray
    stiffness: FloatArray
    damping: FloatArray
    poles: ComplexArray
    coordinates: ComplexArray
    slopes: ComplexArray
    upper: NDArray[np.int64]

    def expand(self, coordinates: ComplexArray) -> ComplexArray:
        """Return the shapes ``(m, p)`` from coordinates ``(n, p)``."""
        lower = len(coordinates) - self.columns.shape[1]
        return np.vstack([coordinates[:lower], real_product(self.columns, coordinates[lower:])])

    def solve(
        self, poles: ComplexArray, forces: ComplexArray, skipped: NDArray[np.int64]
    ) -> ComplexArray:
        """Return ``Q(s)^-1`` on the space times forces ``(m, p)``, each without its own pole.

        Source: Tisseur and Meerbergen (2001), SIAM Review 43, 235-286, section 3.5.
        """
        lower = len(forces) - len(self.columns)
        projected = np.vstack([forces[:lower], real_product(self.columns.T, forces[lower:])])
        weights = self.slopes[:, None] * (poles - self.poles[:, None])
        weights[skipped, np.arange(len(skipped))] = np.inf
        return self.expand(self.coordinates @ ((self.coordinates.T @ projected) / weights))

    def gaps(self, picked: NDArray[np.int64]) -> FloatArray:
        """Return the distances ``(p,)`` of picked poles to the next ones [rad/s]."""
        distances = np.abs(self.poles[picked, None] - self.poles)
        distances[np.arange(len(picked)), picked] = np.inf
        return np.asarray(distances.min(axis=1, initial=np.inf))


def state_eigenpairs(
    eigenvalues: FloatArray, viscous: FloatArray
) -> tuple[ComplexArray, ComplexArray]:
    """Return all poles and shapes of ``p'' + C p' + K p = 0`` for a diagonal K ``(m,)`` or a
    symmetric one ``(m, m)``.
    """
    count = len(viscous)
    stiffness = np.diag(eigenvalues) if eigenvalues.ndim == 1 else eigenvalues
    state = np.block([[np.zeros((count, count)), np.eye(count)], [-stiffness, -viscous]])
    # balance displacement against velocity: both then have the size of the highest frequency
    scale = max(
        float(np.sqrt(np.abs(stiffness).max(initial=0.0))),
        float(np.abs(viscous).max(initial=0.0)),
        1.0,
    )
    state[:count, count:] *= scale
    state[count:, :count] /= scale
    poles, vectors = scipy.linalg.eig(state, check_finite=False)
    return np.asarray(poles, dtype=np.complex128), np.asarray(vectors[:count], dtype=np.complex128)


def takes_energy(viscous: FloatArray) -> bool:
    """Return whether damping is positive semidefinite, to within rounding."""
    shift = NEGATIVE * len(viscous) * float(np.abs(viscous).max(initial=0.0))
    _, info = dpotrf(viscous + shift * np.eye(len(viscous)), lower=1) if shift else (None, 0)
    return bool(info == 0)


def project_pencil(pencil: Pencil, columns: FloatArray) -> ProjectedPencil:
    """Return the pencil on the lower modes and on columns ``(k, w)`` of the outer ones."""
    lower = len(pencil.eigenvalues) - len(columns)
    viscous, eigenvalues = pencil.viscous, pencil.eigenvalues
    stiffness = scipy.linalg.block_diag(
        np.diag(eigenvalues[:lower]), columns.T @ (eigenvalues[lower:, None] * columns)
    )
    coupling = viscous[:lower, lower:] @ columns
    damping = np.block(
        [
            [viscous[:lower, :lower], coupling],
            [coupling.T, columns.T @ (viscous[lower:, lower:] @ columns)],
        ]
    )
    poles, coordinates = state_eigenpairs(stiffness, damping)
    # a conjugate pole says the same; but equal real ones may come as a conjugate pair
    real = np.abs(poles.imag) <= REAL_POLE * np.abs(poles)
    poles = np.where(real, poles.real + 0.0j, poles)
    coordinates = coordinates / np.linalg.norm(coordinates, axis=0)
    resisted = 2.0 * poles * coordinates + real_product(damping, coordinates)
    slopes = np.einsum("np,np->p", coordinates, resisted)
    tiny = np.finfo(float).tiny
    return ProjectedPencil(
        columns=columns,
        stiffness=stiffness,
        damping=damping,
        poles=poles,
        coordinates=coordinates,
        slopes=np.where(np.abs(slopes) > tiny, slopes, tiny),
        upper=np.flatnonzero(real | (poles.imag > 0.0)),
    )


def real_product(
    matrix: NDArray[np.floating], columns: NDArray[np.complexfloating]
) -> NDArray[np.complexfloating]:
    """Return a real matrix times complex columns as one real product, several times as fast."""
    product = matrix @ np.hstack([columns.real, columns.imag])
    return np.asarray(product[:, : columns.shape[1]] + 1j * product[:, columns.shape[1] :])
