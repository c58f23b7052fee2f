"""Frequency response as a sum over the poles of a system whose damping couples its modes."""

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from headstock.geometry.frames import FloatArray
from headstock.solvers.errors import AccuracyError
from headstock.solvers.linear.modal_coordinates import ModalCoordinates
from headstock.solvers.linear.response_forms import SINGULAR, RestTerms, blank_singular, rest_terms, see_modes
from headstock.solvers.second_order import ComplexArray

CONDITION_LIMIT = 1e6  # of the eigenvectors: critically damped modes have hardly two of them


@dataclass(frozen=True, eq=False)
class PoleSum:
    """``sum_k r_k mu_k / (1 - sigma mu_k)`` and what modes lack; sigma is ``i omega``, or ``omega^2`` without viscous damping.

    Attributes:
        flexibilities: ``(p,)`` mu, inverse poles: the slow ones, which matter, then come out to machine precision.
        residues: ``(p, n_outputs, n_inputs)``.
        seen: The same shape: the pole takes part.
        rest: Rigid-body motion and residual flexibility.
        first_order: sigma is ``i omega``.
    """

    flexibilities: ComplexArray
    residues: ComplexArray
    seen: NDArray[np.bool_]
    rest: RestTerms
    first_order: bool

    def evaluate(self, omega: FloatArray) -> ComplexArray:
        """Receptance ``(n_freq, n_outputs, n_inputs)`` at positive angular frequencies; NaN on an undamped pole that is seen."""
        sigma = 1j * omega if self.first_order else omega**2 + 0j
        product = sigma[:, None] * self.flexibilities
        singular = np.abs(1.0 - product) <= SINGULAR
        weights = np.where(singular, 0.0, self.flexibilities / np.where(singular, 1.0, 1.0 - product))
        if self.first_order:
            # above all poles, with sum r_k = 0 (a load does not jump the displacement), which the plain sum loses digits to find
            above = np.abs(product).min(axis=1, initial=np.inf) > 1.0
            weights[above] = 1.0 / (1j * omega[above, None] * (1.0 - product[above]))
        found = np.tensordot(weights, self.residues, axes=1) + self.rest.evaluate(omega)
        return blank_singular(found, singular, self.seen)

    def poles(self) -> ComplexArray:
        """Poles at positive frequencies, and real ones [rad/s]."""
        with np.errstate(divide="ignore"):
            inverse = 1.0 / self.flexibilities
        if self.first_order:
            return np.asarray(inverse[inverse.imag >= 0.0])
        return np.asarray(1j * np.sqrt(inverse))


def sum_over_poles(coordinates: ModalCoordinates) -> PoleSum:
    """The sum over all poles of the elastic modes; no damper may act on rigid-body motions.

    Raises:
        AccuracyError: The poles lie so close together that they have hardly independent shapes (critical damping).

    Source: Frazer, Duncan and Collar (1938); Geradin and Rixen (2015), section 3.3. The inverse state matrix is used, which
        in modal coordinates needs no factorisation of the stiffness.
    """
    bent = slice(coordinates.rigid_count, None)
    omega = coordinates.omega[bent]
    rows, loads = coordinates.outputs[:, bent] + 0j, coordinates.inputs[bent] + 0j
    softness = _softness(coordinates.hysteretic, bent, omega)
    if coordinates.viscous is None:
        values, vectors = _eigenpairs(softness / np.outer(omega, omega))
        left, right = rows @ vectors, _solve(vectors, loads)
        return PoleSum(values, _products(left, right), see_modes(left, right), rest_terms(coordinates), False)
    loss = softness / omega @ (coordinates.viscous[bent, bent] / omega)
    # state (W p, p') with W = diag(omega): A = [[0, W], [-W (softness)^-1, -C]]; its inverse needs no factorisation
    inverse = np.block([[-loss, -softness / omega], [np.diag(1.0 / omega), np.zeros_like(loss)]])
    values, vectors = _eigenpairs(inverse.real if coordinates.hysteretic is None else inverse)
    left = rows / omega @ vectors[: len(omega)]
    right = _solve(vectors, np.vstack([np.zeros_like(loads), loads]))
    # 1 / (i omega - 1 / mu) = -mu / (1 - i omega mu)
    return PoleSum(values, _products(left, -right), see_modes(left, right), rest_terms(coordinates), True)


def _softness(hysteretic: FloatArray | None, bent: slice, omega: FloatArray) -> ComplexArray:
    """Inverse of the complex stiffness ``W^-1 (W^2 + i H) W^-1``, W = diag(omega)."""
    unit = np.eye(len(omega)) + 0j
    return unit if hysteretic is None else _solve(unit + 1j * hysteretic[bent, bent] / np.outer(omega, omega), unit)


def _solve(matrix: ComplexArray, right: ComplexArray) -> ComplexArray:
    return np.asarray(np.linalg.solve(matrix, right), dtype=np.complex128)


def _products(left: ComplexArray, right: ComplexArray) -> ComplexArray:
    return np.asarray(np.einsum("ok,ki->koi", left, right))


def _eigenpairs(matrix: ComplexArray | FloatArray) -> tuple[ComplexArray, ComplexArray]:
    values, vectors = scipy.linalg.eig(matrix, check_finite=False)
    vectors = vectors / np.linalg.norm(vectors, axis=0)
    condition = np.linalg.cond(vectors)
    if not condition <= CONDITION_LIMIT:
        raise AccuracyError(f"the complex modes are nearly dependent (condition {condition:.2g}): critical damping")
    return np.asarray(values, dtype=np.complex128), np.asarray(vectors, dtype=np.complex128)
