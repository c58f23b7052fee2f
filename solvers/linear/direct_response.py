"""Frequency response by one dense solve per frequency: slow, and right for any linear system."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg.lapack import zgecon, zgetrf, zgetrs

from headstock.geometry.frames import FloatArray
from headstock.solvers.linear.general_poles import find_poles
from headstock.solvers.linear.symmetric_matrices import EPS
from headstock.solvers.second_order import ComplexArray, SecondOrderSystem

SINGULAR_FACTOR = 16.0


@dataclass(frozen=True, eq=False)
class DirectResponse:
    """``L (K + i H + i omega C - omega^2 M)^-1 B``.

    Attributes:
        system: Its matrices may be unsymmetric.
        loads: ``(n, n_inputs)`` B.
        rows: ``(n_outputs, n)`` L.
    """

    system: SecondOrderSystem
    loads: FloatArray
    rows: FloatArray

    def evaluate(self, omega: FloatArray) -> ComplexArray:
        """Receptance ``(n_freq, n_outputs, n_inputs)`` at positive angular frequencies; NaN where the matrix is singular."""
        shape = (len(omega), len(self.rows), self.loads.shape[1])
        return np.array([self.rows @ self._displacements(float(value)) for value in omega]).reshape(shape)

    def poles(self) -> ComplexArray:
        """Poles at positive frequencies, and real ones [rad/s]."""
        found = find_poles(self.system)
        return np.asarray(found[found.imag >= 0.0])

    def _displacements(self, omega: float) -> ComplexArray:
        """Displacements ``(n, n_inputs)``; rows and columns scaled by the size of their own terms, one step of refinement."""
        system = self.system
        matrix = system.stiffness - omega**2 * system.mass + 0j
        if system.damping is not None:
            matrix += 1j * omega * system.damping
        if system.hysteretic is not None:
            matrix += 1j * system.hysteretic
        size = np.abs(system.stiffness.diagonal()) + omega**2 * np.abs(system.mass.diagonal())
        scale = 1.0 / np.sqrt(np.where(size > 0.0, size, 1.0))
        scaled = matrix * scale * scale[:, None]
        factor, pivots, info = zgetrf(scaled)
        reciprocal, _ = zgecon(factor, np.abs(scaled).sum(axis=0).max(initial=0.0)) if info == 0 else (0.0, 0)
        if not reciprocal > SINGULAR_FACTOR * EPS:
            return np.full(self.loads.shape, np.nan + 0j)
        right = scale[:, None] * self.loads + 0j
        found, _ = zgetrs(factor, pivots, right)
        correction, _ = zgetrs(factor, pivots, right - scaled @ found)
        return np.asarray(scale[:, None] * (found + correction))
