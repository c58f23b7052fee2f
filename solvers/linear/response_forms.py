"""Frequency response as a sum over undamped modes that no damping couples, corrected statically."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray
from headstock.solvers.linear.modal_coordinates import ModalCoordinates, rigid_response
from headstock.solvers.second_order import ComplexArray

SINGULAR = 1e-11  # closer to an undamped pole than this share of it, the response is roundoff
UNSEEN = 1e-12  # a mode's share in a port below this share of the largest one is roundoff


@dataclass(frozen=True, eq=False)
class RestTerms:
    """What the elastic modes lack.

    Attributes:
        rigid: ``(n_outputs, n_inputs)`` acceleration of the rigid-body motion per unit load.
        residual: ``(n_outputs, n_inputs)`` static compliance that the modes lack.
        square: Lowest omega^2 [rad^2/s^2] where all modes are there: the residual is then roundoff, and fades with the static
            compliance beyond it; else infinite.
    """

    rigid: FloatArray
    residual: FloatArray
    square: float

    def evaluate(self, omega: FloatArray) -> FloatArray:
        """Their receptance ``(n_freq, n_outputs, n_inputs)``."""
        square = omega[:, None, None] ** 2
        fading = 1.0 if np.isinf(self.square) else (self.square / (self.square + square)) ** 2
        return np.asarray(self.residual * fading - self.rigid / square)


@dataclass(frozen=True, eq=False)
class ModalSum:
    """``sum_k r_k / (omega_k^2 - omega^2 + i (omega c_k + h_k))`` and what modes lack.

    Attributes:
        squares: ``(m,)`` of the elastic modes [rad^2/s^2].
        viscous: ``(m,)`` ``2 zeta omega_k``.
        hysteretic: ``(m,)`` ``eta omega_k^2``.
        residues: ``(m, n_outputs, n_inputs)``.
        seen: The same shape: the mode takes part.
        rest: Rigid-body motion and residual flexibility.
    """

    squares: FloatArray
    viscous: FloatArray
    hysteretic: FloatArray
    residues: FloatArray
    seen: NDArray[np.bool_]
    rest: RestTerms

    def evaluate(self, omega: FloatArray) -> ComplexArray:
        """Receptance ``(n_freq, n_outputs, n_inputs)`` at positive angular frequencies; NaN on an undamped pole that is seen."""
        square = omega[:, None] ** 2
        real, imaginary = self.squares - square, omega[:, None] * self.viscous + self.hysteretic
        singular = np.hypot(real, imaginary) <= SINGULAR * (self.squares + square)
        weights = np.where(singular, 0.0, 1.0 / np.where(singular, 1.0, real + 1j * imaginary))
        found: ComplexArray = np.tensordot(weights, self.residues + 0j, axes=1) + self.rest.evaluate(omega)
        return blank_singular(found, singular, self.seen)

    def poles(self) -> ComplexArray:
        """Pole of each mode at positive frequencies [rad/s]; of an overdamped one the slower."""
        root = np.sqrt(0.25 * self.viscous**2 - self.squares - 1j * self.hysteretic)
        return np.asarray(-0.5 * self.viscous + np.where(root.imag < 0.0, -root, root))


def sum_over_modes(coordinates: ModalCoordinates) -> ModalSum:
    """The sum over all modes; the damping of the coordinates must be diagonal."""
    bent = slice(coordinates.rigid_count, None)
    rows, loads = coordinates.outputs[:, bent], coordinates.inputs[bent]
    size = len(coordinates.squares)
    return ModalSum(
        squares=coordinates.squares[bent],
        viscous=_diagonal(coordinates.viscous, size)[bent],
        hysteretic=_diagonal(coordinates.hysteretic, size)[bent],
        residues=np.einsum("ok,ki->koi", rows, loads),
        seen=see_modes(rows, loads),
        rest=rest_terms(coordinates),
    )


def rest_terms(coordinates: ModalCoordinates) -> RestTerms:
    """What the elastic modes of a system lack."""
    rigid, moves = rigid_response(coordinates)
    lowest = float(coordinates.squares[coordinates.rigid_count :].min(initial=np.inf))
    return RestTerms(np.where(moves, rigid, 0.0), coordinates.residual, lowest if coordinates.complete else np.inf)


def see_modes(rows: ComplexArray | FloatArray, loads: ComplexArray | FloatArray) -> NDArray[np.bool_]:
    """Whether a mode takes part in each entry ``(m, n_outputs, n_inputs)``, from ``(n_outputs, m)`` and ``(m, n_inputs)``."""
    moved = np.abs(rows) > UNSEEN * np.abs(rows).max(axis=1, keepdims=True, initial=0.0)
    pushed = np.abs(loads) > UNSEEN * np.abs(loads).max(axis=0, keepdims=True, initial=0.0)
    return np.asarray(moved.T[:, :, None] & pushed[:, None, :])


def blank_singular(values: ComplexArray, singular: NDArray[np.bool_], seen: NDArray[np.bool_]) -> ComplexArray:
    """NaN in place of what a singular mode ``(n_freq, m)`` that takes part ``(m, n_outputs, n_inputs)`` has spoilt."""
    lost = np.tensordot(singular.astype(float), seen.astype(float), axes=1) > 0.0
    return np.where(lost, np.nan, values)


def _diagonal(matrix: FloatArray | None, size: int) -> FloatArray:
    return np.zeros(size) if matrix is None else np.array(matrix.diagonal())
